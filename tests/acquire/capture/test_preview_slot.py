"""Preview: images reach a reader only while it asks for them, at most ten a second."""

from __future__ import annotations

import os
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from acquire.capture.preview_slot import (
    INTERVAL_NS,
    WANTED_NS,
    PreviewMemory,
    PreviewReader,
    PreviewShape,
    PreviewWriter,
)
from acquire.errors import DaemonNotRunning

FRAME_NS = 8_333_333


def frame(shape: PreviewShape, time_ns: int, grey: int = 0) -> Any:
    image = np.full((shape.height, shape.width), grey, np.uint8)
    image[0, 0] = 255
    return SimpleNamespace(image=image, host_time_ns=time_ns)


class Clock:
    def __init__(self) -> None:
        self.now_ns = 10**12

    def __call__(self) -> int:
        return self.now_ns


@pytest.mark.parametrize(
    ("width", "height", "rows", "columns"), [(656, 492, 492, 656), (2448, 2049, 513, 612)]
)
def test_images_are_thinned_to_a_width(width: int, height: int, rows: int, columns: int) -> None:
    shape, clock = PreviewShape(width, height), Clock()
    memory = PreviewMemory(shape)
    writer, reader = PreviewWriter(memory.fd, shape), PreviewReader(memory.address(), clock)
    assert reader.newest() is None
    writer.offer(frame(shape, clock.now_ns, 7))
    seen = reader.newest()
    assert seen is not None
    assert seen.image.shape == (rows, columns)
    assert (seen.image[0, 0], seen.image[1, 1]) == (255, 7)
    assert (seen.number, seen.step) == (1, shape.step)


def test_ten_images_a_second_and_none_unasked() -> None:
    shape, clock = PreviewShape(64, 48), Clock()
    memory = PreviewMemory(shape)
    writer, reader = PreviewWriter(memory.fd, shape), PreviewReader(memory.address(), clock)
    for _ in range(120):
        writer.offer(frame(shape, clock.now_ns))
        clock.now_ns += FRAME_NS
    assert reader.newest() is None
    asked_ns = clock.now_ns
    while clock.now_ns < asked_ns + 5 * WANTED_NS:
        writer.offer(frame(shape, clock.now_ns))
        clock.now_ns += FRAME_NS
    reader._read(0)
    count = reader._read(8)
    assert WANTED_NS / INTERVAL_NS * 0.8 < count <= WANTED_NS / INTERVAL_NS + 1
    assert reader.newest() is None  # the newest image is too old


def test_another_process_may_not_be_read_by_mistake(tmp_path: Any) -> None:
    shape = PreviewShape(64, 48)
    with (tmp_path / "file").open("wb") as file:
        address = PreviewMemory(shape).address() | {"fd": file.fileno()}
        with pytest.raises(DaemonNotRunning, match="preview"):
            PreviewReader(address)
    assert (tmp_path / "file").read_bytes() == b""


def test_the_memory_is_given_back() -> None:
    memory = PreviewMemory(PreviewShape(64, 48))
    fd = memory.fd
    del memory
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(fd)
