"""Notifications of a real daemon to its service manager, and a restart after its death.

The test takes the place of systemd, which is not run.
"""

from __future__ import annotations

import configparser
import itertools
import signal
import socket
import threading
import time

import pytest

from tests.places import ROOT
from tests.system.fault_rig import FaultRig, Frames, add_row, alive, wait_until, works_again

pytestmark = [pytest.mark.slow, pytest.mark.timeout(90)]
PATIENCE_S = 2.0
"""watchdog time [s], after which the manager would end a daemon that sends no notification"""


class Manager:
    """Socket at NOTIFY_SOCKET that records notifications, and the delays of this computer's threads."""

    def __init__(self, address: str) -> None:
        self.heard: list[tuple[float, str]] = []
        self.stall_s = 0.0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        self._socket.settimeout(0.02)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="manager")
        self._thread.start()

    def _listen(self) -> None:
        while not self._ended.is_set():
            start = time.monotonic()
            try:
                self.heard.append((time.monotonic(), self._socket.recv(1000).decode().partition("\n")[0]))
            except TimeoutError:
                self.stall_s = max(self.stall_s, time.monotonic() - start - 0.02)

    def times(self, word: str) -> list[float]:
        return [at for at, heard in list(self.heard) if heard == word]

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()


def longest_silence(times: list[float]) -> float:
    return max(after - before for before, after in itertools.pairwise(times))


def test_a_hung_daemon_sends_no_keep_alive(rig: FaultRig) -> None:
    rig.camera()
    manager = Manager(str(rig.folder / "notify"))
    try:
        environment = {
            "NOTIFY_SOCKET": str(rig.folder / "notify"),
            "WATCHDOG_USEC": str(round(PATIENCE_S * 1e6)),
        }
        daemon = rig.daemon(rig.rig_file(striker='kind = "manual"'), **environment)
        assert daemon.ready, daemon.complaints
        wait_until(lambda: len(manager.times("WATCHDOG=1")) > 6, 30.0)
        alive = manager.times("WATCHDOG=1")
        assert [word for _, word in manager.heard[:1]] == ["READY=1"]
        assert longest_silence(alive) < PATIENCE_S / 2 + manager.stall_s

        daemon.process.send_signal(signal.SIGSTOP)
        time.sleep(0.1)  # what was on its way
        hung = time.monotonic()
        time.sleep(1.5 * PATIENCE_S)
        assert [at for at in manager.times("WATCHDOG=1") if at > hung] == []

        daemon.process.send_signal(signal.SIGCONT)
        back_s = wait_until(lambda: manager.times("WATCHDOG=1")[-1] > hung, 10.0)
        daemon.process.send_signal(signal.SIGTERM)
        assert daemon.process.wait(30) == 0, daemon.complaints
        wait_until(lambda: manager.times("STOPPING=1"), 5.0)
        assert manager.times("WATCHDOG=1")[-1] <= manager.times("STOPPING=1")[0]
        assert len(manager.times("READY=1")) == 1
    finally:
        manager.close()
    add_row(
        "the daemon hangs (SIGSTOP), a test socket in place of systemd that expects a keep-alive "
        f"every {PATIENCE_S:g} s",
        "none is sent while the daemon hangs, so that systemd would end it: then as kill -9 of the daemon",
        f"keep-alives again {back_s:.1f} s after it continues",
    )


def test_a_killed_daemon_is_restarted_as_in_the_systemd_unit(rig: FaultRig) -> None:
    """The children are not killed, as with KillMode=process.

    The new daemon starts beside them and obtains camera, port and socket.
    """
    unit = configparser.ConfigParser()
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(ROOT / "docs" / "percuss.service")
    service = unit["Service"]
    assert (service["Type"], service["KillMode"], service["Restart"]) == ("notify", "process", "on-failure")
    assert unit["Unit"]["StartLimitIntervalSec"] == "0"
    restart_s = service.getfloat("RestartSec")

    _, daemon, client = rig.recording_daemon()
    rig.cocked(client)
    capture = daemon.capture
    daemon.process.kill()
    daemon.process.wait()
    killed = time.monotonic()
    wait_until(lambda: not rig.torque, 5.0, 0.01)
    off_s = time.monotonic() - killed
    time.sleep(max(0.0, killed + restart_s - time.monotonic()))
    starts, again = 1, rig.daemon()
    while not again.ready:  # refused, as the last one's camera is not free yet: the manager tries again
        assert again.process.wait(30) == 1, again.complaints
        time.sleep(restart_s)
        starts, again = starts + 1, rig.daemon()
        assert starts < 10, again.complaints
    back_s = time.monotonic() - killed
    wait_until(lambda: not alive(capture), 20.0)
    assert Frames.of(rig.recording).lost == 0
    works_again(rig, again)
    add_row(
        f"kill -9 of the daemon, started again {restart_s:g} s later as docs/percuss.service says (by "
        "the test, in place of systemd)",
        f"the capture process finishes the file; torque off after {1e3 * off_s:.0f} ms; everything until "
        "the next `recording.open`",
        f"{back_s:.1f} s after the kill, at start {starts}",
    )
