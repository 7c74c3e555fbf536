"""Find the recordings of an archive in folders, globs and buckets, without opening them.

A recording is identified by its URL, size and time of change.
"""

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
from fsspec.implementations.local import LocalFileSystem

from analyze.errors import ArchiveError
from schemas.software import extra_command

SUFFIX, PART_SUFFIX = ".mcap", ".mcap.part"
NUMBERED_NAME = re.compile(r"(?P<stem>.+)-(?P<number>\d{4,})\.mcap")


@dataclass(frozen=True)
class SourceFile:
    """One file of an archive of recordings: URL, size [bytes], stamp (text that changes with the content).

    All are as the listing of its folder or bucket states them.
    """

    url: str
    """a local path, or a URL with its protocol"""
    size: int
    """size of the file [bytes]"""
    stamp: str
    """ETag, hash or time of change, as text; if it differs, the content may have changed; "" if unknown"""


@dataclass(frozen=True)
class Source:
    """One recording: a file, or a series of files with numbered names."""

    files: tuple[SourceFile, ...]
    """files of the recording, at least one, the first of the series first"""

    @property
    def url(self) -> str:
        """URL, or local path, of the recording's first file."""
        return self.files[0].url

    @property
    def size(self) -> int:
        """Size of all files of the recording together [bytes]."""
        return sum(file.size for file in self.files)

    @property
    def id(self) -> str:
        """Hash (32 hexadecimal digits) of URL, size and stamp (time of change or ETag) of the files."""
        text = "\n".join(f"{file.url}\t{file.size}\t{file.stamp}" for file in self.files)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def is_local(self) -> bool:
        """True if the recording is on a disk of this machine."""
        return "://" not in self.url

    def others(self, names: Iterable[str]) -> list[Source]:
        """Files of this numbered series that turned out not to belong to this recording.

        Args:
            names: names of the files that belong to this recording; empty if it was not opened.

        Returns:
            A recording of its own for each file after the first whose name is not in `names`; empty if
            `names` is empty.
        """
        own = set(names)
        return [Source((file,)) for file in self.files[1:] if own and file.url.rsplit("/", 1)[-1] not in own]


def find_sources(places: Sequence[str], exclude: Sequence[str] = ()) -> list[Source]:
    """Find every recording in the given places, each once, in the order of their URLs.

    Files with numbered names (NAME.mcap, NAME-0002.mcap) count as one recording. A `.mcap.part` file (being
    written, or cut short) counts only while the complete file is missing.

    Args:
        places: files, folders (with everything below) and globs; local, or with a protocol that fsspec knows
            (`s3://bucket/folder`).
        exclude: globs of recordings to leave out; matched against the whole URL, the file name, and any
            folders and names below the place ("tests", "2025/*", "*-test.mcap").

    Returns:
        Recordings; empty if all are excluded.

    Raises:
        ArchiveError: a place does not exist, cannot be listed, or contains no recording, or the name of a
            recording is not UTF-8.
    """
    found: dict[str, dict[str, Any]] = {}
    for place in places:
        root, listed = _list_recordings(place, exclude)
        if not listed:
            raise ArchiveError(f"{place}: contains no recording (*.mcap): check the path")
        found.update({url: info for url, info in listed.items() if not _excluded(url, root, exclude)})
    # A `.part` file (being written, or cut short) counts only while the complete file is missing.
    kept = {
        url: info
        for url, info in found.items()
        if not (url.endswith(PART_SUFFIX) and url.removesuffix(".part") in found)
    }
    _refuse_unreadable_names(kept)
    return [_source(urls, kept) for urls in _series(sorted(kept))]


def _refuse_unreadable_names(urls: Iterable[str]) -> None:
    for url in urls:
        if not url.isascii() and any("\ud800" <= sign <= "\udfff" for sign in url):
            raise ArchiveError(f"{url}: its name is not UTF-8: rename it, or leave it out with --exclude")


@dataclass(frozen=True)
class _Place:
    """Place on the command line (file, folder or glob), resolved on its file system."""

    system: fsspec.AbstractFileSystem
    root: str
    """folder that exclusions are relative to: the place itself, or the folder before a glob's wildcards"""
    paths: list[str]
    """files and folders that the place names"""


def _list_recordings(place: str, exclude: Sequence[str]) -> tuple[str, dict[str, dict[str, Any]]]:
    """List the recordings' files in one place.

    Args:
        place: file, folder or glob, as the user gave it.
        exclude: globs of folders that need not be searched; files are not left out here.

    Returns:
        URL of the folder that exclusions are relative to; and file information by URL (size, type, time of
        change).

    Raises:
        ArchiveError: the place does not exist, may not be read, or cannot be listed.
    """
    system, path = file_system(place)
    try:
        resolved = _resolve(place, system, path)
        files = _list_files(resolved, exclude)
    except PermissionError as error:
        where = error.filename if _is_local(system) and error.filename else place
        raise ArchiveError(
            f"{where}: may not be read: check its permissions or the credentials, or leave it out with "
            "--exclude"
        ) from None
    except ArchiveError:
        raise
    except Exception as error:  # every protocol's library raises its own: no network, no credentials
        raise ArchiveError(f"{place}: cannot be listed: {' '.join(str(error).split())}") from None
    # A file that was named itself may have any suffix.
    wanted = {
        name: info
        for name, info in files.items()
        if [name] == resolved.paths == [path] or name.endswith((SUFFIX, PART_SUFFIX))
    }
    urls = {_full_url(system, name): info for name, info in wanted.items() if info["type"] == "file"}
    return _full_url(system, resolved.root), urls


