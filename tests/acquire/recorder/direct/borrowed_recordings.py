"""Recordings written from borrowed and from copied buffers, and the check of their images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader

from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder.direct.block_memory import BlockMemory
from schemas import topics
from tests.acquire.recorder.direct.counting_buffer import (
    PERIOD_NS,
    T0,
    CountingBuffer,
    borrowed_image,
    image_of,
)
from tests.mcap_writer import McapWriter

IMAGE_TOPIC = "/camera/main/image"
WIDTH, HEIGHT = 331, 67
"""size of an image [px]: 22177 bytes, which are five pages and a piece"""


def write_recording(
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


def read_images(path: Path) -> dict[int, np.ndarray]:
    found: dict[int, np.ndarray] = {}
    with path.open("rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(
            topics=[IMAGE_TOPIC], log_time_order=False
        ):
            assert message.log_time == T0 + message.sequence * PERIOD_NS
            raw = RawImage.FromString(message.data)
            found[message.sequence] = np.frombuffer(raw.data, np.uint8).reshape(raw.height, raw.width)
    return found


def check_images(found: dict[int, np.ndarray], count: int, width: int = WIDTH, height: int = HEIGHT) -> None:
    assert list(found) == list(range(count))
    for number, image in found.items():
        np.testing.assert_array_equal(image, image_of(width, height, number))


def on_pages(path: Path, width: int, height: int, count: int) -> None:
    data = path.read_bytes()
    at = [data.find(image_of(width, height, number).tobytes()) for number in range(count)]
    assert all(place > 0 and place % PAGE_BYTES == 0 for place in at)
