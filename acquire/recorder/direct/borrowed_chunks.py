"""Chunks of one image each, packed so that every image's pixels begin on a page of the file and can be written from where they lie.

Before each chunk stands, outside of it, a record of padding, so that with the chunk's head, the message's head and the message's fields
before its pixels it ends with a page. An image's last bytes, less than a page, are copied into the page that holds what follows: the
message index, the next padding and the next heads.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from acquire.recorder.checksum import joined
from acquire.recorder.data_file import LentRun
from acquire.recorder.messages import LentImage
from acquire.recorder.page_memory import PAGE
from schemas.mcap import records as container
from schemas.mcap.records import Buffer
from schemas.mcap.summary import pack_chunk_of_one

_ZEROS: Final = bytes(2 * PAGE)
_HEADS: Final = container.CHUNK_HEAD + container.MESSAGE_HEAD
_PADDING: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<BQHIQQ")


class LentChunks(NamedTuple):
    """What goes to the file, and what is to be known of it."""

    run: LentRun
    size: int
    entries: list[bytes]
    """chunk index records for the summary"""
    identity: list[tuple[int, int, Buffer, int | None]]
    """of each message what ContentHash asks for"""


def gap_before(at: int) -> int:
    """Bytes of padding, none or a whole record, that bring what would stand at `at` to the beginning of a page."""
    gap = -at % PAGE
    return gap if gap == 0 or gap >= container.RECORD_HEAD else gap + PAGE


def pack_lent(offset: int, channel_id: int, images: Sequence[LentImage]) -> LentChunks:
    """Pack at least one image for a file that ends at `offset`."""
    at, loose = offset, ()
    own: list[bytes] = []
    lent: list[memoryview] = []
    entries: list[bytes] = []
    identity: list[tuple[int, int, Buffer, int | None]] = []
    for time_ns, sequence, prefix, pixels, crc, _ in images:
        count = len(pixels)
        size = len(prefix) + count
        head = _MESSAGE.pack(container.MESSAGE, 22 + size, channel_id, sequence & 0xFFFFFFFF, time_ns, time_ns)
        in_chunk, in_data = joined(head, prefix, crc, count)
        gap = gap_before(at + _HEADS + len(prefix))
        at += gap
        chunk, index, entry = pack_chunk_of_one(at, container.MESSAGE_HEAD + size, in_chunk, channel_id, (time_ns, 0))
        padding = (_PADDING.pack(container.PADDING, gap - container.RECORD_HEAD), _ZEROS[: gap - container.RECORD_HEAD]) if gap else ()
        own.append(b"".join((*loose, *padding, chunk, head, prefix)))
        whole = count - count % PAGE
        lent.append(pixels[:whole])
        loose = (pixels[whole:], index)
        at += _HEADS + size + len(index)
        entries.append(entry)
        identity.append((time_ns, size, b"", in_data))
    own.append(b"".join(loose))
    return LentChunks(LentRun(own[0], lent, own[1:], [image.release for image in images]), at - offset, entries, identity)
