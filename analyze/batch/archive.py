"""What lies in an archive: recordings under folders, globs and buckets, known by place, size and time without being opened."""

from __future__ import annotations

import fnmatch
import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
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
        exclude: globs; what matches one, by its whole place or its name alone, is left out.

    Raises:
        ArchiveError: a place does not exist, cannot be listed, or holds no recording.
    """
    found: dict[str, dict[str, Any]] = {}
    for place in places:
        listed = _listed(place)
        if not listed:
            raise ArchiveError(f"{place}: holds no recording (*.mcap): check the path")
        found.update(listed)
    kept = {url: info for url, info in found.items() if not _excluded(url, exclude)}
    # A file still being written, or cut, stands for itself only while the whole one is not there.
    kept = {url: info for url, info in kept.items() if not (url.endswith(PART_SUFFIX) and url.removesuffix(".part") in kept)}
    return [_source(urls, kept) for urls in _rows(sorted(kept))]


def _listed(place: str) -> dict[str, dict[str, Any]]:
    try:
        system, path = url_to_fs(place)
    except ImportError as error:
        protocol = place.split("://", 1)[0]
        package = _PACKAGES.get(protocol, "the package that it names")
        raise ArchiveError(f"{place}: {protocol}:// needs {package}: {' '.join(str(error).split())}") from None
    except ValueError as error:
        raise ArchiveError(f"{place}: {' '.join(str(error).split())}: give a path, or s3://bucket/folder") from None
    try:
        if any(sign in path for sign in "*?["):
            entries = system.glob(path, detail=True)
            assert isinstance(entries, dict)  # noqa: S101 - with detail it is
            files = {name: info for name, info in entries.items() if info["type"] == "file"}
            for name, info in entries.items():
                if info["type"] == "directory":
                    files.update(system.find(name, detail=True))
        elif system.isdir(path):
            files = system.find(path, detail=True)
        elif system.exists(path):
            files = {path: system.info(path)}
            return {_full(system, name): info for name, info in files.items()}
        else:
            raise ArchiveError(f"{place}: no such file or folder: check the path")
    except PermissionError:
        raise ArchiveError(f"{place}: may not be read: check its permissions, or the credentials") from None
    except (OSError, ValueError) as error:
        raise ArchiveError(f"{place}: cannot be listed: {' '.join(str(error).split())}") from None
    return {_full(system, name): info for name, info in files.items() if name.endswith((SUFFIX, PART_SUFFIX))}


def _full(system: fsspec.AbstractFileSystem, name: str) -> str:
    protocols = system.protocol if isinstance(system.protocol, tuple) else (system.protocol,)
    return name if "file" in protocols or "local" in protocols else str(system.unstrip_protocol(name))


def _excluded(url: str, exclude: Sequence[str]) -> bool:
    return any(fnmatch.fnmatch(url, pattern) or fnmatch.fnmatch(url.rsplit("/", 1)[-1], pattern) for pattern in exclude)


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
