"""Foxglove MCAP files and ROS 2 bags as sources.

Every encoding yields the same images at the headers' times; unreadable files give one line.
"""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin

from analyze.errors import ImportRefused
from analyze.sources.pictures import grey_values, is_readable, parse_picture
from analyze.sources.topic_source import TopicSource
from schemas.mcap.records import ContainerError
from schemas.session_manifest import TimeSource
from tests.analyze.importing.foreign_files import (
    FRAME_NS,
    LOGGED_LATER_NS,
    ROS,
    START_NS,
    images,
    ros_header,
    times,
    write_bag,
    write_foxglove,
)

RAW = [
    "mono8",
    "8UC1",
    "mono16",
    "rgb8",
    "bgr8",
    "8UC3",
    "rgba8",
    "bgra8",
    "uyvy",
    "yuv422",
    "yuyv",
    "yuv422_yuy2",
    "nv12",
]
MOSAICS = ["bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"]


def same(source, expected, most=0):
    found = list(source.frames())
    assert [frame.time_ns for frame in found] == [i * FRAME_NS for i in range(len(expected))]
    assert (
        max(
            int(np.abs(frame.image.astype(int) - image).max())
            for frame, image in zip(found, expected, strict=True)
        )
        <= most
    )
    assert (source.width, source.height, source.frame_count) == (
        expected[0].shape[1],
        expected[0].shape[0],
        len(expected),
    )
    assert source.time_source is TimeSource.CONTAINER_PTS
    assert source.wall_start_ns == START_NS
    assert source.time_sd_ns == 1000
    assert source.remarks == ()


@pytest.mark.parametrize("kind", [*RAW, "png", "json"])
def test_foxglove_files(tmp_path, kind):
    same(TopicSource(write_foxglove(tmp_path / "a.mcap", images(), kind)), images())


