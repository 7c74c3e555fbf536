"""Unix socket that only its user can open: mode 0600, in a folder of mode 0700 that belongs to the user."""

from __future__ import annotations

import os
import socket
import stat
from pathlib import Path

from acquire.daemon.client import DaemonClient
from acquire.errors import DaemonBusy, DaemonError, DaemonNotRunning

BACKLOG = 128
"""connections that the system queues until the daemon takes them"""


def listen_privately(path: Path) -> socket.socket:
    """Open and return a socket that listens at `path`, with mode 0600 in a private folder.

    The socket that a killed daemon left at `path` is replaced.

    Raises:
        DaemonBusy: a daemon listens at `path` already.
        DaemonError: the path is too long or taken, its folder is not private, or the socket cannot be made.
    """
    if len(str(path).encode()) > 100:
        raise DaemonError(
            f"{path}: a socket's path may have 100 bytes; "
            "set [daemon] socket in the rig file to a shorter one"
        )
    _require_private_folder(path.parent)
    _remove_stale_socket(path)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    mask = os.umask(0o177)
    try:
        sock.bind(str(path))
    except OSError as error:
        sock.close()
        raise DaemonError(
            f"{path}: the daemon's socket cannot be made: {error.strerror}: set [daemon] socket elsewhere"
        ) from None
    finally:
        os.umask(mask)
    sock.listen(BACKLOG)
    return sock


def _require_private_folder(folder: Path) -> None:
    """Create the socket's folder if it is missing; raise DaemonError if others could put theirs in its place.

    Raises:
        DaemonError: the folder cannot be made, is a symbolic link, belongs to another user, or others may
            access it; or a folder above it belongs to another user, or lets others replace what is in it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        above = [(each, each.stat()) for each in folder.absolute().parents]
    except OSError as error:
        raise DaemonError(
            f"{folder}: cannot be made for the daemon's socket: {error.strerror}: "
            "set [daemon] socket elsewhere"
        ) from None
    if stat.S_ISLNK(found.st_mode):
        raise DaemonError(
            f"{folder}: is a symbolic link, but the daemon's socket needs a folder: "
            "set [daemon] socket to a path in the folder that the link leads to"
        )
    if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise DaemonError(
            f"{folder}: the folder of the daemon's socket must belong to you alone: set its mode (chmod 700)"
        )
    for each, state in above:
        if state.st_uid not in {os.getuid(), 0}:
            raise DaemonError(
                f"{each}: belongs to user {state.st_uid}, who could replace the daemon's socket in it: "
                "set [daemon] socket in the rig file to a path in a folder of your own"
            )
        if state.st_mode & stat.S_IWOTH and not state.st_mode & stat.S_ISVTX:
            raise DaemonError(
                f"{each}: every user may replace the daemon's socket in it: take the right to write from "
                f"others (chmod o-w {each}), or set [daemon] socket to a path in another folder"
            )


def _remove_stale_socket(path: Path) -> None:
    """Remove the socket that a killed daemon left at `path`, if there is one; never anything else.

    Raises:
        DaemonBusy: a daemon listens at `path`.
        DaemonError: something else is at `path`, the socket belongs to another user, or the daemon there
            hangs.
    """
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found.st_mode):
        raise DaemonError(
            f"{path}: is not a socket, and is left as it is: "
            "set [daemon] socket in the rig file to another path"
        )
    if found.st_uid != os.getuid():
        raise DaemonError(
            f"{path}: belongs to user {found.st_uid}, and is left as it is: "
            "set [daemon] socket in the rig file to another path"
        )
    try:
        DaemonClient(path).close()
    except DaemonNotRunning:
        path.unlink()
    else:
        raise DaemonBusy(
            f"a daemon already listens at {path}: "
            "stop it with `acquire stop --daemon`, or set [daemon] socket to another path"
        )
