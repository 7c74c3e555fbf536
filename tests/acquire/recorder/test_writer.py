"""A finished recording is complete, and another implementation of the format reads it."""

from __future__ import annotations

import resource
import threading
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.recorder.image import RawImageEncoder, png_message
from schemas import topics
from schemas.mcap.content_hash import ContentHash
from schemas.proto import percuss_pb2 as pb
from tests.mcap_writer import McapWriter

T0 = 1_700_000_000_000_000_000


def _image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (492, 656), dtype=np.uint8)


def _write(path: Path, frames: int = 5, samples: int = 200):
    writer = McapWriter(path)
    writer.metadata("percuss.manifest", {"json": "{}"})
    writer.attachment("plan.json", "application/json", b"plan")
    encoder = RawImageEncoder("main", 656, 492)
    images = writer.add_topic(topics.raw_image("main"))
    striker = writer.add_topic(topics.STRIKER_SAMPLE)
    for number in range(frames):
        time = T0 + number * 8_333_333
        writer.write(images, time, encoder.encode(time, _image(number)), sequence=number)
    for number in range(samples):
        writer.write(
            striker,
            T0 + number * 1_000_000,
            pb.StrikerSample(tick_ms=number).SerializeToString(),
            sequence=number,
        )
    return writer.finish()


def test_reads_in_the_reference_implementation(tmp_path: Path) -> None:
    seal = _write(tmp_path / "a.mcap")
    assert seal.size == seal.path.stat().st_size
    assert not (tmp_path / "a.mcap.part").exists()
    with seal.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 205 == seal.messages
        assert summary.statistics.channel_message_counts == {1: 5, 2: 200}
        assert [m.name for m in reader.iter_metadata()] == ["percuss.manifest", "percuss.seal"]
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [("plan.json", b"plan")]
        found = list(reader.iter_messages())
    assert [m.log_time for _, _, m in found] == sorted(m.log_time for _, _, m in found)
    images = [m for _, c, m in found if c.topic == "/camera/main/image"]
    for number, message in enumerate(images):
        raw = RawImage.FromString(message.data)
        assert (raw.width, raw.height, raw.step, raw.encoding, raw.frame_id) == (
            656,
            492,
            656,
            "mono8",
            "main",
        )
        assert raw.timestamp.ToNanoseconds() == message.log_time
        assert raw.data == _image(number).tobytes()
        assert message.sequence == number
    assert [
        pb.StrikerSample.FromString(m.data).tick_ms for _, c, m in found if c.topic == "/striker/sample"
    ] == list(range(200))


def test_content_id_is_the_documented_hash(tmp_path: Path) -> None:
    seal = _write(tmp_path / "a.mcap")
    digest = ContentHash()
    with seal.path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            digest.add(channel.topic, message.log_time, len(message.data), message.data)
    assert digest.hexdigest() == seal.content_id
    assert _write(tmp_path / "b.mcap").content_id == seal.content_id
    assert _write(tmp_path / "c.mcap", samples=201).content_id != seal.content_id


def test_png_is_lossless(tmp_path: Path) -> None:
    import cv2

    message = CompressedImage.FromString(png_message("main", T0, _image(1)))
    assert message.format == "png"
    np.testing.assert_array_equal(
        cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED), _image(1)
    )


def test_a_taken_path_is_refused(tmp_path: Path) -> None:
    _write(tmp_path / "a.mcap")
    before = (tmp_path / "a.mcap").read_bytes()
    with pytest.raises(RecorderError, match="exists already"):
        McapWriter(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == before
    (tmp_path / "b.mcap.part").write_bytes(b"")
    with pytest.raises(RecorderError, match="acquire recover"):
        McapWriter(tmp_path / "b.mcap")
    with pytest.raises(RecorderError, match="check the folder"):
        McapWriter(tmp_path / "missing" / "b.mcap")


def test_small_topics_reach_the_file_by_themselves(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap", flush_s=0.02)
    try:
        channel = writer.add_topic(topics.STRIKER_SAMPLE)
        before = writer.part_path.stat().st_size
        writer.write(channel, T0, b"\x18\x01")
        waited = threading.Event()
        for _ in range(200):
            if writer.part_path.stat().st_size > before:
                break
            waited.wait(0.02)
        assert writer.part_path.stat().st_size > before
    finally:
        writer.abort()
    assert writer.part_path.exists()
    assert not writer.path.exists()


def test_an_unset_log_time_is_refused(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap") as writer:
        channel = writer.add_topic(topics.STRIKER_SAMPLE)
        with pytest.raises(RecorderError, match="log time 0"):
            writer.write(channel, 0, b"")


def test_a_full_disk_still_gives_a_whole_recording(tmp_path: Path) -> None:
    """A limit of the file size stands for the full disk; lifting it, for the release of the reserve."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    writer = McapWriter(tmp_path / "a.mcap")
    images = writer.add_topic(topics.raw_image("main"))
    encoder = RawImageEncoder("main", 656, 492)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, hard))
        for number in range(3):
            writer.write(images, T0 + number, encoder.encode(T0 + number, _image(number)), sequence=number)
        with pytest.raises(RecorderError, match=r"a\.mcap\.part: cannot be written.*free space"):
            writer.write(images, T0 + 3, encoder.encode(T0 + 3, _image(3)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    with pytest.raises(RecorderError, match="cannot be written"):
        writer.write(images, T0 + 9, encoder.encode(T0 + 9, _image(9)))
    writer.write(writer.add_topic(topics.STRIKER_SAMPLE), T0 + 10, b"\x18\x01")
    seal = writer.finish()
    assert seal.messages == 4
    with seal.path.open("rb") as file:
        found = list(make_reader(file, validate_crcs=True).iter_messages())
    assert [m.log_time - T0 for _, _, m in found] == [0, 1, 2, 10]


def test_many_threads_write_at_once(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap", flush_s=0.01, sync_bytes=1 << 20)
    encoder = RawImageEncoder("main", 656, 492)
    images = writer.add_topic(topics.raw_image("main"))
    image = _image(0)

    def small(topic: topics.Topic) -> None:
        channel = writer.add_topic(topic)
        for number in range(500):
            writer.write(channel, T0 + number, b"\x18\x01", sequence=number)

    threads = [
        threading.Thread(target=small, args=(topic,))
        for topic in (topics.STRIKER_SAMPLE, topics.CLOCK_SAMPLE, topics.LOG)
    ]
    for thread in threads:
        thread.start()
    for number in range(30):
        writer.write(images, T0 + number, encoder.encode(T0 + number, image), sequence=number)
    for thread in threads:
        thread.join()
    seal = writer.finish()
    with seal.path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == 1530


def test_the_format_overhead_is_negligible(tmp_path: Path) -> None:
    """In a second at full rate, less than 0.1 % of the bytes are not pixels."""
    writer = McapWriter(tmp_path / "a.mcap", sync_bytes=4 << 20)
    images = writer.add_topic(topics.raw_image("main"))
    encoder, image = RawImageEncoder("camera", 656, 492), _image(0)
    for number in range(120):
        writer.write(images, T0 + number, encoder.encode(T0 + number, image), sequence=number)
    seal = writer.finish()
    assert seal.messages == 120
    assert 1.0 < seal.size / (120 * image.size) < 1.001
