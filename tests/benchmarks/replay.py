"""Cost of a replay: time to the first strike, memory, and comparison with rerun's MCAP loader.

`make bench-replay`. The recording is made here: ten minutes, 1 GB, ten strikes, with idle frames between. The
viewer has no screen. Wall time depends on the computer's load; CPU time hardly does.
"""

from __future__ import annotations

import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import rerun_cli
from rerun.experimental import ViewerClient

from tests.benchmarks.long_session import LAST_STRIKE, make_long_session

_POLL_S, _PATIENCE_S = 0.05, 600.0
_RERUN = str(Path(rerun_cli.__file__).parent / "rerun")
_SENT_ONLY = """
import sys
from pathlib import Path
from analyze.reading.recording_file import find_recording
from analyze.replay.run import replay_recording
from analyze.replay.sender import ReplayOptions, Sender
from analyze.replay.target import to_file
Sender.analyse_strike = lambda *_, **__: None
with to_file(Path(sys.argv[2])) as target:
    replay_recording(find_recording(Path(sys.argv[1])), target, ReplayOptions(), lambda *_: None)
"""


@dataclass(frozen=True)
class Spent:
    """Wall and CPU time of a command."""

    seconds: float
    cpu_s: float


def main() -> None:
    """Make the recording and print the figures."""
    with tempfile.TemporaryDirectory(
        prefix="percuss-bench-", dir=sys.argv[1] if len(sys.argv) > 1 else None
    ) as folder:
        recording = Path(folder) / "long.mcap"
        make_long_session(recording)
        size = recording.stat().st_size
        _say(f"recording: {size / 1e9:.2f} GB, ten minutes, ten strikes")
        _first_strike(recording)
        _conversion(recording, size)


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _first_strike(recording: Path) -> None:
    port = _free_port()
    begun = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "analyze", "replay", str(recording), "--headless-port", str(port)]
    )
    try:
        client = _connected(port, process)
        _wait_for(client, "/strike/s1.1/camera/image_before", process)
        _say(
            f"first strike's images in the viewer: {time.monotonic() - begun:.1f} s after the command's start"
        )
        viewer = _child(process.pid)
        _say(f"  of CPU time until then: analyze {_cpu(process.pid):.1f} s, viewer {_cpu(viewer):.1f} s")
        _wait_for(client, "/strike/s1.1/theta/fitted", process)
        _say(f"its fit: {time.monotonic() - begun:.1f} s")
        _wait_for(client, f"/strike/{LAST_STRIKE}/world/plumb", process)
        time.sleep(2.0)
        _say(f"the answer: {time.monotonic() - begun:.1f} s")
        _say(f"peak memory: analyze {_peak(process.pid):.0f} MB, viewer {_peak(viewer):.0f} MB")
        process.send_signal(signal.SIGINT)
        process.wait(20.0)
        _say(
            f"Ctrl-C: exit code {process.returncode}, viewer left behind: "
            f"{'yes' if Path(f'/proc/{viewer}').exists() else 'no'}"
        )
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()


def _conversion(recording: Path, size: int) -> None:
    ours, whole, theirs = (recording.with_name(name) for name in ("ours.rrd", "whole.rrd", "theirs.rrd"))
    sent = _run([sys.executable, "-c", _SENT_ONLY, str(recording), str(ours)])
    loaded = _run([_RERUN, "mcap", "convert", str(recording), "-o", str(theirs)])
    analysed = _run([sys.executable, "-m", "analyze", "replay", str(recording), "--save", str(whole)])
    rows = (
        ("analyze replay --save", analysed, whole),
        ("the same without tracking", sent, ours),
        ("rerun mcap convert", loaded, theirs),
    )
    for name, spent, path in rows:
        speed, written = size / 1e6 / spent.seconds, path.stat().st_size / 1e6
        _say(f"{name}: {spent.seconds:.1f} s, {spent.cpu_s:.1f} CPU s, {speed:.0f} MB/s -> {written:.0f} MB")
    _say(
        f"without tracking over rerun's loader: {loaded.seconds / sent.seconds:.2f} in time, "
        f"{loaded.cpu_s / sent.cpu_s:.2f} in CPU time"
    )


def _run(command: Sequence[str]) -> Spent:
    """Times of the faster of two runs, because the first may wait for the disk."""
    turns: list[Spent] = []
    for _ in range(2):
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        turns.append(
            Spent(
                time.monotonic() - begun, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            )
        )
    return min(turns, key=lambda turn: turn.seconds)


def _connected(port: int, process: subprocess.Popen[bytes]) -> ViewerClient:
    while process.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        time.sleep(_POLL_S)
    raise RuntimeError("the replay ended before its viewer answered")


def _wait_for(client: ViewerClient, entity: str, process: subprocess.Popen[bytes]) -> None:
    ends = time.monotonic() + _PATIENCE_S
    while time.monotonic() < ends and process.poll() is None:
        try:
            schema = client.get_recording_schema(paths_only=True)
        except (RuntimeError, OSError):  # nothing is loaded yet
            schema = None
        if schema is not None and any(found.entity_path == entity for found in schema.entities):
            return
        time.sleep(_POLL_S)
    raise RuntimeError(f"{entity} did not appear")


def _child(pid: int) -> int:
    (child, *_) = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    return int(child)


def _cpu(pid: int) -> float:
    """CPU time [s] of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _peak(pid: int) -> float:
    """Peak memory [MB] of a process."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1e3


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
