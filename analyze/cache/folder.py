"""Folder of the cache: one file per entry, written whole, checked when read, the oldest removed.

Several programs may use one folder at the same time. An entry is named by a hash of all that it was computed
from, so that two programs that write the same entry write the same content.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from schemas.output_file import OutputError, write_bytes

FOLDER_VARIABLE = "PERCUSS_CACHE"
"""environment variable that names the folder; empty: nothing is kept"""
MAX_BYTES = 1_000_000_000
"""size [bytes] of all entries above which those not used for longest are removed"""
SUFFIX = ".cached"
_FORMAT = 1
_MAX_HEAD_BYTES = 4096
_ABANDONED_S = 3600.0
"""age [s] above which an unfinished file belongs to a program that was killed"""


class EntryError(ValueError):
    """Error: an entry of the cache cannot be used; the message is the reason."""


@dataclass(frozen=True)
class Entry:
    """One entry as its file describes it, without its content."""

    path: Path
    """file of the entry"""
    label: str
    """what the entry holds, in words; "" if the file is damaged"""
    size_bytes: int
    """size of the file"""
    used: float
    """time of its last use [s since 1970]"""


def default_folder() -> Path | None:
    """Folder of the user's cache; None if the user switched it off.

    It is that of the environment variable PERCUSS_CACHE, otherwise `percuss` in XDG_CACHE_HOME or ~/.cache.
    """
    if (named := os.environ.get(FOLDER_VARIABLE)) is not None:
        return Path(named).expanduser().absolute() if named else None
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        # By the XDG specification a relative path is ignored.
        return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "percuss"
    except RuntimeError:  # no home
        return None


class CacheFolder:
    """Entries of one folder, which is made when the first entry is written.

    Args:
        path: the folder.
        max_bytes: size [bytes] of all entries above which those not used for longest are removed.
    """

    def __init__(self, path: Path, max_bytes: int = MAX_BYTES) -> None:
        self.path, self.max_bytes = path, max_bytes

    def read(self, key: str) -> bytes | None:
        """Content of the entry `key`; None if there is none that can be read. The entry counts as used.

        Raises:
            EntryError: the entry's file is damaged, or was not written by this cache.
        """
        path = self._file(key)
        try:
            whole = path.read_bytes()
        except OSError:
            return None
        head, _, content = whole.partition(b"\n")
        fields = _head(head)
        if fields is None or fields.get("sha256") != hashlib.sha256(content).hexdigest():
            raise EntryError(f"{path}: is damaged")
        with suppress(OSError):
            os.utime(path)
        return content

    def write(self, key: str, label: str, content: bytes) -> bool:
        """Write an entry, and remove the oldest ones if there are too many.

        Args:
            key: name of the entry: hexadecimal digits.
            label: what the entry holds, in words, one short line.
            content: content of the entry.

        Returns:
            True if the entry was written; False if the folder cannot be written, or this entry alone is
            larger than all entries together may be (`max_bytes`).
        """
        head = {"percuss_cache": _FORMAT, "label": label[:500], "sha256": hashlib.sha256(content).hexdigest()}
        whole = json.dumps(head).encode() + b"\n" + content
        if len(whole) > self.max_bytes:
            return False
        try:
            # Recordings may be confidential, and entries are not checked for who wrote them.
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_bytes(self._file(key), whole)
        except (OSError, OutputError):
            return False
        self._remove_oldest()
        return True

    def entries(self) -> list[Entry]:
        """All entries, the one used last first; empty if the folder does not exist."""
        return sorted(map(_described, self._files()), key=lambda entry: -entry.used)

    def clear(self) -> int:
        """Remove all entries, and unfinished files of programs that were killed; returns how many entries.

        Other files of the folder stay.

        Raises:
            OutputError: an entry cannot be removed.
        """
        removed = 0
        for path in self._files():
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                raise OutputError(f"{path}: cannot be removed: {error.strerror}") from None
            removed += 1
        self._remove_abandoned()
        return removed

    def _file(self, key: str) -> Path:
        return self.path / f"{key}{SUFFIX}"

    def _files(self) -> Iterator[Path]:
        try:
            yield from [path for path in self.path.iterdir() if path.suffix == SUFFIX and path.is_file()]
        except OSError:
            return

    def _remove_oldest(self) -> None:
        found = sorted(((path, *_size_and_use(path)) for path in self._files()), key=lambda each: each[2])
        excess = sum(size for _, size, _ in found) - self.max_bytes
        for path, size, _ in found:
            if excess <= 0:
                return
            with suppress(OSError):
                path.unlink(missing_ok=True)
            excess -= size
        self._remove_abandoned()

    def _remove_abandoned(self) -> None:
        with suppress(OSError):
            for path in self.path.glob(f".*{SUFFIX}.*"):
                if time.time() - path.stat().st_mtime > _ABANDONED_S:
                    path.unlink(missing_ok=True)


def _size_and_use(path: Path) -> tuple[int, float]:
    """Size [bytes] and time of last use [s since 1970]; 0 and 0 if another program removed the file."""
    try:
        status = path.stat()
    except OSError:
        return 0, 0.0
    return status.st_size, status.st_mtime


def _described(path: Path) -> Entry:
    label = ""
    with suppress(OSError), path.open("rb") as file:
        fields = _head(file.readline(_MAX_HEAD_BYTES).rstrip(b"\n"))
        label = "" if fields is None else str(fields.get("label", ""))
    return Entry(path, label, *_size_and_use(path))


def _head(line: bytes) -> dict[str, object] | None:
    """Description of an entry from its file's first line; None if that line is no such description."""
    if len(line) > _MAX_HEAD_BYTES:
        return None
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return fields if isinstance(fields, dict) and fields.get("percuss_cache") == _FORMAT else None
