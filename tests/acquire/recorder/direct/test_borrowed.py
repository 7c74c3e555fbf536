"""Images written from borrowed buffers: the same messages as copied ones, and every buffer released once."""

from __future__ import annotations

import errno
import json
import os
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from acquire.errors import RecorderError
from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.direct import direct_file
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.borrowed_chunks import gap_before
from acquire.recorder.direct.direct_file import RESERVE_BYTES, can_write_directly
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.messages import DiskBehind
from acquire.recorder.recover.edit import append_topics, remove_topics
from acquire.recorder.recover.recover import recover
from acquire.recorder.writer import McapWriter
from analyze.reading.followed_recording import FollowedRecording
from analyze.reading.recording import Recording, open_partial, open_recording
from schemas import topics
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from schemas.proto import percuss_pb2 as pb
from tests import small_recording as small
from tests.acquire.recorder.direct.counting_buffer import (
    PERIOD_NS,
    T0,
    CountingBuffer,
    borrowed_image,
    image_of,
)

IMAGE_TOPIC = "/camera/main/image"
WIDTH, HEIGHT = 331, 67
"""22177 bytes: five pages and a piece"""


@pytest.fixture
def memory(tmp_path: Path) -> Iterator[BlockMemory]:
    if not can_write_directly(tmp_path):
        pytest.skip("this file system takes no O_DIRECT")
    memory = BlockMemory(8 << 20, 64 << 20)
    yield memory
    assert memory.free == memory.blocks, "every block was given back"
    assert memory.used_bytes == 0, "all that was borrowed too"


def _write(
    path: Path, memory: BlockMemory | None, batches: list[int], width: int, height: int, between: list[int]
) -> list[CountingBuffer]:
    """Write a recording with a small message of `between[n]` bytes after the nth batch of images."""
    buffers: list[CountingBuffer] = []
    with McapWriter(path, memory, flush_s=60.0) as writer:
        images, small_topic = (
            writer.add_topic(topics.raw_image("main")),
            writer.add_topic(topics.STRIKER_SAMPLE),
        )
        for count, size in zip(batches, between, strict=True):
            batch = [
                CountingBuffer(image_of(width, height, number))
                for number in range(len(buffers), len(buffers) + count)
            ]
            writer.write_borrowed(
                images, [borrowed_image(buffer, number) for number, buffer in enumerate(batch, len(buffers))]
            )
            buffers += batch
            writer.write(small_topic, T0 + len(buffers) * PERIOD_NS, bytes(size), sequence=len(buffers))
            writer.flush()
    return buffers


def _images(path: Path) -> dict[int, np.ndarray]:
    found: dict[int, np.ndarray] = {}
    with path.open("rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(
            topics=[IMAGE_TOPIC], log_time_order=False
        ):
            assert message.log_time == T0 + message.sequence * PERIOD_NS
            raw = RawImage.FromString(message.data)
            found[message.sequence] = np.frombuffer(raw.data, np.uint8).reshape(raw.height, raw.width)
    return found


def _check_images(found: dict[int, np.ndarray], count: int, width: int = WIDTH, height: int = HEIGHT) -> None:
    assert list(found) == list(range(count))
    for number, image in found.items():
        np.testing.assert_array_equal(image, image_of(width, height, number))


def _on_pages(path: Path, width: int, height: int, count: int) -> None:
    data = path.read_bytes()
    at = [data.find(image_of(width, height, number).tobytes()) for number in range(count)]
    assert all(place > 0 and place % PAGE_BYTES == 0 for place in at)


@given(at=st.integers(0, 1 << 40))
def test_padding_is_a_whole_record_or_none(at: int) -> None:
    gap = gap_before(at)
    assert (at + gap) % PAGE_BYTES == 0
    assert gap == 0 or container.RECORD_HEAD <= gap < PAGE_BYTES + container.RECORD_HEAD
    if gap:
        [(opcode, found, body)] = walk(
            memoryview(container.pack_record(container.PADDING, bytes(gap - container.RECORD_HEAD)))
        )
        assert (opcode, found, container.RECORD_HEAD + len(body)) == (container.PADDING, 0, gap)


