"""Attack by connections: thousands opened and closed, thousands held, beside a daemon that records.

`striker.stop` must be answered all the while, and no frame may be lost.
"""

from __future__ import annotations

import contextlib
import resource
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.attack.findings import Finding, Tally
from tests.attack.requests import STOP_S
from tests.system.fault_rig import Daemon, Frames, fault_rig, wait_for_frames

HELD, OPENED = 2000, 10_000
_FLOOD = """
import sys
from pathlib import Path
from tests.attack.flood import flood
flood(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
"""


def flood(path: Path, held: int, opened: int) -> None:
    """Open `held` connections and keep them, then open and close `opened` others; wait for standard input.

    Every second held one has sent half a request.
    """
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    kept = [_connected(path) for _ in range(held)]
    for sock in kept[::2]:
        with contextlib.suppress(OSError):
            sock.send(b'{"id": 1, "method": "sta')
    for number in range(opened):
        with _connected(path) as sock, contextlib.suppress(OSError):
            if number % 3 == 0:
                sock.send(b"rubbish\n")
    sys.stdout.write("done\n")
    sys.stdout.flush()
    sys.stdin.readline()


def _connected(path: Path) -> socket.socket:
    """A connection; a full queue is waited for."""
    sock = socket.socket(socket.AF_UNIX)
    for _ in range(2000):
        try:
            sock.connect(str(path))
            break
        except BlockingIOError:
            time.sleep(0.005)
        except OSError:
            break
    return sock


def attack_flood(report: Callable[[Tally], None], held: int = HELD, opened: int = OPENED) -> None:
    """Flood a daemon that records, and stop its arm again and again.

    Args:
        report: called with the tally of all connections.
        held: number of connections that stay open.
        opened: number of connections that are opened and closed.
    """
    with fault_rig() as rig:
        _, daemon, client = rig.recording_daemon()
        wait_for_frames(client)
        start = time.monotonic()
        waits: list[float] = []
        command = [sys.executable, "-c", _FLOOD, str(daemon.socket), str(held), str(opened)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            while process.poll() is None and not _has_line(process):
                waits.append(_stop_s(daemon))
                time.sleep(0.05)
            waits += [_stop_s(daemon) for _ in range(10)]  # while 2 000 are held
            process.communicate("\n")
        waits += [_stop_s(daemon) for _ in range(10)]
        found = []
        text = f"{1e3 * (slowest := max(waits)):.0f} ms, the slowest of {len(waits)}"
        if slowest > STOP_S:
            found.append(Finding("slow stop", "a flood", text))
        client.call("recording.close")
        frames = Frames.of(rig.recording)
        if frames.lost:
            text = f"{frames.lost} of {frames.arrived + frames.lost} frames"
            found.append(Finding("frames lost", "a recording beside a flood", text))
        kind = f"connections: {held} held, others closed; slowest stop {1e3 * slowest:.0f} ms"
        report(Tally(f"{kind}, {frames.arrived} frames", held + opened, 0, time.monotonic() - start, found))


def _has_line(process: subprocess.Popen[str]) -> bool:
    """True if the process has said that it is done."""
    return bool(select.select([process.stdout], [], [], 0)[0])


def _stop_s(daemon: Daemon) -> float:
    """Time until the daemon has answered `striker.stop` on a new connection [s]."""
    start = time.monotonic()
    with daemon.client() as client:
        client.call("striker.stop")
    return time.monotonic() - start
