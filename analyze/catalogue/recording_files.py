"""Files of a catalogue's recording: their URLs and the SHA-256 of their bytes."""

from __future__ import annotations

import hashlib

from fsspec.core import url_to_fs

from analyze.catalogue.table import Row

_BLOCK_BYTES = 1 << 22


def file_urls(row: Row) -> list[str]:
    """URLs, or local paths, of a recording's files, the first of the series first."""
    folder = str(row["url"]).rpartition("/")[0]
    return [f"{folder}/{name}" for name in row["files"]]


def file_sha256(url: str) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits.

    Raises:
        OSError: the file cannot be read.
    """
    system, path = url_to_fs(url)
    digest = hashlib.sha256()
    with system.open(path, "rb") as file:
        while block := file.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()
