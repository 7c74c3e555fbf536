"""What lies in an archive: recordings under folders, globs and buckets, known by place, size and time without being opened."""

from __future__ import annotations

import fnmatch
import hashlib
import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Any

import fsspec
from fsspec.core import url_to_fs

from analyze.errors import ArchiveError

SUFFIX, PART_SUFFIX = ".mcap", ".mcap.part"
_NUMBERED = re.compile(r"(?P<stem>.+)-(?P<number>\d{4,})\.mcap")
_PACKAGES = {"s3": "percuss[s3]"}


@dataclass(frozen=True)
class SourceFile:
    """One file as it lies in the archive."""

    url: str
    """a path, or with its protocol"""
    size: int
    """bytes"""
    stamp: str
    """time of change or ETag: another one means that it may have changed"""


@dataclass(frozen=True)
class Source:
    """One recording: a file, or a row of them that are named alike."""

    files: tuple[SourceFile, ...]

    @property
    def url(self) -> str:
        """Of the first file."""
        return self.files[0].url

    @property
    def size(self) -> int:
        """Bytes, of all files."""
        return sum(file.size for file in self.files)

    @property
    def id(self) -> str:
        """Short, of place, size and stamp of all files."""
        text = "\n".join(f"{file.url}\t{file.size}\t{file.stamp}" for file in self.files)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def is_local(self) -> bool:
        """Whether it lies on a disk of this machine."""
        return "://" not in self.url

    def others(self, names: Iterable[str]) -> list[Source]:
        """Those of its files that are no part of its recording, whose files have these `names`: recordings of their own."""
        own = set(names)
        return [Source((file,)) for file in self.files[1:] if file.url.rsplit("/", 1)[-1] not in own]


def find_sources(places: Sequence[str], exclude: Sequence[str] = ()) -> list[Source]:
    """Every recording in the places, each once, in the order of their names.

    Args:
        places: files, folders (with all below), globs; local or with a protocol that fsspec knows (`s3://bucket/folder`).
        exclude: globs; what matches one is left out: by its whole place, its name, or any folders and names below the place that it
            was found in ("tests", "2025/*", "*-test.mcap").

    Raises:
        ArchiveError: a place does not exist, cannot be listed, or holds no recording.
    """
    found: dict[str, dict[str, Any]] = {}
    for place in places:
        root, listed = _listed(place, exclude)
        if not listed:
            raise ArchiveError(f"{place}: holds no recording (*.mcap): check the path")
        found.update({url: info for url, info in listed.items() if not _excluded(url, root, exclude)})
    kept = found
    # A file still being written, or cut, stands for itself only while the whole one is not there.
    kept = {url: info for url, info in kept.items() if not (url.endswith(PART_SUFFIX) and url.removesuffix(".part") in kept)}
    return [_source(urls, kept) for urls in _rows(sorted(kept))]


def _listed(place: str, exclude: Sequence[str]) -> tuple[str, dict[str, dict[str, Any]]]:
    """The folder that was named (of a glob the last one without its signs), and what recordings may lie there, by place."""
    if not place.strip():
        raise ArchiveError("a place is empty: name a folder, a glob or s3://bucket/folder")
    try:
        system, path = url_to_fs(place)
    except ImportError as error:
        protocol = place.split("://", 1)[0]
        package = _PACKAGES.get(protocol, "the package that it names")
        raise ArchiveError(f"{place}: {protocol}:// needs {package}: {' '.join(str(error).split())}") from None
    except ValueError as error:
        raise ArchiveError(f"{place}: {' '.join(str(error).split())}: give a path, or s3://bucket/folder") from None
    is_local = "file" in _protocols(system)
    try:
        if any(sign in path for sign in "*?[") and not system.exists(path):
            # The folder that we are in may have such signs in its own name.
            pattern = str(Path(place).expanduser()) if is_local and "://" not in place else path
            root = re.split(r"[*?\[]", pattern, maxsplit=1)[0].rpartition("/")[0]
            if is_local:
                root = str(Path(root).absolute())
                places = [str(Path(each).absolute()) for each in glob(pattern, recursive=True)]  # noqa: PTH207 - Path's knows no links
            else:
                places = [str(each) for each in system.glob(path)]
        elif system.exists(path):
            root, places = path, [path]
        else:
            raise ArchiveError(f"{place}: no such file or folder: check the path")
        files: dict[str, dict[str, Any]] = {}
        for each in places:
            if not system.isdir(each):
                files[each] = _local(each) if is_local else system.info(each)
            elif is_local:
                files.update({name: _local(name) for name in _walked(each, root, exclude)})
            else:
                files.update(system.find(each, detail=True))
    except PermissionError as error:
        where = error.filename if is_local and error.filename else place
        raise ArchiveError(f"{where}: may not be read: check its permissions, or the credentials, or leave it out with --exclude") from None
    except ArchiveError:
        raise
    except Exception as error:  # every protocol's library has its own: no network, no credentials
        raise ArchiveError(f"{place}: cannot be listed: {' '.join(str(error).split())}") from None
    # Of whatever name a file is that was named itself.
    wanted = {name: info for name, info in files.items() if [name] == places == [path] or name.endswith((SUFFIX, PART_SUFFIX))}
    return _full(system, root), {_full(system, name): info for name, info in wanted.items() if info["type"] == "file"}


