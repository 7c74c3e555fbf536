"""Reason, with remedy, why a serial port cannot be opened."""

from __future__ import annotations

import errno
from pathlib import Path


def port_problem(port: str, error: Exception) -> str:
    """Text on why the serial port at the path `port` could not be opened, and what to try.

    Args:
        port: path of the serial port.
        error: exception that opening it raised.
    """
    number = getattr(error, "errno", None)
    if number in {errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY}:
        return f"the port is in use by another program; `fuser {port}` names it"
    if number == errno.EACCES:
        return (
            "no permission to open the port; add yourself to its group (dialout) and log in again (for a "
            "lingering service restart user@UID)"
        )
    problem = "is not a serial port" if Path(port).exists() else "no such serial port"
    return f"{problem}; check the cable, and `port` in the rig file"
