"""Attack on the daemon's socket: rubbish, wrong types, real methods with wild parameters, sudden ends.

The daemon is a real one, with a camera and a servo on this computer, and records meanwhile.
"""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.attack.findings import Finding, Tally
from tests.system.fault_rig import Daemon, Frames, fault_rig

STOP_S = 0.2
"""longest time until `striker.stop` is answered [s]"""
EVERY = 2000
"""number of requests after which the daemon is looked at"""
PIPELINED = 20
"""number of requests that a client sends before it reads"""
READ_S = 1.0
"""longest time for which a client reads answers [s]"""
MEMORY_BYTES = 1 << 30
METHODS = (
    *("status", "rig", "recording.open", "recording.state", "recording.strike", "window.open"),
    *("window.close", "striker.home", "striker.arm", "striker.cock", "striker.strike", "striker.stop"),
    *("watch.expect", "watch.judge", "watch.latest", "prompt", "prompt.answer", "subscribe", "none", ""),
)
NAMES = (
    "path",
    "strike_id",
    "tip_speed_m_s",
    "end_ns",
    "timeout_s",
    "kind",
    "state",
    "id",
    "text",
    "object_toml",
)
VALUES = (
    *(None, True, 0, -1, 1 << 70, 1e308, "", "x", "\u0000", "../../x", "a" * 9000, [], {}, [[[]]], {"a": {}}),
    *("/dev/full", "/proc/self/mem", "\u001b[2J"),
)


def _request(rng: np.random.Generator) -> bytes:
    way = int(rng.integers(8))
    if way == 0:
        return rng.bytes(int(rng.integers(1, 300))).replace(b"\n", b" ") + b"\n"
    if way == 1:
        return b"[" * int(rng.integers(1, 5000)) + b"\n"
    asked: dict[str, Any] = {"id": _value(rng) if way == 2 else int(rng.integers(1 << 30))}
    asked["method"] = METHODS[int(rng.integers(len(METHODS)))] if way != 3 else _value(rng)
    if way != 4:
        asked["params"] = (
            _value(rng)
            if way == 5
            else {NAMES[int(rng.integers(len(NAMES)))]: _value(rng) for _ in range(int(rng.integers(4)))}
        )
    data = json.dumps(asked).encode() + b"\n"
    if way == 6:
        data = data[: int(rng.integers(1, len(data)))]
    return data


def _value(rng: np.random.Generator) -> Any:
    return VALUES[int(rng.integers(len(VALUES)))]


def attack_requests(seed: int, count: int, until_s: float, report: Callable[[Tally], None]) -> None:
    """Send `count` requests to a daemon that records, or as many as there is time for.

    Args:
        seed: seed of the requests.
        count: number of requests.
        until_s: end of the attack, by the monotonic clock [s].
        report: called with the tally of each round.
    """
    rng = np.random.default_rng(seed)
    with fault_rig() as rig:
        _, daemon, client = rig.recording_daemon()
        kind, sent, rounds = "requests to the daemon", 0, 0
        while sent < count and time.monotonic() < until_s:
            start = time.monotonic()
            number = _send_some(daemon.socket, rng)
            sent += number
            rounds += 1
            found: list[Finding] = []
            if rounds % (EVERY // PIPELINED) == 0:
                found = _look(daemon)
            report(Tally(kind, number, _memory_bytes(daemon.pid), time.monotonic() - start, found))
        found = _look(daemon)
        for _ in range(30):  # a client whose strike was under way is waited for
            with contextlib.suppress(Exception):
                client.call("recording.close")
                break
            time.sleep(1.0)
        client.close()
        daemon.end()
        if rig.recording.exists() and (frames := Frames.of(rig.recording)).lost:
            text = f"{frames.lost} of {frames.arrived + frames.lost} frames"
            found.append(Finding("frames lost", "a recording beside the requests", text))
        if "Traceback" in daemon.complaints:
            found.append(Finding("traceback", "the daemon", daemon.complaints[-2000:]))
        report(Tally(kind, 0, 0, 0.0, found))


def _send_some(path: Path, rng: np.random.Generator) -> int:
    """Send a few requests on one connection; read the answers, or leave at once."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as sock:
        sock.settimeout(READ_S)
        sock.connect(str(path))
        number = int(rng.integers(1, 2 * PIPELINED))
        data = b"".join(_request(rng) for _ in range(number))
        sock.sendall(data)
        if rng.integers(4):
            sock.shutdown(socket.SHUT_WR)
            end = time.monotonic() + READ_S  # a subscriber is sent events without end
            while time.monotonic() < end and sock.recv(1 << 16):
                pass
        return number
    return 1


def _look(daemon: Daemon) -> list[Finding]:
    """What is wrong with the daemon: ended, slow to stop the arm, or too large."""
    if daemon.process.poll() is not None:
        return [Finding("crash", "the daemon ended", daemon.complaints[-2000:])]
    found = []
    start = time.monotonic()
    try:
        with daemon.client() as client:
            client.call("striker.stop")
    except Exception as error:
        found.append(Finding("deaf", "striker.stop", f"{type(error).__name__}: {error}"))
    took = time.monotonic() - start
    if took > STOP_S:
        found.append(Finding("slow stop", "striker.stop", f"{1e3 * took:.0f} ms"))
    if (memory := _memory_bytes(daemon.pid)) > MEMORY_BYTES:
        found.append(Finding("memory", "the daemon", f"{memory / 1e6:.0f} MB"))
    return found


def _memory_bytes(pid: int) -> int:
    """Largest resident memory that a process had [bytes]; 0 if it has ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024
    return 0