@pytest.mark.parametrize("kind", [*MOSAICS, "jpeg", "h264"])
def test_foxglove_files_with_lossy_grey_values(tmp_path, kind):
    same(TopicSource(write_foxglove(tmp_path / "a.mcap", images(), kind)), images(), most=3)


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("kind", ["mono8", "bgr8", "png"])
def test_ros_bags(tmp_path, storage, kind):
    bag = write_bag(tmp_path / "bag", images(), kind, storage)
    same(TopicSource(bag), images())
    (alone,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    same(TopicSource(alone), images())


def test_a_bag_with_compressed_messages(tmp_path):
    same(
        TopicSource(write_bag(tmp_path / "bag", images(), storage=StoragePlugin.SQLITE3, compressed=True)),
        images(),
    )


@pytest.mark.parametrize("write", [write_foxglove, write_bag])
def test_range_of_a_topic(tmp_path, write):
    source = TopicSource(
        write(tmp_path / "a.mcap" if write is write_foxglove else tmp_path / "bag", images())
    )
    assert [frame.time_ns // FRAME_NS for frame in source.frames(3 * FRAME_NS, 5 * FRAME_NS)] == [3, 4, 5]
    assert [frame.time_ns // FRAME_NS for frame in source.frames(9 * FRAME_NS + 1)] == [10, 11]


def test_range_of_a_video_topic(tmp_path):
    source = TopicSource(write_foxglove(tmp_path / "a.mcap", images(), "h264"))
    found = list(source.frames(3 * FRAME_NS, 7 * FRAME_NS))
    assert [frame.time_ns // FRAME_NS for frame in found] == [3, 4, 5, 6, 7]
    assert np.abs(found[0].image.astype(int) - images()[3]).max() < 4


@pytest.mark.parametrize(("stamps", "why"), [([0] * 12, "are not set"), (times(12)[::-1], "do not increase")])
def test_log_times_are_used_without_valid_header_stamps(tmp_path, stamps, why):
    source = TopicSource(write_foxglove(tmp_path / "a.mcap", images(), stamps=stamps))
    assert source.time_source is TimeSource.HOST_ARRIVAL
    assert source.wall_start_ns == START_NS + LOGGED_LATER_NS
    assert [frame.time_ns for frame in source.frames()] == [i * FRAME_NS for i in range(12)]
    assert source.remarks == (f"a.mcap:/cam/image: its header stamps {why}: log times are used, ± 0.001 ms",)


def test_images_with_decreasing_stamps_are_left_out(tmp_path):
    stamps = times(230)
    stamps[220] = stamps[218]
    source = TopicSource(write_foxglove(tmp_path / "a.mcap", images(230, 16, 12), stamps=stamps))
    assert [frame.time_ns // FRAME_NS for frame in source.frames()] == [i for i in range(230) if i != 220]
    assert source.remarks == (
        "a.mcap:/cam/image: left out: 1 image with a stamp earlier than a previous one",
    )


def test_time_sd_from_the_unevenness_of_frames(tmp_path):
    rng = np.random.default_rng(2)
    stamps = [stamp + round(each) for stamp, each in zip(times(200), rng.normal(0, 3e5, 200), strict=True)]
    source = TopicSource(write_foxglove(tmp_path / "a.mcap", images(200, 16, 12), stamps=stamps))
    assert source.time_sd_ns == pytest.approx(3e5, rel=0.2)


@pytest.mark.parametrize("write", [write_foxglove, write_bag])
def test_calibration_from_the_file(tmp_path, write):
    source = TopicSource(
        write(tmp_path / "a.mcap" if write is write_foxglove else tmp_path / "bag", images())
    )
    spec, topic = source.calibration()
    assert (spec.width, spec.height, spec.K[0][0], spec.distortion[0]) == (64, 48, 300.0, -0.1)
    assert topic == ("/cam/calibration" if write is write_foxglove else "/cam/camera_info")


def test_file_without_calibration_gives_none(tmp_path):
    assert TopicSource(write_foxglove(tmp_path / "a.mcap", images(), calibrated=False)).calibration() is None


def test_topic_must_be_chosen_among_several(tmp_path):
    path = write_foxglove(tmp_path / "a.mcap", images(), more=("/left/image", "/right/image"))
    with pytest.raises(
        ImportRefused,
        match=r"contains 3 topics of images: choose one with --topic: /cam/image, /left/image, /right/image$",
    ):
        TopicSource(path)
    same(TopicSource(path, "/cam/image"), images())
    with pytest.raises(
        ImportRefused, match=r"--topic /up: no such topic: it has /cam/image, /left/image, /right/image$"
    ):
        TopicSource(path, "/up")
    with pytest.raises(
        ImportRefused,
        match=r"--topic /cam/calibration: its messages are foxglove.CameraCalibration, not readable images",
    ):
        TopicSource(path, "/cam/calibration")
    with pytest.raises(ImportRefused, match=r"a.mcap:/left/image: contains 1 image: a strike needs more"):
        TopicSource(path, "/left/image")


def refused(path, said):
    with pytest.raises(ImportRefused, match=said) as caught:
        list(TopicSource(path).frames())
    assert "\n" not in str(caught.value)
    assert str(path.name) in str(caught.value)


def test_unreadable_file_is_one_line(tmp_path):
    whole = write_foxglove(tmp_path / "whole.mcap", images()).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    refused(
        tmp_path / "cut.mcap",
        "not an MCAP file, damaged, or cut short: try `mcap recover cut.mcap -o NEW.mcap`",
    )
    with (tmp_path / "bare.mcap").open("wb") as file:
        writer = McapWriter(
            file,
            index_types=IndexType.NONE,
            repeat_channels=False,
            repeat_schemas=False,
            use_statistics=False,
        )
        writer.start()
        writer.add_message(writer.register_channel("/cam/image", "protobuf", 0), START_NS, b"", START_NS)
        writer.finish()
    refused(
        tmp_path / "bare.mcap",
        "contains no index, or no messages: rewrite it with `mcap recover bare.mcap -o NEW.mcap`",
    )
    (tmp_path / "words.mcap").write_text("words")
    refused(tmp_path / "words.mcap", "not an MCAP file")
    (tmp_path / "words.db3").write_text("words")
    refused(tmp_path / "words.db3", "not a readable ROS 2 bag")
    refused(
        write_foxglove(tmp_path / "depth.mcap", images(), "32FC1"),
        "encoding '32FC1' is not supported: mono8, mono16",
    )
    bag = write_bag(tmp_path / "bag", images())
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: 7")
    refused(bag, "not a readable ROS 2 bag")


def test_an_image_of_another_size_is_named(tmp_path):
    refused(
        write_foxglove(tmp_path / "a.mcap", [*images(5), *images(1, 32, 32)]),
        r"an image at 0.042 s has 32 x 32 px, the first 64 x 48",
    )


KINDS = [
    (encoding, schema)
    for encoding in ("protobuf", "json", "cdr")
    for schema in (
        "foxglove.RawImage",
        "foxglove.CompressedImage",
        "foxglove.CompressedVideo",
        "sensor_msgs/msg/Image",
        "sensor_msgs/msg/CompressedImage",
    )
    if is_readable(encoding, schema)
]


def ros_image():
    message = ROS.types["sensor_msgs/msg/Image"](
        header=ros_header(START_NS),
        height=4,
        width=4,
        encoding="mono8",
        is_bigendian=0,
        step=4,
        data=np.zeros(16, np.uint8),
    )
    return bytes(ROS.serialize_cdr(message, "sensor_msgs/msg/Image"))


@settings(max_examples=200, derandomize=True, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    data=st.binary(max_size=80)
    | st.tuples(st.just(ros_image()), st.integers(0, 80), st.binary(max_size=4)).map(
        lambda t: t[0][: t[1]] + t[2] + t[0][t[1] + len(t[2]) :]
    ),
)
def test_any_message_is_an_image_or_a_named_error(kind, data):
    with contextlib.suppress(ContainerError):
        picture = parse_picture(*kind, data)
        assert grey_values(picture).ndim == 2
