"""Images written from borrowed buffers: the same messages as copied ones, and every buffer released once."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.borrowed_chunks import gap_before
from acquire.recorder.direct.direct_io import can_write_directly
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.recover.edit import append_topics
from acquire.recorder.recover.recover import recover
from analyze.reading.followed_recording import FollowedRecording
from analyze.reading.recording import Recording, open_partial, open_recording
from schemas import topics
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from schemas.proto import percuss_pb2 as pb
from tests import small_recording as small
from tests.acquire.recorder.direct.borrowed_recordings import (
    HEIGHT,
    IMAGE_TOPIC,
    WIDTH,
    check_images,
    on_pages,
    read_images,
    write_recording,
)
from tests.acquire.recorder.direct.counting_buffer import (
    PERIOD_NS,
    T0,
    CountingBuffer,
    borrowed_image,
    image_of,
)
from tests.mcap_writer import McapWriter
from tests.removed_topics import remove_topics


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
        buffers = write_recording(path, memory, batches, size, 1, between[: len(batches)])
        assert [(buffer.borrows, buffer.released) for buffer in buffers] == [(0, 1)] * sum(batches)
        assert memory is None or (memory.free, memory.used_bytes) == (memory.blocks, 0)
        check_images(read_images(path), sum(batches), size, 1)
        on_pages(path, size, 1, sum(batches))


def test_content_is_the_same_as_when_it_is_copied(tmp_path: Path, memory: BlockMemory) -> None:
    write_recording(tmp_path / "a.mcap", memory, [3, 1, 12], WIDTH, HEIGHT, [5, 70_000, 9])
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
    check_images(found, 8, small.WIDTH, small.HEIGHT)


def test_the_file_holds_padding(recording: Path) -> None:
    opcodes = [opcode for opcode, _, _ in walk(memoryview(recording.read_bytes()), len(container.MAGIC))]
    assert container.PADDING in opcodes
    on_pages(recording, small.WIDTH, small.HEIGHT, 8)


def test_mcaps_readers(recording: Path) -> None:
    _check_small(read_images(recording))
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
    _check_small(read_images(recording))
    remove_topics(recording, tmp_path / "b.mcap", "/truth/")
    _check_small(read_images(tmp_path / "b.mcap"))


def test_recover_reads_a_complete_and_a_cut_file(recording: Path, tmp_path: Path) -> None:
    report = recover(recording, tmp_path / "b.mcap")
    assert not report.anything_lost
    _check_small(read_images(tmp_path / "b.mcap"))
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
    _check_small(read_images(tmp_path / "b.mcap"))