def _walked(folder: str, root: str, exclude: Sequence[str]) -> Iterator[str]:
    """Every file below a folder of this machine; links are followed, none in a circle."""

    def refuse(error: OSError) -> None:
        if not isinstance(error, FileNotFoundError):  # removed meanwhile
            raise error

    seen: set[tuple[int, int]] = set()
    for place, folders, names in os.walk(folder, onerror=refuse, followlinks=True):
        about = Path(place).stat()
        if (about.st_dev, about.st_ino) in seen:
            folders.clear()
            continue
        seen.add((about.st_dev, about.st_ino))
        folders[:] = [each for each in folders if not _excluded(f"{place}/{each}", root, exclude)]
        yield from (f"{place}/{name}" for name in names if name.endswith((SUFFIX, PART_SUFFIX)))


def _local(path: str) -> dict[str, Any]:
    """Of what a link points to; a link that points nowhere is a file that cannot be reached."""
    try:
        about = Path(path).stat()
    except OSError:
        about = Path(path).lstat()
    kind = "file" if stat.S_ISREG(about.st_mode) or stat.S_ISLNK(about.st_mode) else "other"
    return {"size": about.st_size, "mtime": about.st_mtime_ns, "type": kind}


def _full(system: fsspec.AbstractFileSystem, name: str) -> str:
    return name if "file" in _protocols(system) else str(system.unstrip_protocol(name))


def _protocols(system: fsspec.AbstractFileSystem) -> tuple[str, ...]:
    return system.protocol if isinstance(system.protocol, tuple) else (system.protocol,)


def _excluded(url: str, root: str, exclude: Sequence[str]) -> bool:
    if not exclude:
        return False
    folder = f"{root.rstrip('/')}/"
    parts = url.removeprefix(folder).split("/") if url.startswith(folder) else []
    below = ["/".join(parts[i:j]) for i in range(len(parts)) for j in range(i + 1, len(parts) + 1)]
    tried = [url, url.rsplit("/", 1)[-1], *below]
    return any(fnmatch.fnmatch(each, pattern.removeprefix("./").rstrip("/")) for pattern in exclude for each in tried)


def _rows(urls: list[str]) -> list[list[str]]:
    """Files named alike (NAME.mcap, NAME-0002.mcap, ...) together."""
    there = set(urls)
    rows: dict[str, list[str]] = {}
    for url in urls:
        match = _NUMBERED.fullmatch(url)
        first = f"{match['stem']}{SUFFIX}" if match else url
        rows.setdefault(first if first in there else url, []).append(url)
    return [[first, *(url for url in row if url != first)] for first, row in sorted(rows.items())]


def _source(urls: list[str], infos: dict[str, dict[str, Any]]) -> Source:
    return Source(tuple(SourceFile(url, int(infos[url].get("size") or 0), _stamp(infos[url])) for url in urls))


def _stamp(info: dict[str, Any]) -> str:
    """What changes when a file does: its ETag where there is one, else its time of change."""
    for name in ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "updated"):
        if info.get(name):
            return str(info[name]).strip('"')
    return ""
