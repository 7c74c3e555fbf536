"""Completes pictures of Motion JPEG to JPEG files (ITU-T T.81) without encoding the images again.

Streaming cameras omit the Huffman tables if they are those of the standard's annex K; some readers need them.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import cache

import av

from schemas.mcap.records import Buffer

JPEG_START = b"\xff\xd8"
_TABLES, _SCAN = 0xC4, 0xDA
FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {_TABLES, 0xC8, 0xCC}
"""markers that may begin a frame header (image size and components), one for each kind of coding"""


def jpeg_file(picture: Buffer) -> tuple[Buffer, int, int] | None:
    """Complete a coded picture to a JPEG file: if it has no Huffman tables, the standard's are added.

    The standard's tables are those of ITU-T T.81, annex K.

    Returns:
        The file (the picture's own buffer if nothing was added), its width and its height [px]; None if no
        frame header or no scan was found: the picture is damaged or no JPEG.
    """
    tables = size = scan = None
    for marker, at, length in _segments(picture):
        if marker in FRAME_MARKERS and length >= 7:
            size = (
                int.from_bytes(picture[at + 3 : at + 5], "big"),
                int.from_bytes(picture[at + 1 : at + 3], "big"),
            )
        tables = at if marker == _TABLES else tables
        scan = at if marker == _SCAN else scan
    if scan is None or size is None:
        return None
    return (picture if tables is not None else JPEG_START + _standard_tables() + bytes(picture[2:])), *size


def _segments(picture: Buffer) -> Iterator[tuple[int, int, int]]:
    """Yield each segment of a JPEG: its marker (kind), and offset and length [bytes] of its content.

    The last one is the first scan header, or the last whole segment before a damaged one. Data that are no
    JPEG have none.
    """
    if bytes(picture[:2]) != JPEG_START:
        return
    at = 2
    while at + 4 <= len(picture) and picture[at] == 0xFF:
        marker = picture[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        length = int.from_bytes(picture[at + 2 : at + 4], "big")
        if length < 2 or at + 2 + length > len(picture):
            return
        yield marker, at + 4, length - 2
        if marker == _SCAN:
            return
        at += 2 + length


@cache
def _standard_tables() -> bytes:
    """JPEG segments with the standard's Huffman tables (ITU-T T.81, annex K), as bytes.

    They are taken from a picture that FFmpeg encodes.
    """
    encoder = av.CodecContext.create("mjpeg", "w")
    assert isinstance(encoder, av.VideoCodecContext)  # noqa: S101 - mjpeg is a video codec
    encoder.width, encoder.height, encoder.pix_fmt, encoder.time_base = 16, 16, "yuvj420p", Fraction(1)
    encoder.options = {"huffman": "default"}
    frame = av.VideoFrame(16, 16, "yuvj420p")
    picture = b"".join(bytes(packet) for given in (frame, None) for packet in encoder.encode(given))
    return b"".join(
        picture[at - 4 : at + length] for marker, at, length in _segments(picture) if marker == _TABLES
    )
