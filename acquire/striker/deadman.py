"""Lets the servo go when the process that held it is gone: a killed program can no longer say so itself.

The servo's bus watchdog stops a motion but holds the torque for ever, and there is no register that would let go on silence. So a
process of a few lines inherits the port, waits for the end of a pipe, and writes the last words. It also works where the arm stands and
the bus is silent.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys

from acquire.errors import StrikerError
from acquire.striker import deadman_process


class DeadMan:
    """Stands by while the servo is held, from the end of the constructor on.

    Args:
        descriptor: of the open port.
        last_words: packet that takes the torque off, unanswered.

    Raises:
        StrikerError: the process did not start.
    """

    def __init__(self, descriptor: int, last_words: bytes) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", deadman_process.__file__, str(descriptor), last_words.hex()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(descriptor,),
            start_new_session=True,
        )
        assert self._process.stdout is not None  # noqa: S101 - Popen was asked for it
        with self._process.stdout as words:
            up = words.read(1)
        if not up:
            self.dismiss()
            raise StrikerError(f"the process that lets the servo go when this one dies does not start; can {sys.executable} be run?")

    @property
    def alive(self) -> bool:
        """Whether it stands by."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Of the process that stands by."""
        return self._process.pid

    def dismiss(self) -> None:
        """It ends and does nothing. The port stays ours."""
        assert self._process.stdin is not None  # noqa: S101 - Popen was asked for it
        with contextlib.suppress(OSError):  # it was killed
            self._process.stdin.write(deadman_process.DISMISSED)
            self._process.stdin.flush()
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait()
