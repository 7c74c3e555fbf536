"""Files of a catalogue's recording: their URLs, whether they exist, and the SHA-256 of their bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any

from analyze.batch.archive import Source, file_system, find_sources
from analyze.catalogue.table import Row

_BLOCK_BYTES = 1 << 22


def file_urls(row: Row) -> list[str]:
    """URLs, or local paths, of a recording's files, the first of the series first."""
    folder = str(row["url"]).rpartition("/")[0]
    return [f"{folder}/{name}" for name in row["files"]]


def current_source(urls: Sequence[str]) -> Source:
    """Recording of these files, the first of the series first, with their size and stamp as they are now.

    Raises:
        ArchiveError: a file is not there or cannot be looked up.
    """
    for url in urls:
        if "://" in url:
            file_system(url)[0].invalidate_cache()
    return find_sources(urls)[0]


def file_exists(url: str) -> bool:
    """True if the file is there; a link whose target is missing is not.

    Raises:
        Exception: it cannot be looked up, each protocol's library has its own.
    """
    system, path = file_system(url)
    if "://" not in url:
        return bool(system.exists(path))
    system.invalidate_cache()
    try:
        system.info(path)
    except FileNotFoundError:
        return False
    return True


def read_blocks(url: str) -> Iterator[bytes]:
    """Yield the bytes of a file in blocks of 4 MiB.

    Raises:
        OSError: the file cannot be read.
    """
    system, path = file_system(url)
    file: Any = system.open(path, "rb")
    with file:
        while block := file.read(_BLOCK_BYTES):
            yield block


def file_sha256(url: str) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits.

    Raises:
        OSError: the file cannot be read.
    """
    digest = hashlib.sha256()
    for block in read_blocks(url):
        digest.update(block)
    return digest.hexdigest()