@settings(max_examples=25, deadline=None)
@given(
    size=st.integers(PAGE_BYTES, 3 * PAGE_BYTES + 100),
    batches=st.lists(st.integers(1, 5), min_size=1, max_size=4),
    between=st.lists(st.integers(0, 5000), min_size=4, max_size=4),
    direct=st.booleans(),
)
def test_any_message_sizes_read_back_unchanged(
    size: int, batches: list[int], between: list[int], direct: bool
) -> None:
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:
        path = Path(folder) / "a.mcap"
        memory = BlockMemory(8 << 20, 64 << 20) if direct and can_write_directly(path.parent) else None
        buffers = _write(path, memory, batches, size, 1, between[: len(batches)])
        assert [(buffer.borrows, buffer.released) for buffer in buffers] == [(0, 1)] * sum(batches)
        assert memory is None or (memory.free, memory.used_bytes) == (memory.blocks, 0)
        _check_images(_images(path), sum(batches), size, 1)
        _on_pages(path, size, 1, sum(batches))


def test_content_is_the_same_as_when_it_is_copied(tmp_path: Path, memory: BlockMemory) -> None:
    _write(tmp_path / "a.mcap", memory, [3, 1, 12], WIDTH, HEIGHT, [5, 70_000, 9])
    encoder = RawImageEncoder("camera", WIDTH, HEIGHT)
    with McapWriter(tmp_path / "b.mcap", memory, flush_s=60.0) as writer:
        images, small_topic = (
            writer.add_topic(topics.raw_image("main")),
            writer.add_topic(topics.STRIKER_SAMPLE),
        )
        for number in range(16):
            time_ns = T0 + number * PERIOD_NS
            writer.write(
                images, time_ns, encoder.encode(time_ns, image_of(WIDTH, HEIGHT, number)), sequence=number
            )
            if number in {2, 3, 15}:
                writer.write(
                    small_topic,
                    time_ns + PERIOD_NS,
                    bytes({2: 5, 3: 70_000, 15: 9}[number]),
                    sequence=number + 1,
                )
    messages: list[list[tuple]] = []
    seals: list[str] = []
    for name in ("a.mcap", "b.mcap"):
        with (tmp_path / name).open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            found = [
                (m.log_time, m.publish_time, m.sequence, channel.topic, m.data)
                for _, channel, m in reader.iter_messages()
            ]
            messages.append(sorted(found))
            seals += [each.metadata["content_id"] for each in reader.iter_metadata()]
    assert messages[0] == messages[1]
    assert seals[0] == seals[1]


# --- readers ---


@pytest.fixture
def recording(tmp_path: Path, memory: BlockMemory) -> Path:
    """A complete recording with a manifest and eight borrowed images of the small recording's size."""
    with McapWriter(tmp_path / "a.mcap", memory, flush_s=60.0) as writer:
        small.write_head(writer)
        channel = writer.add_topic(topics.raw_image("main"))
        sample = pb.ClockSample(clock="camera/main", device_time_ns=1, host_before_ns=1, host_after_ns=2)
        writer.write(writer.add_topic(topics.CLOCK_SAMPLE), T0, sample.SerializeToString())
        for first in (0, 3):
            numbers = range(first, first + (3 if first == 0 else 5))
            writer.write_borrowed(
                channel,
                [
                    borrowed_image(CountingBuffer(image_of(small.WIDTH, small.HEIGHT, number)), number)
                    for number in numbers
                ],
            )
    return tmp_path / "a.mcap"


def _check_small(found: dict[int, np.ndarray]) -> None:
    _check_images(found, 8, small.WIDTH, small.HEIGHT)


def test_the_file_holds_padding(recording: Path) -> None:
    opcodes = [opcode for opcode, _, _ in walk(memoryview(recording.read_bytes()), len(container.MAGIC))]
    assert container.PADDING in opcodes
    _on_pages(recording, small.WIDTH, small.HEIGHT, 8)


def test_mcaps_readers(recording: Path) -> None:
    _check_small(_images(recording))
    with recording.open("rb") as file:
        stream = [
            record for record in StreamReader(file, validate_crcs=True).records if isinstance(record, Message)
        ]
    images = [message.sequence for message in stream if len(message.data) > small.WIDTH * small.HEIGHT]
    assert images == list(range(8))


