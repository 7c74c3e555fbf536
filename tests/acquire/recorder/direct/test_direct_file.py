"""A recording written past the page cache, in whole pages, which a reader can follow while it grows.

Its content equals that of one written through the page cache, and appending never waits for the disk.
"""

from __future__ import annotations

import errno
import os
import random
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.direct import direct_file
from acquire.recorder.direct.block_memory import BLOCK_BYTES, BlockMemory
from acquire.recorder.direct.direct_file import RESERVE_BYTES, DirectFile
from acquire.recorder.direct.direct_io import allocate, can_write_directly
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.messages import DiskBehind
from acquire.recorder.recover.recover import recover
from analyze.reading.followed_recording import FollowedRecording
from schemas import topics
from tests import small_recording as small
from tests.mcap_writer import McapWriter

T0 = 1_700_000_000_000_000_000
WIDTH, HEIGHT = 656, 492
ENCODER = RawImageEncoder("camera", WIDTH, HEIGHT)
IMAGES = np.random.default_rng(1).integers(0, 256, (4, HEIGHT, WIDTH), dtype=np.uint8)


@pytest.fixture
def memory(tmp_path: Path) -> Iterator[BlockMemory]:
    if not can_write_directly(tmp_path):
        pytest.skip("this file system takes no O_DIRECT")
    memory = BlockMemory(8 << 20)
    yield memory
    assert memory.free == memory.blocks, "every block was given back"


def _image(writer: McapWriter, number: int) -> None:
    time_ns = T0 + number * 1_000_000
    writer.write(
        writer.add_topic(topics.raw_image("main")),
        time_ns,
        ENCODER.encode(time_ns, IMAGES[number % 4]),
        sequence=number,
    )


def test_any_message_sizes_read_back_unchanged(tmp_path: Path, memory: BlockMemory) -> None:
    generator = random.Random(5)
    source = generator.randbytes(1 << 20)
    file = DirectFile(tmp_path / "a.part", memory, 1 << 20)
    expected = bytearray()
    for _ in range(60):
        pieces = [
            source[start : start + generator.choice([0, 1, 30, PAGE_BYTES, 100_000, 900_000])]
            for start in generator.sample(range(1000), 3)
        ]
        while not file.has_room(sum(map(len, pieces)), image=False):
            time.sleep(1e-3)
        assert file.append(list(pieces)) == sum(map(len, pieces))
        expected += b"".join(pieces)
        if generator.random() < 0.2:
            file.wait_until(file.size)
            found = (tmp_path / "a.part").read_bytes()
            assert len(found) - len(expected) < PAGE_BYTES
            assert found == expected.ljust(len(found), b"\0")
    file.finish()
    assert (tmp_path / "a.part").read_bytes() == expected
    assert (tmp_path / "a.part").stat().st_blocks * 512 < len(expected) + 64 * PAGE_BYTES, (
        "what was allocated and not used is free again"
    )


def test_the_recording_is_the_same_as_through_the_page_cache(tmp_path: Path, memory: BlockMemory) -> None:
    for name, way in (("a.mcap", None), ("b.mcap", memory)):
        with McapWriter(tmp_path / name, way, flush_s=60.0) as writer:
            small.write_head(writer)
            small.write_body(writer)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_message_larger_than_the_memory_waits_for_the_disk(tmp_path: Path, memory: BlockMemory) -> None:
    attachment = random.Random(1).randbytes(3 * memory.blocks * BLOCK_BYTES)
    with McapWriter(tmp_path / "a.mcap", memory) as writer:
        writer.attachment("large", "application/octet-stream", attachment)
    with (tmp_path / "a.mcap").open("rb") as file:
        (found,) = make_reader(file).iter_attachments()
    assert found.data == attachment


