"""Release of borrowed buffers: once, after the image is on the disk, also when the disk fails."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path

import pytest

from acquire.errors import RecorderError
from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.direct import direct_file
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.direct_file import RESERVE_BYTES
from acquire.recorder.direct.direct_io import allocate, write_pages
from acquire.recorder.messages import DiskBehind
from acquire.recorder.recover.recover import recover
from schemas import topics
from tests.acquire.recorder.direct.borrowed_recordings import (
    HEIGHT,
    IMAGE_TOPIC,
    WIDTH,
    check_images,
    read_images,
)
from tests.acquire.recorder.direct.counting_buffer import (
    CountingBuffer,
    borrowed_image,
    image_of,
)
from tests.mcap_writer import McapWriter


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
    go = threading.Event()

    def stuck(fd: int, views: list[memoryview], offset: int) -> None:
        assert go.wait(30)
        write_pages(fd, views, offset)

    with McapWriter(tmp_path / "a.mcap", memory) as writer:
        writer.flush()
        monkeypatch.setattr(direct_file, "write_pages", stuck)
        buffers = _write_borrowed(writer, 0, 5) + _write_borrowed(writer, 5, 7)
        assert memory.used_bytes >= 12 * 5 * PAGE_BYTES
        assert not any(buffer.released for buffer in buffers)
        go.set()
        writer.flush()
        assert all(buffer.released == 1 for buffer in buffers)
    assert all(buffer.released == 1 for buffer in buffers)
    check_images(read_images(tmp_path / "a.mcap"), 12)


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

    monkeypatch.setattr(direct_file, "write_pages", broken)
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
    room = RESERVE_BYTES + (1 << 20)

    def small_disk(fd: int, offset: int, size: int) -> None:
        if offset + size > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        allocate(fd, offset, size)

    monkeypatch.setattr(direct_file, "allocate", small_disk)
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
    check_images(read_images(tmp_path / "a.mcap"), 40)


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
