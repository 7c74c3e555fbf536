"""Process of the dead man's switch: switches the servo's torque off when its parent has ended.

It is run by its path, without the package, and is ready after some 20 ms. It ignores the signals that ask the
striker's process to end.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time

DELAY_S = 0.11
"""delay before the torque goes off [s]: the servo's watchdog stops a swinging arm within 100 ms;
an arm without torque before that would swing on"""
REPETITIONS, REPETITION_PAUSE_S = 3, 0.005
"""number of times that the packet is sent, because nothing confirms it, and pause between them [s]"""
READY, DISMISSED = b"!", b"."
"""byte that the process sends when it is ready, and byte that it receives when it is no longer needed"""


def main() -> None:
    """Wait for the end of the parent process; 0.11 s later send the packet that switches the torque off.

    The packet is sent three times. The command line gives the file descriptor of the serial port, and the
    packet in hexadecimal. A "!" on standard output shows that the process is ready. The end of standard
    input shows that the parent has ended. If a "." arrives there first, nothing is sent.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    os.write(1, READY)
    if os.read(0, 1) == DISMISSED:
        return
    time.sleep(DELAY_S)
    for _ in range(REPETITIONS):
        with contextlib.suppress(OSError):  # the port was unplugged
            os.write(int(sys.argv[1]), bytes.fromhex(sys.argv[2]))
        time.sleep(REPETITION_PAUSE_S)


if __name__ == "__main__":
    main()