def file_system(place: str) -> tuple[fsspec.AbstractFileSystem, str]:
    """File system of a place (path or URL), and the path in it, which is absolute for a local one.

    Raises:
        ArchiveError: the place is empty, or its protocol is unknown or needs a package that is missing.
    """
    if not place.strip():
        raise ArchiveError("a place is empty: name a folder, a glob or s3://bucket/folder")
    if "://" not in place:
        # fsspec would take "::" in a name for a chain of protocols.
        return LocalFileSystem(), _plain_path(place)
    try:
        system, path = url_to_fs(place)
        return system, _plain_path(path) if _is_local(system) else path
    except ImportError as error:
        protocol = place.split("://", 1)[0]
        remedy = f": {extra_command('s3')}" if protocol == "s3" else ""
        raise ArchiveError(f"{place}: {' '.join(str(error).split())}{remedy}") from None
    except ValueError as error:
        raise ArchiveError(
            f"{place}: {' '.join(str(error).split())}: give a path, or s3://bucket/folder"
        ) from None


def _plain_path(path: str) -> str:
    """Absolute path without "..", so that each file has one URL; ".." after a link to elsewhere stays."""
    given = Path(path).expanduser()
    plain = os.path.abspath(given)  # noqa: PTH100 - Path.absolute keeps ".."
    try:
        return plain if given.samefile(plain) else str(given.absolute())
    except OSError:
        return plain


def _resolve(place: str, system: fsspec.AbstractFileSystem, path: str) -> _Place:
    if any(sign in path for sign in "*?[") and not system.exists(path):
        # The working folder's own name may contain glob characters.
        pattern = str(Path(place).expanduser()) if _is_local(system) and "://" not in place else path
        root = re.split(r"[*?\[]", pattern, maxsplit=1)[0].rpartition("/")[0]
        if not _is_local(system):
            return _Place(system, root, [str(each) for each in system.glob(path)])
        # Path.glob does not follow links.
        found = [_plain_path(each) for each in glob(pattern, recursive=True)]  # noqa: PTH207
        return _Place(system, _plain_path(root or "."), found)
    if not system.exists(path):
        raise ArchiveError(f"{place}: no such file or folder: check the path")
    return _Place(system, path, [path])


def _list_files(place: _Place, exclude: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Size, type and time of change of a place's files and of those below its folders, by path.

    Of local folders only recordings (*.mcap, *.mcap.part) are listed, without the folders that `exclude`
    names; of folders elsewhere (in a bucket) all files.

    Args:
        place: place on the command line.
        exclude: globs of folders to leave out.

    Returns:
        By path, a dict with size [bytes], type ("file" or other) and time of change, as the file system
        gives them.
    """
    files: dict[str, dict[str, Any]] = {}
    local = _is_local(place.system)
    for path in place.paths:
        if not place.system.isdir(path):
            files[path] = _local_info(path) if local else place.system.info(path)
        elif local:
            files.update({name: _local_info(name) for name in _walk(path, place.root, exclude)})
        else:
            files.update(place.system.find(path, detail=True))
    return files


def _walk(folder: str, root: str, exclude: Sequence[str]) -> Iterator[str]:
    """Yield the path of every recording's file (*.mcap, *.mcap.part) below a local folder.

    Links are followed, but no folder is visited twice.

    Args:
        folder: folder to search.
        root: folder that exclusions are relative to.
        exclude: globs of folders to leave out.

    Raises:
        OSError: a folder cannot be read.
    """

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


def _local_info(path: str) -> dict[str, Any]:
    """Size [bytes], time of change [ns] and type ("file" or "other") of a local path.

    A link stands for its target, or for itself if the target is missing.
    """
    try:
        about = Path(path).stat()
    except OSError:
        about = Path(path).lstat()
    kind = "file" if stat.S_ISREG(about.st_mode) or stat.S_ISLNK(about.st_mode) else "other"
    return {"size": about.st_size, "mtime": about.st_mtime_ns, "type": kind}


def _full_url(system: fsspec.AbstractFileSystem, name: str) -> str:
    return name if _is_local(system) else str(system.unstrip_protocol(name))


def _is_local(system: fsspec.AbstractFileSystem) -> bool:
    return isinstance(system, LocalFileSystem)


def _excluded(url: str, root: str, exclude: Sequence[str]) -> bool:
    if not exclude:
        return False
    folder = f"{root.rstrip('/')}/"
    parts = url.removeprefix(folder).split("/") if url.startswith(folder) else []
    below = ["/".join(parts[i:j]) for i in range(len(parts)) for j in range(i + 1, len(parts) + 1)]
    tried = [url, url.rsplit("/", 1)[-1], *below]
    return any(
        fnmatch.fnmatch(each, pattern.removeprefix("./").rstrip("/")) for pattern in exclude for each in tried
    )


def _series(urls: list[str]) -> list[list[str]]:
    """Group URLs by series: NAME.mcap, NAME-0002.mcap, ... belong together if NAME.mcap exists.

    Args:
        urls: sorted URLs.

    Returns:
        Lists of URLs, the first file of each series first, in the order of those first files.
    """
    there = set(urls)
    rows: dict[str, list[str]] = {}
    for url in urls:
        match = NUMBERED_NAME.fullmatch(url)
        first = f"{match['stem']}{SUFFIX}" if match else url
        rows.setdefault(first if first in there else url, []).append(url)
    return [[first, *(url for url in row if url != first)] for first, row in sorted(rows.items())]


def _source(urls: list[str], infos: dict[str, dict[str, Any]]) -> Source:
    return Source(
        tuple(SourceFile(url, int(infos[url].get("size") or 0), _stamp(infos[url])) for url in urls)
    )


def _stamp(info: dict[str, Any]) -> str:
    """ETag of a file, else its MD5 hash or time of change, as text; "" if all are unknown."""
    for name in ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "updated"):
        if info.get(name):
            return str(info[name]).strip('"')
    return ""
