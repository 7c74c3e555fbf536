"""Input files: only regular files are read, without waiting, and at most a bounded number of bytes."""

from __future__ import annotations

import errno
import os
import stat
from functools import cache
from io import TextIOWrapper
from pathlib import Path
from typing import IO, BinaryIO, Final

MAX_TEXT_BYTES: Final = 1 << 25
"""largest file of text that is read"""
MAX_FILE_BYTES: Final = 1 << 29
"""largest file that is read into memory as a whole: shapes, images"""
_KINDS: Final = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_file(path: Path) -> BinaryIO:
    """Open a regular file to be read as bytes; errors as of `open_descriptor`."""
    return os.fdopen(open_descriptor(path), "rb")


def open_descriptor(path: Path) -> int:
    """File descriptor of a regular file, opened to be read without waiting for another program.

    Raises:
        OSError: the file cannot be opened, or is a pipe, device or socket, whose end may never come.
    """
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except ValueError:  # a zero byte in its name
        raise OSError(errno.EINVAL, "its name contains a zero byte", str(path)) from None
    try:
        about = os.fstat(fd)
        kind = _KINDS.get(stat.S_IFMT(about.st_mode))
        if kind is None and stat.S_ISREG(about.st_mode) and about.st_dev in _kernels_devices():
            kind = "made by the kernel"
        if kind is not None:
            raise OSError(
                errno.EINVAL, f"it is {kind}, not a file; copy its content to a file and name that", str(path)
            )
        if stat.S_ISDIR(about.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    except BaseException:
        os.close(fd)
        raise
    return fd


@cache
def _kernels_devices() -> frozenset[int]:
    """Numbers of the file systems whose files are made while they are read, some of them without end."""
    return frozenset(folder.stat().st_dev for folder in map(Path, ("/proc", "/sys")) if folder.is_dir())


def open_text(path: Path, encoding: str = "utf-8", newline: str | None = None) -> IO[str]:
    """Open a regular file of at most `MAX_TEXT_BYTES` bytes to be read as text; arguments as of `open`.

    Raises:
        OSError: the file is larger, or as for `open_file`.
    """
    file = open_file(path)
    if os.fstat(file.fileno()).st_size > MAX_TEXT_BYTES:
        file.close()
        raise _too_large(path, MAX_TEXT_BYTES)
    return TextIOWrapper(file, encoding=encoding, newline=newline)


def read_bytes(path: Path, most: int = MAX_FILE_BYTES) -> bytes:
    """Content of a regular file of at most `most` bytes.

    Raises:
        OSError: the file is larger, or as for `open_file`.
    """
    with open_file(path) as file:
        # A file of /proc states no size, and a file with holes a false one: what is read is counted.
        stated = os.fstat(file.fileno()).st_size
        data = file.read(most + 1) if stated <= most else None
    if data is None or len(data) > most:
        raise _too_large(path, most)
    return data


def _too_large(path: Path, most: int) -> OSError:
    return OSError(errno.EFBIG, f"it is larger than {most >> 20} MB; name another file", str(path))


def read_text(path: Path) -> str:
    """Text of a regular file in UTF-8, of at most `MAX_TEXT_BYTES` bytes, with line feeds as ends of lines.

    A byte order mark at the beginning, as editors of Windows write it, is left out.

    Raises:
        OSError: as for `read_bytes`.
        UnicodeDecodeError: the file is not UTF-8 text.
    """
    text = read_bytes(path, MAX_TEXT_BYTES).decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
