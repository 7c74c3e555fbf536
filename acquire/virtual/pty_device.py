"""Virtual device on a pseudo-terminal that clients open under a name of their own, as a serial port."""

from __future__ import annotations

import os
import tty
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class PtyDevice:
    """Device that is plugged in and unplugged; its owner reads and writes at `fd`.

    Args:
        link_path: symbolic link to create for the pseudo-terminal; an existing one is replaced.
    """

    def __init__(self, link_path: Path) -> None:
        self.port_path = link_path
        self.fd = self._slave = -1
        self.plug_in()

    def plug_in(self) -> None:
        """Create the pseudo-terminal and the symbolic link to it, at the start and after `close`."""
        self.fd, self._slave = os.openpty()
        tty.setraw(self._slave)  # kept open, so that clients may connect and disconnect
        os.set_blocking(self.fd, False)
        temporary = self.port_path.with_name(self.port_path.name + f".{os.getpid()}")
        temporary.symlink_to(os.ttyname(self._slave))
        temporary.replace(self.port_path)

    @property
    def plugged_in(self) -> bool:
        """True while the pseudo-terminal exists."""
        return self.fd >= 0

    def close(self) -> None:
        """Unplug the device: remove its pseudo-terminal and link. May be repeated."""
        if self.plugged_in:
            for fd in (self.fd, self._slave):
                os.close(fd)
            self.fd = self._slave = -1
            self.on_unplugged()
        self.port_path.unlink(missing_ok=True)

    def on_unplugged(self) -> None:
        """Called once the pseudo-terminal is gone: what the device loses with it."""
