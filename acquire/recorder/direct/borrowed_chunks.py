"""Packs MCAP chunks (groups of messages) of one image each, which begins on a page of the file.

Therefore the disk can read the image from the camera's buffer, without a copy.

A record of padding precedes each chunk. Together with the chunk's head, the message's head and the message's
fields before its pixels it fills the file up to the beginning of a page. An image's last bytes, less than a
page, are copied into a page together with the bytes that follow: message index, next padding, next heads.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.checksum import image_checksums
from acquire.recorder.messages import BorrowedImage
from acquire.recorder.recording_file import BorrowedRun
from schemas.mcap import records as container
from schemas.mcap.chunks import pack_chunk_of_one
from schemas.mcap.content_hash import HashedMessage

_ZEROS: Final = bytes(2 * PAGE_BYTES)
_HEADS: Final = container.CHUNK_HEAD + container.MESSAGE_HEAD
_PADDING: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<BQHIQQ")


class BorrowedChunks(NamedTuple):
    """MCAP chunks of one image each, with their index records, and what the content hash needs of them.

    The index records are for the file's summary. The content hash is that of the recording's messages.
    """

    run: BorrowedRun
    """bytes to append to the file: borrowed pages, and the copied bytes around them"""
    size: int
    """bytes in the file"""
    entries: list[bytes]
    """chunk index records for the summary"""
    hashed: list[HashedMessage]
    """the messages as ContentHash takes them"""


def gap_before(at: int) -> int:
    """Size of the padding from offset `at` of a file to the beginning of a page (4096 bytes) [bytes].

    It is 0, or at least the size of a record's head, because the padding is a record; if the next page begins
    too soon for that, the padding goes on to the one after it.
    """
    gap = -at % PAGE_BYTES
    return gap if gap == 0 or gap >= container.RECORD_HEAD else gap + PAGE_BYTES


def pack_borrowed(offset: int, channel_id: int, images: Sequence[BorrowedImage]) -> BorrowedChunks:
    """Pack images from camera buffers into MCAP chunks to be appended to a file that ends at `offset`.

    Of an image only the last bytes, less than a page (4096 bytes), are copied.

    Args:
        offset: size of the file [bytes]; the padding before the first chunk begins there.
        channel_id: id of the images' topic in the file.
        images: at least one image.

    Returns:
        Bytes to append, their number, the chunks' index records for the file's summary, and the images'
        times, sizes and checksums for the recording's content hash.
    """
    at, loose = offset, ()
    own: list[bytes] = []
    pages: list[memoryview] = []
    entries: list[bytes] = []
    hashed: list[HashedMessage] = []
    for time_ns, sequence, prefix, pixels, crc, _ in images:
        count = len(pixels)
        size = len(prefix) + count
        head = _MESSAGE.pack(
            container.MESSAGE, 22 + size, channel_id, sequence & 0xFFFFFFFF, time_ns, time_ns
        )
        in_chunk, in_data = image_checksums(head, prefix, crc, count)
        gap = gap_before(at + _HEADS + len(prefix))
        at += gap
        chunk, index, entry = pack_chunk_of_one(
            at, container.MESSAGE_HEAD + size, in_chunk, channel_id, (time_ns, 0)
        )
        padding = (
            (
                _PADDING.pack(container.PADDING, gap - container.RECORD_HEAD),
                _ZEROS[: gap - container.RECORD_HEAD],
            )
            if gap
            else ()
        )
        own.append(b"".join((*loose, *padding, chunk, head, prefix)))
        whole = count - count % PAGE_BYTES
        pages.append(pixels[:whole])
        loose = (pixels[whole:], index)
        at += _HEADS + size + len(index)
        entries.append(entry)
        hashed.append((time_ns, size, b"", in_data))
    own.append(b"".join(loose))
    run = BorrowedRun(own[0], pages, own[1:], [image.release for image in images])
    return BorrowedChunks(run, at - offset, entries, hashed)
