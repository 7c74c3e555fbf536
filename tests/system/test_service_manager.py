"""What a service manager hears from a real daemon: that it is ready, that it lives, that it hangs, and that it ends."""

from __future__ import annotations

import itertools
import signal
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from tests.system.fault_rig import FaultRig, add_row, fault_rig, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(90)]
PATIENCE_S = 2.0
"""after which the manager would end a daemon that says nothing"""


@pytest.fixture
def rig() -> Iterator[FaultRig]:
    with fault_rig() as rig:
        yield rig


class Manager:
    """Listens where NOTIFY_SOCKET says, and how long this computer lets a thread wait meanwhile."""

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


def test_a_daemon_that_hangs_gives_no_sign_of_life(rig: FaultRig) -> None:
    rig.camera()
    manager = Manager(str(rig.folder / "notify"))
    try:
        environment = {"NOTIFY_SOCKET": str(rig.folder / "notify"), "WATCHDOG_USEC": str(round(PATIENCE_S * 1e6))}
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
        f"the daemon hangs under systemd (WatchdogSec={PATIENCE_S:g})",
        f"no sign of life: systemd ends it after {PATIENCE_S:g} s and starts it again",
        f"had it gone on: {back_s:.1f} s",
    )
