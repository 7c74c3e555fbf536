"""Video in message files of other programs.

With any order, split or start, images get their own times, or one line states the reason.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import av
import foxglove
import numpy as np
import pytest
from foxglove.channels import CompressedVideoChannel
from foxglove.messages import CompressedVideo, Timestamp

from analyze.errors import ImportRefused
from analyze.sources.topic_source import TopicSource
from tests.analyze.importing.foreign_files import FRAME_NS, START_NS

COUNT = 30
SLICES = {0x41, 0x65, 0x02, 0x28, 0x2A}
"""first byte of NAL units, of either codec, that contain a part of a picture"""
CODECS = {
    "h264": ("libx264", "x264-params", "annexb=1:"),
    "h265": ("libx265", "x265-params", "log-level=none:"),
}


@cache
def images():
    """Images of a bright bar that moves to the right, before a ramp."""
    ramp = np.tile(np.linspace(40, 120, 64), (48, 1))
    found = []
    for number in range(COUNT):
        image = ramp.copy()
        image[10:38, 2 * number : 2 * number + 6] = 200
        found.append(np.rint(image).astype(np.uint8))
    return found


@cache
def coded(kind="h264", b_frames=0, more=""):
    """List of (number of the image, access unit) in decoding order."""
    name, key, params = CODECS[kind]
    encoder = av.CodecContext.create(name, "w")
    assert isinstance(encoder, av.VideoCodecContext)
    encoder.width, encoder.height, encoder.pix_fmt, encoder.time_base = 64, 48, "yuv420p", Fraction(1, 120)
    options = f"{params}repeat-headers=1:bframes={b_frames}:keyint=10:min-keyint=10:scenecut=0{more}"
    encoder.options = {"crf": "8", key: options}
    found = []
    for number, image in enumerate([*images(), None]):
        frame = None
        if image is not None:
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(
                format="yuv420p", dst_color_range="JPEG"
            )
            frame.pts = number
        found += [(packet.pts, bytes(packet)) for packet in encoder.encode(frame)]
    return found


def written(path, messages, kind="h264"):
    """MCAP file with (stamp, log time, data) in this order; times in frames, a stamp may be None."""
    context = foxglove.Context()
    with foxglove.open_mcap(path, context=context):
        channel = CompressedVideoChannel("/cam/video", context=context)
        for stamp, log, data in messages:
            stamp_ns = 0 if stamp is None else START_NS + round(stamp * FRAME_NS)
            timestamp = Timestamp(stamp_ns // 10**9, stamp_ns % 10**9)
            channel.log(
                CompressedVideo(timestamp=timestamp, format=kind, data=data),
                log_time=START_NS + round(log * FRAME_NS),
            )
    return path


def same(source, first=0):
    found = [(frame.time_ns, frame.image.copy()) for frame in source.frames()]
    assert [time_ns for time_ns, _ in found] == [number * FRAME_NS for number in range(COUNT - first)]
    off = [
        int(np.abs(image.astype(int) - drawn).max())
        for (_, image), drawn in zip(found, images()[first:], strict=True)
    ]
    assert max(off) < 25, "a bar at another place is off by 80"
    assert source.rate_hz == pytest.approx(1e9 / FRAME_NS)
    some = [frame.time_ns // FRAME_NS for frame in source.frames(7 * FRAME_NS, 13 * FRAME_NS)]
    assert some == list(range(7, 14))


def refused(path, said):
    with pytest.raises(ImportRefused, match=said) as caught:
        list(TopicSource(path).frames())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", CODECS)
def test_b_frames_stamped_in_display_order(tmp_path, kind):
    messages = [(shown, at + 5, data) for at, (shown, data) in enumerate(coded(kind, 3))]
    assert [shown for shown, _, _ in messages] != sorted(shown for shown, _, _ in messages)
    same(TopicSource(written(tmp_path / "a.mcap", messages, kind)))


def test_b_frames_logged_in_display_order(tmp_path):
    same(TopicSource(written(tmp_path / "a.mcap", [(None, shown, data) for shown, data in coded("h264", 3)])))


def test_b_frames_stamped_in_decoding_order_are_refused(tmp_path):
    path = written(tmp_path / "a.mcap", [(at, at + 1, data) for at, (_, data) in enumerate(coded("h264", 3))])
    refused(
        path, "contains B-frames, which foxglove.CompressedVideo forbids, .* record it again without B-frames"
    )


def test_b_frames_that_begin_late_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.sources.topic_source.EXAMINED_MESSAGES", 10)
    units = [*coded()[:10], *coded("h264", 3)[10:]]
    refused(
        written(tmp_path / "a.mcap", [(at, at + 1, data) for at, (_, data) in enumerate(units)]),
        "contains B-frames",
    )


def test_b_frames_sorted_by_time_are_refused(tmp_path):
    path = written(
        tmp_path / "a.mcap", [(shown, shown, data) for shown, data in sorted(coded("h265", 3))], "h265"
    )
    refused(
        path, "of its first 30 pictures can be decoded in the file's order: its messages were sorted by time"
    )


def parts(data):
    """NAL units of an access unit, each with its start code."""
    return [b"\x00\x00\x01" + unit.removesuffix(b"\x00") for unit in data.split(b"\x00\x00\x01")[1:]]


@pytest.mark.parametrize(("kind", "slices"), [("h264", ":slices=3"), ("h265", "")])
def test_pictures_split_over_several_messages(tmp_path, kind, slices):
    """Parameter sets, SEI and slices in separate messages; a picture has the time of its first slice."""
    units = coded(kind, 0, slices)
    split = [
        (shown - (part[3] not in SLICES) / 9, shown + 1, part)
        for shown, data in units
        for part in parts(data)
    ]
    assert len(split) > COUNT + 8
    same(TopicSource(written(tmp_path / "a.mcap", split, kind)))


def test_topic_that_begins_between_two_key_pictures(tmp_path):
    messages = [(shown, shown + 1, data) for shown, data in coded()[3:]]
    source = TopicSource(written(tmp_path / "a.mcap", messages))
    same(source, first=10)
    assert source.remarks == (
        "a.mcap:/cam/video: its first 0.06 s are left out: they have no key picture to begin with",
    )
    assert source.wall_start_ns == START_NS + 10 * FRAME_NS


def test_video_without_a_decodable_start_is_one_line(tmp_path):
    bare = [
        (shown, shown, b"".join(part for part in parts(data) if part[3] & 31 in {1, 5}))
        for shown, data in coded()
    ]
    refused(
        written(tmp_path / "bare.mcap", bare),
        "no key picture contains the parameter sets that a decoder needs: record them",
    )
    late = [(shown, shown, data) for shown, data in coded()[1:9]]
    refused(written(tmp_path / "late.mcap", late), "no key picture contains the parameter sets")


def test_message_without_a_picture_is_one_line(tmp_path):
    units = [data for _, data in coded()]
    pairs = [(at, at, units[at] + units[at + 1]) for at in range(0, COUNT, 2)]
    refused(written(tmp_path / "pairs.mcap", pairs), "a message contains 2 pictures but one time")
    lengths = [(at, at, len(data).to_bytes(4, "big") + data[4:]) for at, data in enumerate(units)]
    refused(written(tmp_path / "lengths.mcap", lengths), r"does not begin with a start code \(Annex B\)")
    refused(
        written(tmp_path / "still.mcap", [(None, 0, data) for data in units]),
        "all its messages have the same time",
    )
    others = [(at, at, data) for at, data in enumerate(units)]
    refused(
        written(tmp_path / "vp9.mcap", others, "vp9"),
        "video of format 'vp9' cannot be read, only h264 and h265",
    )