def test_rerun(recording: Path, tmp_path: Path) -> None:
    program = (
        "import json, sys\n"
        "from rerun.chunk import McapReader, RrdReader\n"
        "McapReader(sys.argv[1]).stream().write_rrd(sys.argv[2], application_id='percuss', "
        "recording_id='sample')\n"
        "print(json.dumps([str(column) for column in "
        "RrdReader(sys.argv[2]).store().schema().component_columns()]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(recording), str(tmp_path / "s.rrd")],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert IMAGE_TOPIC in " ".join(json.loads(done.stdout))
    assert (tmp_path / "s.rrd").stat().st_size > 8 * small.WIDTH * small.HEIGHT


@pytest.mark.parametrize("how", [open_recording, open_partial])
def test_the_analysis(recording: Path, how: Callable[[Path], Recording]) -> None:
    with how(recording) as opened:
        images = [frame.image for frame in opened.images()]
    _check_small(dict(enumerate(images)))


def test_the_growing_file_can_be_followed(tmp_path: Path, memory: BlockMemory) -> None:
    writer = McapWriter(tmp_path / "a.mcap", memory)
    small.write_head(writer)
    channel = writer.add_topic(topics.raw_image("main"))
    seen: list[int] = []
    with FollowedRecording(writer.part_path) as following:
        for number in range(20):
            writer.write_borrowed(
                channel, [borrowed_image(CountingBuffer(image_of(WIDTH, HEIGHT, number)), number)]
            )
            if number % 3 == 2:
                writer.flush()
            for message in following.poll():
                seen.append(message.sequence)
                np.testing.assert_array_equal(
                    following.image(message).image, image_of(WIDTH, HEIGHT, message.sequence)
                )
        writer.finish()
        seen += [message.sequence for message in following.poll()]
    assert seen == list(range(20))


def test_adding_and_removing_topics(recording: Path, tmp_path: Path) -> None:
    append_topics(recording, [(topics.TRUTH_POSE, T0, b"")])
    _check_small(_images(recording))
    remove_topics(recording, tmp_path / "b.mcap", "/truth/")
    _check_small(_images(tmp_path / "b.mcap"))


def test_recover_reads_a_complete_and_a_cut_file(recording: Path, tmp_path: Path) -> None:
    report = recover(recording, tmp_path / "b.mcap")
    assert not report.anything_lost
    _check_small(_images(tmp_path / "b.mcap"))
    data = recording.read_bytes()
    chunks = [
        at for opcode, at, _ in walk(memoryview(data), len(container.MAGIC)) if opcode == container.CHUNK
    ]
    for number, cut in enumerate((chunks[4] - 5, chunks[4], chunks[5] + 3000)):
        (tmp_path / "cut.part").write_bytes(data[:cut])
        report = recover(tmp_path / "cut.part", tmp_path / f"cut{number}.mcap")
        assert report.topics == {IMAGE_TOPIC: 4 if number < 2 else 5}


@pytest.mark.parametrize("damage", ["opcode", "short", "long", "huge", "bytes"])
def test_damaged_padding_costs_no_image(recording: Path, tmp_path: Path, damage: str) -> None:
    data = bytearray(recording.read_bytes())
    places = [
        at
        for opcode, at, _ in walk(memoryview(bytes(data)), len(container.MAGIC))
        if opcode == container.PADDING
    ]
    at = places[len(places) // 2]
    (length,) = struct.unpack_from("<Q", data, at + 1)
    if damage == "opcode":
        data[at] = 0xC3
    elif damage == "bytes":
        data[at + container.RECORD_HEAD + length // 2] = container.CHUNK
    else:
        struct.pack_into(
            "<Q", data, at + 1, {"short": length // 2, "long": length + 40, "huge": 1 << 60}[damage]
        )
    (tmp_path / "damaged.mcap").write_bytes(data)
    report = recover(tmp_path / "damaged.mcap", tmp_path / "b.mcap")
    assert report.topics[IMAGE_TOPIC] == 8
    assert report.skipped_bytes > 0
    _check_small(_images(tmp_path / "b.mcap"))


# --- ways out ---


def _write_borrowed(writer: McapWriter, first: int, count: int) -> list[CountingBuffer]:
    buffers = [CountingBuffer(image_of(WIDTH, HEIGHT, number)) for number in range(first, first + count)]
    writer.write_borrowed(
        writer.add_topic(topics.raw_image("main")),
        [borrowed_image(each, first + n) for n, each in enumerate(buffers)],
    )
    return buffers


def test_no_buffer_is_released_before_its_image_is_on_the_disk(
    tmp_path: Path, memory: BlockMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    go, write_pages = threading.Event(), direct_file._write_pages

    def stuck(fd: int, views: list[memoryview], offset: int) -> None:
        assert go.wait(30)
        write_pages(fd, views, offset)

    with McapWriter(tmp_path / "a.mcap", memory) as writer:
        writer.flush()
        monkeypatch.setattr(direct_file, "_write_pages", stuck)
        buffers = _write_borrowed(writer, 0, 5) + _write_borrowed(writer, 5, 7)
        assert memory.used_bytes >= 12 * 5 * PAGE_BYTES
        assert not any(buffer.released for buffer in buffers)
        go.set()
        writer.flush()
        assert all(buffer.released == 1 for buffer in buffers)
    assert all(buffer.released == 1 for buffer in buffers)
    _check_images(_images(tmp_path / "a.mcap"), 12)


def test_an_aborted_recording_releases_its_buffers(tmp_path: Path, memory: BlockMemory) -> None:
    writer = McapWriter(tmp_path / "a.mcap", memory)
    buffers = _write_borrowed(writer, 0, 9)
    writer.abort()
    assert all(buffer.released == 1 for buffer in buffers)
    assert recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap").topics == {IMAGE_TOPIC: 9}


def test_a_failing_disk_releases_every_buffer(
    tmp_path: Path, memory: BlockMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = McapWriter(tmp_path / "a.mcap", memory)
    buffers = _write_borrowed(writer, 0, 3)
    writer.flush()

    def broken(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(direct_file, "_write_pages", broken)
    buffers += _write_borrowed(writer, 3, 3)
    with pytest.raises(RecorderError, match="Input/output error"):
        writer.flush()  # comes back, and says that not all is on the disk
    assert all(buffer.released == 1 for buffer in buffers), (
        "the camera goes on, though nobody finished the recording yet"
    )
    late = CountingBuffer(image_of(WIDTH, HEIGHT, 6))
    with pytest.raises(RecorderError, match="Input/output error"):
        writer.write_borrowed(writer.add_topic(topics.raw_image("main")), [borrowed_image(late, 6)])
    assert late.released == 0, "it was not taken"
    with pytest.raises(RecorderError, match="Input/output error"):
        writer.finish()
    assert all(buffer.released == 1 for buffer in buffers)
    assert recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap").topics == {IMAGE_TOPIC: 3}


def test_a_full_disk_refuses_all_of_a_batch_and_gives_a_whole_recording(
    tmp_path: Path, memory: BlockMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    allocate, room = direct_file._allocate, RESERVE_BYTES + (1 << 20)

    def small_disk(fd: int, offset: int, size: int) -> None:
        if offset + size > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        allocate(fd, offset, size)

    monkeypatch.setattr(direct_file, "_allocate", small_disk)
    writer = McapWriter(tmp_path / "a.mcap", memory)
    buffers = _write_borrowed(writer, 0, 40)
    late = [CountingBuffer(image_of(WIDTH, HEIGHT, number)) for number in range(40, 50)]
    with pytest.raises(RecorderError, match=r"cannot be written.*free space") as refused:
        writer.write_borrowed(
            writer.add_topic(topics.raw_image("main")),
            [borrowed_image(each, 40 + n) for n, each in enumerate(late)],
        )
    assert not isinstance(refused.value, DiskBehind)
    assert not any(buffer.released for buffer in late)
    writer.finish()
    assert all(buffer.released == 1 for buffer in buffers)
    _check_images(_images(tmp_path / "a.mcap"), 40)


def test_without_room_in_memory_the_disk_is_behind(tmp_path: Path, memory: BlockMemory) -> None:
    with McapWriter(tmp_path / "a.mcap", memory) as writer:
        writer.flush()
        taken = [memory.take() for _ in range(memory.free)]
        buffer = CountingBuffer(image_of(WIDTH, HEIGHT, 0))
        with pytest.raises(DiskBehind):
            writer.write_borrowed(
                writer.add_topic(topics.raw_image("main")), [borrowed_image(buffer, 0)] * 100
            )
        assert buffer.released == 0
        for block in taken:
            memory.give_back(block)
