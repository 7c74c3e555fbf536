"""Checks of a ROS 2 bag before its reader opens it: the reader unpacks and computes without bounds.

Refused are files that are no regular files, compressed files and chunks that unpack to far more than they
hold, and databases whose tables are computed while they are read.
"""

from __future__ import annotations

import contextlib
import mmap
import shutil
import sqlite3
import struct
import tempfile
from pathlib import Path

import zstandard

from schemas.input_file import MAX_TEXT_BYTES, open_file
from schemas.mcap import records as container
from schemas.mcap.chunks import refuse_bomb
from schemas.mcap.records import ContainerError
from schemas.mcap.summary import FOOTER_AND_MAGIC, EndsEarly, find_summary, summary_start
from schemas.mcap.walk import record_at, walk

METADATA = "metadata.yaml"
MAX_MESSAGE_BYTES = 1 << 28
"""largest message that is unpacked, and largest index of a file in MCAP [bytes]"""
MAX_PACKING_RATIO = 1000
"""largest ratio of unpacked to packed bytes of a whole file; images of one grey value reach some hundreds"""
_SQLITE, _ZSTD = b"SQLite format 3\0", b"\x28\xb5\x2f\xfd"
_STEP_BYTES = 1 << 20
_COMPUTED = (
    "SELECT name FROM sqlite_master WHERE type NOT IN ('table', 'index') OR sql LIKE 'create virtual%'",
    "SELECT t.name FROM sqlite_master t, pragma_table_xinfo(t.name) c WHERE t.type = 'table' AND c.hidden",
)
"""queries for views, triggers and virtual tables, and for tables with generated columns"""


def check_bag(path: Path) -> None:
    """Refuse a bag (folder or .db3 file) that would take memory, disk or time without bounds.

    Raises:
        OSError: a file cannot be read, or is a pipe or device.
        ContainerError: a file unpacks to too much, or a database's tables are computed.
    """
    if not path.is_dir():
        _check_file(path)
        return
    metadata = path / METADATA
    if metadata.stat().st_size > MAX_TEXT_BYTES:
        raise ContainerError(f"{METADATA} is larger than {MAX_TEXT_BYTES >> 20} MB")
    for each in sorted(path.iterdir()):
        if not each.is_dir():
            _check_file(each)


def unpacked_message(data: bytes) -> bytes:
    """Content of a message that is compressed by Zstandard.

    Raises:
        ContainerError: it is damaged, or unpacks to more than MAX_MESSAGE_BYTES.
    """
    try:
        stated = zstandard.frame_content_size(data)
        if stated <= MAX_MESSAGE_BYTES:
            most = stated if stated >= 0 else MAX_MESSAGE_BYTES
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=most) if most else b""
    except zstandard.ZstdError as error:
        raise ContainerError(f"a message cannot be unpacked: {error}") from None
    raise ContainerError(f"a message unpacks to more than {MAX_MESSAGE_BYTES >> 20} MB")


def _check_file(path: Path) -> None:
    with open_file(path) as file:
        head = file.read(len(_SQLITE))
    if head.startswith(_ZSTD):
        _check_packed(path)
    else:
        _check_stored(path)


def _check_stored(path: Path) -> None:
    """Check a file of messages, which is not packed as a whole."""
    with open_file(path) as file:
        head = file.read(len(_SQLITE))
    if head.startswith(container.MAGIC):
        _check_mcap(path)
    elif head == _SQLITE:
        _check_database(path)


def _check_packed(path: Path) -> None:
    """Unpack a whole file, as far as it may be unpacked, and check what is in it."""
    most = min(
        max(MAX_MESSAGE_BYTES, MAX_PACKING_RATIO * path.stat().st_size),
        shutil.disk_usage(tempfile.gettempdir()).free // 2,
    )
    size = 0
    try:
        with (
            open_file(path) as file,
            zstandard.ZstdDecompressor().stream_reader(file) as stream,
            tempfile.NamedTemporaryFile(suffix=path.stem) as unpacked,
        ):
            while size <= most and (part := stream.read(_STEP_BYTES)):
                size += len(part)
                unpacked.write(part)
            unpacked.flush()
            if size <= most:
                _check_stored(Path(unpacked.name))
    except zstandard.ZstdError as error:
        raise ContainerError(f"{path.name} cannot be unpacked: {error}") from None
    if size > most:
        raise ContainerError(
            f"{path.name} unpacks to more than {most / 1e6:.0f} MB, the most for its size and the free disk"
        )


def _check_database(path: Path) -> None:
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    with contextlib.closing(database):
        for query in _COMPUTED:
            if (computed := database.execute(query).fetchone()) is not None:
                raise ContainerError(f"{path.name} computes {computed[0]!r} while it is read: no bag does")
        largest = database.execute("SELECT max(length(data)) FROM messages").fetchone()[0]
    if isinstance(largest, int) and largest > MAX_MESSAGE_BYTES:
        raise ContainerError(f"{path.name} holds a message of {largest / 1e6:.0f} MB")


def _check_mcap(path: Path) -> None:
    with open_file(path) as file:
        data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    try:
        size = len(data) - summary_start(data[-FOOTER_AND_MAGIC:], len(data))[0]
        if size > MAX_MESSAGE_BYTES:
            raise ContainerError(f"{path.name} has an index of {size / 1e6:.0f} MB")
        section = find_summary(data)
    except EndsEarly:  # the reader then takes all records in order
        records = walk(data, len(container.MAGIC))
        offsets = [at for opcode, at, _ in records if opcode == container.CHUNK]
    else:
        offsets = [
            struct.unpack_from("<Q", body, 16)[0]
            for opcode, _, body in walk(section.records)
            if opcode == container.CHUNK_INDEX and len(body) >= 24
        ]
    for offset in offsets:
        chunk = container.parse_chunk(record_at(data, offset, container.CHUNK))
        if chunk.compression:
            refuse_bomb(chunk)
