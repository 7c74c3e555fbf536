"""Attack by kills: a process of a session on the virtual rig is killed at a random moment.

Afterwards the recording must hold everything until half a second before the kill, as it is or rebuilt, no
process may be left, and the next session on the same rig must work: its first part is the resumption.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from acquire.virtual.operator import VirtualOperator
from tests.attack.findings import Finding, Tally
from tests.system.fault_rig import Daemon, Frames, alive
from tests.system.session_rig import SEED, SessionRig, session_rig

LOST_S = 0.5
"""longest time of frames before the kill that may be lost [s]"""
LONGEST_S = 22.0
"""latest moment of a kill after the session's start [s]"""
SESSION_S = 150.0
"""longest time until a session ends of which a process was killed [s]"""
GONE_S = 15.0
"""longest time until every process of a killed daemon is gone [s]"""
VICTIMS = (
    *(("daemon",), ("daemon", "capture"), ("capture",), ("watcher",), ("session",)),
    *(("daemon", "session"), ("daemon", "capture", "watcher", "session")),
)


def attack_kills(seed: int, count: int, until_s: float, report: Callable[[Tally], None]) -> None:
    """Kill processes in `count` sessions, or in as many as there is time for.

    Args:
        seed: seed of moments and victims.
        count: number of kills.
        until_s: end of the attack, by the monotonic clock [s].
        report: called with the tally of each kill.
    """
    rng = np.random.default_rng(seed)
    with session_rig() as rig:
        for number in range(count):
            if time.monotonic() > until_s:
                return
            victims = VICTIMS[int(rng.integers(len(VICTIMS)))]
            after_s = float(rng.uniform(0.0, LONGEST_S))
            start = time.monotonic()
            found = _one_kill(rig, number, victims, after_s)
            report(Tally(f"kill of {' and '.join(victims)}", 1, 0, time.monotonic() - start, found))


def _one_kill(rig: SessionRig, number: int, victims: tuple[str, ...], after_s: float) -> list[Finding]:
    """Start a session, kill processes, and judge what is left of it."""
    what = f"{' and '.join(victims)} after {after_s:.2f} s"
    path, complaints = rig.folder / f"r{number}.mcap", rig.folder / f"session{number}.err"
    operator = VirtualOperator(rig.daemon.socket, rig.world(), SEED + number)
    with contextlib.closing(operator), complaints.open("w", encoding="utf-8") as err:
        given = [
            rig.folder / "object.toml",
            rig.folder / "plan.json",
            "-o",
            path,
            "--rig",
            rig.folder / "d.toml",
        ]
        session = subprocess.Popen(
            [sys.executable, "-m", "acquire", "session", *given],
            stdout=subprocess.DEVNULL,
            stderr=err,
            stdin=subprocess.DEVNULL,
        )
        with contextlib.suppress(subprocess.TimeoutExpired):
            session.wait(after_s)
        ended_before = session.poll() is not None
        processes = {"daemon": rig.daemon.pid, "capture": rig.daemon.capture, "watcher": rig.daemon.watcher}
        killed_ns = time.time_ns()
        for victim in victims:
            pid = session.pid if victim == "session" else processes[victim]
            if pid:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        found = _ended(session, what)
    if "daemon" in victims:
        rig.daemon.process.wait()
        found += _processes_left([pid for pid in processes.values() if pid], what)
    said = complaints.read_text(encoding="utf-8", errors="replace")
    if "Traceback" in said + rig.daemon.complaints:
        found.append(Finding("traceback", what, (said + rig.daemon.complaints)[-2000:]))
    found += _recording_problems(path, what, killed_ns, victims, ended_before=ended_before)
    if "daemon" in victims:
        rig.daemon = Daemon(rig.folder / "d.toml")
        rig.cleanup.callback(rig.daemon.end)
        if not rig.daemon.ready:
            found.append(Finding("no restart", what, rig.daemon.complaints[-1000:]))
    for each in rig.folder.glob(f"r{number}*.mcap*"):
        each.unlink()
    return found


def _ended(session: subprocess.Popen[bytes], what: str) -> list[Finding]:
    """Wait until the session has ended."""
    try:
        session.wait(SESSION_S)
    except subprocess.TimeoutExpired:
        session.kill()
        session.wait()
        return [Finding("hang", what, f"the session did not end in {SESSION_S:.0f} s")]
    return []


def _processes_left(pids: list[int], what: str) -> list[Finding]:
    """Wait until the processes of a killed daemon have ended."""
    end = time.monotonic() + GONE_S
    while (left := [pid for pid in pids if alive(pid)]) and time.monotonic() < end:
        time.sleep(0.05)
    return [Finding("process left", what, f"{left} after {GONE_S:.0f} s")] if left else []


def _recording_problems(
    path: Path, what: str, killed_ns: int, victims: tuple[str, ...], *, ended_before: bool
) -> list[Finding]:
    """What is wrong with the files of a killed session: unreadable, or more lost than allowed."""
    time.sleep(0.5)  # the capture process finishes its file
    for _ in range(100):
        if "capture" in victims or not list(path.parent.glob(f"{path.stem}*.part")):
            break
        time.sleep(0.1)
    for part in path.parent.glob(f"{path.stem}*.part"):
        out = part.with_name(part.name.removesuffix(".part"))
        code = subprocess.run(
            [sys.executable, "-m", "acquire", "recover", part, "-o", out],
            capture_output=True,
            check=False,
            text=True,
        )
        if code.returncode not in {0, 3} and part.stat().st_size > 4096:
            return [Finding("not recovered", what, code.stderr)]
    files = sorted(path.parent.glob(f"{path.stem}*.mcap"))
    if not files:
        return []  # killed before the recording was opened
    found = []
    last_ns = 0
    for file in files:
        command = [sys.executable, "-m", "analyze", "inspect", "--json", file]
        seen = subprocess.run(command, capture_output=True, check=False, text=True)
        if seen.returncode:
            found.append(Finding("unreadable", what, seen.stderr[-500:]))
            continue
        if not json.loads(seen.stdout)["complete"]:
            found.append(Finding("incomplete", what, str(file.name)))
        with contextlib.suppress(IndexError, ValueError):  # no frames yet
            last_ns = max(last_ns, Frames.of(file).last_ns)
    if last_ns and not ended_before and killed_ns - last_ns > LOST_S * 1e9 and "session" not in victims:
        found.append(Finding("frames lost", what, f"the last {(killed_ns - last_ns) * 1e-9:.2f} s"))
    return found