def test_a_full_disk_refuses_the_next_image_and_still_gives_a_whole_recording(
    tmp_path: Path, memory: BlockMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = RESERVE_BYTES + (3 << 20)

    def small_disk(fd: int, offset: int, size: int) -> None:
        if offset + size > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        allocate(fd, offset, size)

    monkeypatch.setattr(direct_file, "allocate", small_disk)
    writer = McapWriter(tmp_path / "a.mcap", memory)
    taken = (3 << 20) // (WIDTH * HEIGHT)
    for number in range(taken):
        _image(writer, number)
    with pytest.raises(RecorderError, match=r"a\.mcap\.part: cannot be written.*free space") as refused:
        _image(writer, taken)
    assert not isinstance(refused.value, DiskBehind)
    with pytest.raises(RecorderError, match="cannot be written"):
        _image(writer, 99)
    writer.write(writer.add_topic(topics.STRIKER_SAMPLE), T0 + 10**9, b"\x18\x01", sequence=7)
    seal = writer.finish()
    assert seal.size < room
    with seal.path.open("rb") as file:
        found = [message.sequence for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
    assert found == [*range(taken), 7]


def test_a_failing_disk_is_reported_and_its_bytes_are_recovered(
    tmp_path: Path, memory: BlockMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = McapWriter(tmp_path / "a.mcap", memory)
    for number in range(5):
        _image(writer, number)
    writer.flush()

    def broken(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(direct_file, "write_pages", broken)
    _image(writer, 5)
    with pytest.raises(RecorderError, match="Input/output error"):
        writer.flush()  # comes back, and says that not all is on the disk
    with pytest.raises(RecorderError, match="Input/output error"):
        _image(writer, 6)
    with pytest.raises(RecorderError, match="Input/output error"):
        writer.finish()
    report = recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap")
    assert report.topics == {"/camera/main/image": 5}


def test_a_reader_follows_while_it_grows(tmp_path: Path, memory: BlockMemory) -> None:
    """Every message that is read is complete and correct, though the last page is rewritten repeatedly."""
    writer = McapWriter(tmp_path / "a.mcap", memory, flush_s=0.01)
    small.write_head(writer)
    striker = writer.add_topic(topics.STRIKER_SAMPLE)
    seen: dict[str, list[int]] = {}
    with FollowedRecording(writer.part_path) as following:
        for number in range(120):
            while not writer._file.has_room(1 << 20, image=True):
                time.sleep(1e-3)
            _image(writer, number)
            writer.write(striker, T0 + number, b"\x18\x01" * number, sequence=number)
            if number % 10 == 9:
                writer.flush()
            elif number % 7 == 0:
                time.sleep(0.01)
            _check(following, seen)
        writer.finish()
        _check(following, seen)
        assert following.finished
    assert seen == {"/camera/main/image": list(range(120)), "/striker/sample": list(range(120))}


def _check(following: FollowedRecording, seen: dict[str, list[int]]) -> None:
    for message in following.poll():
        seen.setdefault(message.topic, []).append(message.sequence)
        if message.topic.endswith("image"):
            np.testing.assert_array_equal(following.image(message).image, IMAGES[message.sequence % 4])
        else:
            assert message.data == b"\x18\x01" * message.sequence


def test_a_file_cut_anywhere_gives_every_message_before_the_cut(tmp_path: Path, memory: BlockMemory) -> None:
    writer = McapWriter(tmp_path / "a.mcap", memory, flush_s=60.0)
    small.write_head(writer)
    ends: list[int] = []
    for number in range(6):
        _image(writer, number)
        ends.append(writer.size)
    writer.flush()
    data = writer.part_path.read_bytes()
    assert len(data) % PAGE_BYTES == 0, "as a killed process leaves it"
    writer.abort()
    assert writer.part_path.stat().st_size == ends[-1]
    generator = random.Random(3)
    cuts = [
        len(data),
        ends[-1],
        ends[2],
        ends[2] + 1,
        *(generator.randrange(ends[0], len(data)) for _ in range(12)),
    ]
    for number, cut in enumerate(cuts):
        path, out = tmp_path / f"cut{number}.part", tmp_path / f"whole{number}.mcap"
        path.write_bytes(data[:cut])
        report = recover(path, out)
        # The index of the last image's chunk may be cut; the image is there.
        whole = sum(end - 40 <= cut for end in ends)
        assert report.topics["/camera/main/image"] in {whole, whole - 1}
        if cut >= ends[-1]:
            assert not report.anything_damaged
            assert report.topics["/camera/main/image"] == 6
