"""Lets the servo go when the process that held it is gone: a killed program can no longer say so itself.

The servo's bus watchdog stops a motion but holds the torque for ever, and there is no register that would let go on silence. So a
process of a few lines inherits the port, waits for the end of a pipe, and writes the last words. It also works where the arm stands and
the bus is silent.

Run by its path, without the package: it is up in some 20 ms. It ignores the signals that ask the striker's process to end.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time

AFTER_S = 0.13
"""the watchdog needs 100 ms and a little to stop a swinging arm; let go before, it would swing on"""
TIMES, APART_S = 3, 0.005
DISMISSED = b"."


class DeadMan:
    """Stands by while the servo is held.

    Args:
        descriptor: of the open port.
        last_words: packet that takes the torque off, unanswered.
    """

    def __init__(self, descriptor: int, last_words: bytes) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, str(descriptor), last_words.hex()],
            stdin=subprocess.PIPE,
            pass_fds=(descriptor,),
            start_new_session=True,
        )

    @property
    def pid(self) -> int:
        """Of the process that stands by."""
        return self._process.pid

    def dismiss(self) -> None:
        """It ends and does nothing. The port stays ours."""
        assert self._process.stdin is not None  # noqa: S101 - Popen was asked for it
        with contextlib.suppress(OSError):  # it was killed
            self._process.stdin.write(DISMISSED)
            self._process.stdin.flush()
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait()


def main() -> None:
    """Entry point: descriptor and packet (hexadecimal)."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    if os.read(0, 1) == DISMISSED:
        return
    time.sleep(AFTER_S)
    for _ in range(TIMES):
        with contextlib.suppress(OSError):  # the port is gone as well
            os.write(int(sys.argv[1]), bytes.fromhex(sys.argv[2]))
        time.sleep(APART_S)


if __name__ == "__main__":
    main()
