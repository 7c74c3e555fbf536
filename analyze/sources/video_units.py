"""Assembles whole coded pictures from the messages of a video topic.

foxglove.CompressedVideo requires one whole picture per message, but some programs split pictures.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from analyze.reading.annex_b import holds_parameter_sets, is_annex_b, is_keyframe, slice_starts
from analyze.reading.compressed_video import video_format
from analyze.sources.message_files import LoggedMessage
from analyze.sources.pictures import CodedPicture
from schemas.mcap.records import ContainerError

Unit = tuple[LoggedMessage, CodedPicture]
"""message of a video, and the picture or the part of a picture in it; once assembled, a whole picture with
the message that contains its first part"""


def video_units(messages: Iterable[Unit]) -> Iterator[Unit]:
    """Yield whole coded pictures with their messages, from the first one where a decoder can begin.

    That is the first key picture with parameter sets; earlier ones are left out. A picture that was split
    over messages comes with the message of its first part.

    Args:
        messages: messages in the order in which they were written, each with a picture or a part of one.

    Raises:
        ContainerError: a message does not begin with a start code, contains several pictures, or is of an
            unknown format.
    """
    begun = False
    for logged, picture in _assembled(messages):
        video = video_format(picture.format)
        begun = begun or (is_keyframe(video, picture.data) and holds_parameter_sets(video, picture.data))
        if begun:
            yield logged, picture


def _assembled(messages: Iterable[Unit]) -> Iterator[Unit]:
    """Yield whole coded pictures, assembled from messages that contain parts of them.

    Messages without a slice (part of the image), which hold parameter sets, are put before the next picture.
    Slices that begin no picture are appended to the previous picture; before the first they are left out.
    A picture comes with the message of its first slice.

    Raises:
        ContainerError: a message does not begin with a start code, contains several pictures, or is of an
            unknown format.
    """
    ahead, whole = b"", None
    for logged, part in messages:
        if not is_annex_b(part.data):
            raise ContainerError(
                "a message does not begin with a start code (Annex B): record one whole picture in each "
                "message"
            )
        begins = slice_starts(video_format(part.format), part.data)
        if sum(begins) > 1:
            raise ContainerError(
                f"a message contains {sum(begins)} pictures but one time: record one in each message"
            )
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
