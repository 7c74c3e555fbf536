"""Messages of video to coded pictures: foxglove.CompressedVideo wants a whole one in each, which not every program heeds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from analyze.reading.annex_b import holds_parameter_sets, is_annex_b, is_keyframe, slices
from analyze.reading.compressed_video import video_format
from analyze.sources.message_files import Logged
from analyze.sources.pictures import CodedPicture
from schemas.mcap.records import ContainerError

Unit = tuple[Logged, CodedPicture]
"""a picture, and the message that it came in, or its first part"""


def video_units(messages: Iterable[Unit]) -> Iterator[Unit]:
    """Whole pictures, from the first on with which a decoder may begin: a key picture with its parameter sets.

    Args:
        messages: in the order in which they were written.

    Raises:
        ContainerError: what they hold is no picture, or are several in one message.
    """
    begun = False
    for logged, picture in _joined(messages):
        video = video_format(picture.format)
        begun = begun or (is_keyframe(video, picture.data) and holds_parameter_sets(video, picture.data))
        if begun:
            yield logged, picture


def _joined(messages: Iterable[Unit]) -> Iterator[Unit]:
    """Pictures of the parts that some messages hold: parameter sets go with the next slice, further slices with the one before."""
    ahead, whole = b"", None
    for logged, part in messages:
        if not is_annex_b(part.data):
            raise ContainerError("a message does not begin with a start code (Annex B): record whole pictures, one in each message")
        begins = slices(video_format(part.format), part.data)
        if sum(begins) > 1:
            raise ContainerError(f"a message holds {sum(begins)} pictures, of which it times one: record one in each message")
        if any(begins):
            if whole is not None:
                yield whole
            whole, ahead = (logged, replace(part, data=ahead + part.data)), b""
        elif begins and whole is not None:
            whole = whole[0], replace(whole[1], data=whole[1].data + part.data)
        elif not begins:
            ahead += part.data
    if whole is not None:
        yield whole
