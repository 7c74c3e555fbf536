"""The process that takes the torque off when its parent is gone (see deadman.py). Run by its path, without the package: up in some 20 ms.

It ignores the signals that ask the striker's process to end.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time

AFTER_S = 0.13
"""the watchdog needs 100 ms and a little to stop a swinging arm; let go before, it would swing on"""
TIMES, APART_S = 3, 0.005
UP, DISMISSED = b"!", b"."
"""what it says when it stands by, and what is said to it when it is not needed any more"""


def main() -> None:
    """Entry point: descriptor and packet (hexadecimal)."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    os.write(1, UP)
    if os.read(0, 1) == DISMISSED:
        return
    time.sleep(AFTER_S)
    for _ in range(TIMES):
        with contextlib.suppress(OSError):  # the port is gone as well
            os.write(int(sys.argv[1]), bytes.fromhex(sys.argv[2]))
        time.sleep(APART_S)


if __name__ == "__main__":
    main()
