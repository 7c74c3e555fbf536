"""Dead man's switch: switches the servo's torque off when the process that controls it has died.

The servo's bus watchdog stops a motion but holds the torque for ever, and no register releases it on silence.
So a small process inherits the port, waits for the end of a pipe, and then writes the packet that switches
the torque off. It also works while the arm stands and the bus is silent.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys

from acquire.errors import StrikerError
from acquire.striker import deadman_process


class DeadManSwitch:
    """Child process that switches the servo's torque off 0.11 s after this process has ended.

    By then the servo's bus watchdog has stopped a swinging arm. The child is ready once the constructor
    has returned.

    Args:
        descriptor: file descriptor of the open serial port, which the child inherits.
        torque_off_packet: packet that switches the torque off and is not answered.

    Raises:
        StrikerError: the process ended before it was ready.
    """

    def __init__(self, descriptor: int, torque_off_packet: bytes) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", deadman_process.__file__, str(descriptor), torque_off_packet.hex()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(descriptor,),
            start_new_session=True,
        )
        assert self._process.stdout is not None  # noqa: S101 - Popen was given PIPE
        with self._process.stdout as output:
            ready = output.read(1)
        if not ready:
            self.dismiss()
            raise StrikerError(
                "the process that switches the torque off when this one dies does not start; "
                f"check that {sys.executable} can be run"
            )

    @property
    def alive(self) -> bool:
        """True while the dead man's switch's process runs."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Process id of the dead man's switch's process."""
        return self._process.pid

    def dismiss(self) -> None:
        """End the dead man's switch's process without switching the torque off, and wait for its end.

        The servo's serial port stays open in this process.
        """
        assert self._process.stdin is not None  # noqa: S101 - Popen was given PIPE
        with contextlib.suppress(OSError):  # the process was killed
            self._process.stdin.write(deadman_process.DISMISSED)
            self._process.stdin.flush()
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait()
