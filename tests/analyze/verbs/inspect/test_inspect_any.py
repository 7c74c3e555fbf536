"""`analyze inspect` on files of other programs: ROS 2, JSON, protobuf, empty, unindexed, cut, damaged."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.writer import CompressionType, IndexType, Writer

from analyze.cli import main as analyze
from analyze.errors import RecordingError
from analyze.reading.mcap_contents import read_contents
from analyze.verbs.inspect.recording import inspect_recording
from analyze.verbs.inspect.table import render_inspection
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from schemas.terminal import Terminal
from tests.places import FIRST_SAMPLE

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
EVERY_FILE = {
    "path",
    "kind",
    "bytes",
    "complete",
    "growing",
    "profile",
    "library",
    "messages",
    "start_ns",
    "end_ns",
    "duration_s",
    "topics",
    "indexed",
    "compression",
    "publish_delay_s",
    "attachments",
    "metadata",
    "health",
}


def bag(path: Path, profile: str = "ros2", gap_ms: int = 0, late_ms: int = 0, **how) -> Path:
    """Two topics as `ros2 bag record` writes them, 100 and 10 messages a second for 2 s.

    Messages of `gap_ms` are missing in the middle; `late_ms` is the delay of log against publish times.
    """
    how.setdefault("compression", CompressionType.NONE)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096, **how)
        writer.start(profile=profile, library="libmcap 1.3.0")
        channels = {}
        for topic, schema in (("/imu/data", "sensor_msgs/msg/Imu"), ("/tf", "tf2_msgs/msg/TFMessage")):
            channels[topic] = writer.register_channel(
                topic, "cdr", writer.register_schema(schema, "ros2msg", b"float64 x")
            )
        for number in range(200):
            if 1000 <= 10 * number < 1000 + gap_ms:
                continue
            time = T0 + 10 * MS * number
            writer.add_message(channels["/imu/data"], time, bytes(64), time - late_ms * MS, number)
            if number % 10 == 0:
                writer.add_message(channels["/tf"], time, bytes(32), time - late_ms * MS, number)
        writer.add_attachment(T0, T0, "map.pgm", "image/x-portable-graymap", b"P5 1 1 255 0")
        writer.add_metadata("rosbag2", {"ROS_DISTRO": "jazzy"})
        writer.finish()
    return path


def shown(path: Path, width: int = 100) -> str:
    text = io.StringIO()
    render_inspection(inspect_recording(path), Terminal(file=text, width=width))
    return text.getvalue()


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.ZSTD},
        {"use_chunking": False},
        {"index_types": IndexType.CHUNK},
        {
            "index_types": IndexType.MESSAGE,
            "use_statistics": False,
            "repeat_channels": False,
            "repeat_schemas": False,
        },
        {
            "index_types": IndexType.NONE,
            "repeat_channels": False,
            "repeat_schemas": False,
            "compression": CompressionType.ZSTD,
        },
    ],
)
def test_bag_contents_are_listed_for_every_chunking(tmp_path, how):
    found = inspect_recording(bag(tmp_path / "a.mcap", **how))
    json.dumps(found, allow_nan=False)
    assert set(found) == EVERY_FILE
    assert (found["kind"], found["profile"], found["library"], found["messages"]) == (
        "mcap",
        "ros2",
        "libmcap 1.3.0",
        220,
    )
    assert found["duration_s"] == pytest.approx(1.99)
    assert (found["start_ns"], found["end_ns"]) == (T0, T0 + 1990 * MS)
    imu, tf = found["topics"]
    assert (imu["name"], imu["schema"], imu["schema_encoding"], imu["encoding"]) == (
        "/imu/data",
        "sensor_msgs/msg/Imu",
        "ros2msg",
        "cdr",
    )
    assert (imu["count"], tf["count"], imu["channels"], imu["out_of_order"]) == (200, 20, 1, 0)
    assert (imu["rate_hz"], tf["rate_hz"]) == (pytest.approx(100), pytest.approx(10))
    assert found["attachments"] == {"map.pgm": 12}
    assert found["metadata"] == {"rosbag2": {"ROS_DISTRO": "jazzy"}}
    assert found["complete"]
    walked = how.get("index_types", IndexType.ALL) in {IndexType.NONE, IndexType.MESSAGE}
    assert ["no index" in text for text in found["health"]] == [True] * walked


def test_gap_and_late_clock_are_reported(tmp_path):
    path = bag(tmp_path / "a.mcap", gap_ms=300, late_ms=7)
    found = inspect_recording(path)
    imu = found["topics"][0]
    assert imu["median_interval_s"] == pytest.approx(0.01)
    assert imu["longest_gap_s"] == pytest.approx(0.31)
    assert imu["longest_gap_start_ns"] == T0 + 990 * MS
    assert found["publish_delay_s"] == pytest.approx(0.007)
    text = shown(path)
    row = next(line for line in text.splitlines() if line.startswith("/imu/data"))
    assert row.split() == ["/imu/data", "sensor_msgs/msg/Imu", "170", "84.92", "100.00", "0.310", "1.0"]
    assert "logged 7.000 ms after publishing" in text


@pytest.mark.parametrize("width", [44, 60, 80, 100, 200])
def test_table_fits_the_terminal_with_complete_names(tmp_path, width):
    for path in (bag(tmp_path / "a.mcap"), FIRST_SAMPLE):
        lines = shown(path, width).splitlines()
        assert max(len(line.rstrip()) for line in lines) <= width
        for topic in inspect_recording(path)["topics"]:
            assert any(line.split()[:1] == [topic["name"]] for line in lines)


def test_recording_fits_a_screen_of_100_by_40():
    text = shown(FIRST_SAMPLE)
    strikes = sum(line.startswith("s") and "tipped" in line for line in text.splitlines())
    # A usual session has nine strikes and some that rocked back: a dozen.
    assert len(text.splitlines()) + 12 - strikes <= 40


def test_recording_has_the_keys_of_any_file_and_more():
    found = inspect_recording(FIRST_SAMPLE)
    json.dumps(found, allow_nan=False)
    assert set(found) > EVERY_FILE
    assert found["kind"] == "percuss"
    image = found["topics"][0]
    assert (image["encoding"], image["schema_encoding"], image["schema"]) == (
        "protobuf",
        "protobuf",
        "foxglove.CompressedImage",
    )
    assert (
        found["messages"]
        == sum(topic["count"] for topic in found["topics"])
        == read_contents(FIRST_SAMPLE).messages
    )


def test_topics_of_several_publishers_without_a_schema_and_out_of_order(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Pose", "jsonschema", b"{}")
        two = [writer.register_channel("/pose", encoding, schema) for encoding in ("json", "cbor")]
        bare = writer.register_channel("/bare", "json", 0)
        for number in range(4):
            writer.add_message(two[number % 2], T0 + number * MS, b"{}", T0 + number * MS)
            writer.add_message(bare, T0 + (3 - number) * MS, b"{}", T0 + number * MS)
        writer.finish()
    pose, other = inspect_recording(tmp_path / "a.mcap")["topics"]
    assert (pose["channels"], pose["count"], pose["encoding"], pose["out_of_order"]) == (
        2,
        4,
        "json, cbor",
        None,
    )
    assert pose["rate_hz"] == pytest.approx(1000)
    assert (other["schema"], other["out_of_order"]) == ("", 3)
    text = shown(tmp_path / "a.mcap")
    assert "/bare: 3 messages are older than the one before" in text


def test_simulated_time_is_reported(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/clock", "json", 0)
        writer.add_message(channel, 5 * MS, b"{}", 5 * MS)
        writer.finish()
    assert "times begin before the year 2000" in shown(tmp_path / "a.mcap")


def test_empty_file_and_foreign_file(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    found = inspect_recording(tmp_path / "a.mcap")
    assert (found["messages"], found["topics"], found["start_ns"], found["duration_s"]) == (0, [], None, 0.0)
    assert "no topics" in shown(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(b"")
    (tmp_path / "c.mcap").write_bytes(b"SQLite format 3")
    for name, said in (
        ("b.mcap", "is empty"),
        ("c.mcap", "is not a recording"),
        (".", "name a file in it, as a.mcap"),
        ("d", "no such"),
    ):
        done = CliRunner().invoke(analyze, ["inspect", str(tmp_path / name)])
        assert done.exit_code == 1
        assert len(done.stderr.splitlines()) == 1
        assert said in done.stderr


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.999])
@pytest.mark.parametrize("how", [{}, {"compression": CompressionType.ZSTD}, {"use_chunking": False}])
def test_cut_bag_is_listed_up_to_its_end(tmp_path, share, how):
    data = bag(tmp_path / "whole.mcap", **how).read_bytes()
    (tmp_path / "a.mcap").write_bytes(data[: round(share * len(data))])
    found = inspect_recording(tmp_path / "a.mcap")
    assert not found["complete"]
    assert "`acquire recover" in found["health"][0]
    assert 0 <= found["messages"] <= 220
    assert found["messages"] > 200 * (share - 0.15)
    assert "cut short" in shown(tmp_path / "a.mcap")


def test_damage_and_wrong_statistics_are_reported(tmp_path):
    data = bytearray(bag(tmp_path / "whole.mcap", index_types=IndexType.CHUNK).read_bytes())
    chunk = next(
        at for opcode, at, _ in walk(memoryview(data), len(container.MAGIC)) if opcode == container.CHUNK
    )
    data[chunk + 200] ^= 0xFF
    (tmp_path / "a.mcap").write_bytes(data)
    found = inspect_recording(tmp_path / "a.mcap")
    assert found["complete"]
    assert any("damaged: chunk is damaged (CRC)" in text for text in found["health"])
    assert any("its statistics state 220" in text for text in found["health"])


def test_any_damage_raises_only_recording_error(tmp_path):
    rng = np.random.default_rng(4)
    whole = [
        bag(tmp_path / "a.mcap", **how).read_bytes()
        for how in ({"compression": CompressionType.ZSTD}, {"use_chunking": False})
    ]
    for number in range(60):
        data = np.frombuffer(whole[number % 2], np.uint8).copy()
        data[rng.integers(8, len(data), 8)] = rng.integers(0, 256, 8)
        (tmp_path / "b.mcap").write_bytes(data.tobytes())
        try:
            found = inspect_recording(tmp_path / "b.mcap")
        except RecordingError:
            continue
        json.dumps(found, allow_nan=False)
        render_inspection(found, Terminal(file=io.StringIO()))


def test_every_key_of_the_json_is_in_the_guide():
    guide = (FIRST_SAMPLE.parents[1] / "docs" / "how-to" / "inspect.md").read_text(encoding="utf-8")
    found = inspect_recording(FIRST_SAMPLE)
    rows = [row for key in ("topics", "cameras", "clocks", "strikes") for row in found[key][:1]]
    for keys in (
        found,
        found["time_source"],
        found["plan"],
        next(iter(found["compression"].values())),
        *rows,
    ):
        assert [key for key in keys if f"`{key}`" not in guide] == []


@pytest.mark.parametrize("verb", ["inspect", "estimate", "report", "replay"])
def test_a_file_to_import_is_told_so(tmp_path, verb):
    """A video, a folder of images or a bag is no recording yet: `analyze import` makes one."""
    video, images, bag_folder = tmp_path / "s1.mp4", tmp_path / "s1", tmp_path / "bag"
    video.write_bytes(b"\x00\x00\x00\x20ftypisom" + bytes(40))
    images.mkdir()
    (images / "000.png").write_bytes(b"")
    bag_folder.mkdir()
    (bag_folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    (bag_folder / "bag_0.mcap").write_bytes(b"")
    for path, what in ((video, "a video"), (images, "a folder of images"), (bag_folder, "a ROS 2 bag")):
        result = CliRunner().invoke(analyze, [verb, str(path)])
        assert result.exit_code != 0
        assert f"is {what}, not a recording: `analyze import {path.name}`" in result.output


def test_a_folder_of_videos_is_imported_by_its_files(tmp_path):
    """A picture beside them, as `analyze calibrate` writes it, makes it no folder of images."""
    for name in ("VID_1.MP4", "VID_2.MP4", "camera.png"):
        (tmp_path / name).write_bytes(b"")
    result = CliRunner().invoke(analyze, ["report", str(tmp_path)])
    assert result.exit_code == 1
    assert f"is a folder of videos, not a recording: `analyze import {tmp_path.name}/*.MP4`" in result.output


def test_an_object_file_in_place_of_a_recording_is_answered_with_what_writes_one(tmp_path):
    (tmp_path / "b.toml").write_text('name = "b"')
    result = CliRunner().invoke(analyze, ["report", str(tmp_path / "b.toml")])
    assert result.exit_code == 1
    assert (
        "name a .mcap file, as `acquire session`, `acquire demo` and `analyze import` write it"
        in result.output
    )
