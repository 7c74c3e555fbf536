"""Cost of writing a recording: `make bench-capture` (two minutes).

The same noisy mono8 frames go through this recorder, two other MCAP writers, and plain write(), in rounds in
which every writer has its turn; the table shows medians over the rounds. Every writer is fed as fast as it
takes frames; this recorder and write() also at line rate, where the processor sleeps between frames and its
caches go cold. CPU is that of all threads of this process, kernel included; "kernel threads" is that of the
kernel's own threads until everything is on the disk (on an idle machine: for this work). "Same durability" is
fdatasync every 32 MB and fsync at the end, as the recorder does.

This recorder keeps a frame's buffer until it is on the disk, as it does with the camera's buffers: its frames
come from a pool of page-aligned buffers, which are reused when they are released. Plain write() gets the same
buffers in the same order. The other writers get the same pixels, which they copy.
"""

from __future__ import annotations

import contextlib
import os
import resource
import statistics
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import click
import foxglove
import numpy as np
from foxglove.channels import RawImageChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import RawImage as FoxgloveImage
from foxglove.messages import Timestamp
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from acquire.frames.frame import Frame
from acquire.frames.page_memory import page_memory, whole_pages
from acquire.recorder.choose_recorder import choose_recorder
from acquire.recorder.direct.backlog import backlog_frames, backlog_memory
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.direct_io import can_write_directly
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.messages import ImageMessage
from acquire.recorder.paged.copied_queue import BATCH_BYTES
from acquire.recorder.writer import SYNC_BYTES
from schemas import topics
from schemas.rig import RecorderConfig
from tests.mcap_writer import McapWriter

WIDTH, HEIGHT, RATE_HZ = 656, 492, 365
FORMAT = FrameFormat("main", WIDTH, HEIGHT, RATE_HZ)
PERIOD_NS = 10**9 // RATE_HZ
T0_NS = 1_700_000_000_000_000_000
BUFFERS = 128
"""number of frame buffers: the 64 of a rig file's default, and some of those that may be borrowed in
addition"""
BATCH = BATCH_BYTES // (WIDTH * HEIGHT)
Frames = list[NDArray[np.uint8]]
Calls = Iterator[float]
"""Yields 0 when the writer is ready, then the duration [s] of each call."""


def raw_write(path: Path, frames: Frames, sync_bytes: int) -> Calls:
    """Call write() for each frame, and yield the durations.

    With `sync_bytes` 0 the kernel decides when data goes to the disk.
    """
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
    waiting = 0
    yield 0.0
    for frame in frames:
        start = time.perf_counter()
        waiting += os.write(fd, frame)
        if 0 < sync_bytes <= waiting:
            os.fdatasync(fd)
            waiting = 0
        yield time.perf_counter() - start
    if sync_bytes:
        os.fsync(fd)
    os.close(fd)


def windows_writer(path: Path, frames: Frames) -> Calls:
    """Write as this recorder writes strike windows: through the page cache, in chunks of several frames."""
    writer = McapWriter(path)
    channel, encoder = writer.add_topic(topics.raw_image("main")), RawImageEncoder("camera", WIDTH, HEIGHT)
    yield 0.0
    for first in range(0, len(frames), BATCH):
        start = time.perf_counter()
        messages = [
            ImageMessage(time_ns, encoder.encode(time_ns, frame), number)
            for number, frame in enumerate(frames[first : first + BATCH], first)
            for time_ns in [T0_NS + number * PERIOD_NS]
        ]
        writer.write_images(channel, messages)
        yield time.perf_counter() - start
    writer.finish()


@cache
def _memory() -> BlockMemory:
    """Backlog memory, allocated once: its allocation is not part of writing a frame."""
    return backlog_memory(FORMAT, backlog_frames(FORMAT))


class Pool:
    """Pool of frame buffers, as a camera's; the buffer released first is used next."""

    def __init__(self, images: Frames) -> None:
        self.free = deque(PoolBuffer(self, image) for image in images)


class PoolBuffer:
    """Buffer of one frame (see FrameBuffer)."""

    def __init__(self, pool: Pool, image: NDArray[np.uint8]) -> None:
        self.image = image
        self.borrowed = False
        self._pool = pool

    def borrow(self) -> bool:
        """Borrow the buffer: it is not filled again before its release; always True."""
        return True

    def release(self) -> None:
        """Return the buffer to the pool."""
        self._pool.free.append(self)


def page_aligned_images(count: int) -> NDArray[np.uint8]:
    """Images of noise (count, HEIGHT, WIDTH), each at the beginning of a memory page."""
    stride = whole_pages(WIDTH * HEIGHT)
    memory = np.frombuffer(page_memory(count * stride), np.uint8)[: count * stride].reshape(count, stride)
    memory[:] = np.random.default_rng(1).integers(0, 256, memory.shape, dtype=np.uint8)
    return memory[:, : WIDTH * HEIGHT].reshape(count, HEIGHT, WIDTH)


def whole_recorder(path: Path, frames: Frames) -> Calls:
    """Run the whole recorder in continuous mode, from the camera's buffer to file, metadata and index."""
    memory = _memory()
    writer = McapWriter(path, memory)
    recorder = choose_recorder(writer, FORMAT, RecorderConfig(mode="continuous"), T0_NS)
    pool = Pool(frames[:BUFFERS])
    yield 0.0
    for number in range(1, len(frames) + 1):
        mid = number * PERIOD_NS
        # The recorder never waits for the disk; a feeder that is faster than the disk must wait.
        while not pool.free:
            time.sleep(5e-3)
        buffer = pool.free.popleft()
        start = time.perf_counter()
        recorder.add(Frame(buffer.image, number, number, mid, mid, 1500.0, 0, buffer, mid, 1000))
        yield time.perf_counter() - start
    recorder.close()
    writer.finish()
    if recorder.dropped:
        raise click.ClickException(f"{recorder.dropped} frames were dropped: the disk is too slow for this")


def at_line_rate(writer: Callable[[Path, Frames], Calls]) -> Callable[[Path, Frames], Calls]:
    """Copy of a `writer` of images that receives them at the camera's frame rate instead of at once."""

    def calls(path: Path, frames: Frames) -> Calls:
        begun = 0.0
        for number, call in enumerate(writer(path, frames)):
            begun = begun or time.perf_counter()
            yield call
            time.sleep(max(0.0, begun + number / RATE_HZ - time.perf_counter()))

    return calls


def mcap_writer(path: Path, frames: Frames) -> Calls:
    """Use mcap.Writer, no compression, chunks of 4 MB, CRC; messages are built as cheaply as ours."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4 << 20, compression=CompressionType.NONE)
        writer.start()
        topic = topics.raw_image("main")
        schema = writer.register_schema(topic.schema_name, "protobuf", topic.schema_data())
        channel = writer.register_channel(topic.name, "protobuf", schema)
        encoder = RawImageEncoder("camera", WIDTH, HEIGHT)
        yield 0.0
        for number, frame in enumerate(frames):
            start = time.perf_counter()
            time_ns = T0_NS + number * PERIOD_NS
            writer.add_message(channel, time_ns, b"".join(encoder.encode(time_ns, frame)), time_ns, number)
            yield time.perf_counter() - start
        writer.finish()


def foxglove_writer(path: Path, frames: Frames) -> Calls:
    """Use foxglove-sdk without compression, with chunks of 4 MB."""
    context = foxglove.Context()
    options = MCAPWriteOptions(compression=None, chunk_size=4 << 20)
    with foxglove.open_mcap(path, context=context, writer_options=options):
        channel = RawImageChannel("/camera/main/image", context=context)
        yield 0.0
        for number, frame in enumerate(frames):
            start = time.perf_counter()
            time_ns = T0_NS + number * PERIOD_NS
            image = FoxgloveImage(
                timestamp=Timestamp(time_ns // 10**9, time_ns % 10**9),
                frame_id="camera",
                width=WIDTH,
                height=HEIGHT,
                encoding="mono8",
                step=WIDTH,
                data=frame.tobytes(),
            )
            channel.log(image, log_time=time_ns)
            yield time.perf_counter() - start
        channel.close()


RAW, DURABLE = "raw write()", "raw write(), same durability"
RATED = "at line rate: "
RATED_RAW, RATED_DURABLE = RATED + RAW, RATED + DURABLE
WRITERS: dict[str, Callable[[Path, Frames], Calls]] = {
    RAW: lambda path, frames: raw_write(path, frames, 0),
    DURABLE: lambda path, frames: raw_write(path, frames, SYNC_BYTES),
    "this recorder: all of it, with meta": whole_recorder,
    f"its writer for windows, {BATCH} frames a chunk": windows_writer,
    "mcap.Writer": mcap_writer,
    "foxglove-sdk": foxglove_writer,
    RATED_RAW: at_line_rate(lambda path, frames: raw_write(path, frames, 0)),
    RATED_DURABLE: at_line_rate(lambda path, frames: raw_write(path, frames, SYNC_BYTES)),
    RATED + "this recorder": at_line_rate(whole_recorder),
}


@dataclass(frozen=True)
class Turn:
    """Cost of one writer for all frames."""

    wall_s: float
    user_s: float
    system_s: float
    worst_s: float
    kernel_s: float
    """CPU time of the kernel's threads until everything is on the disk [s]"""

    @property
    def cpu_s(self) -> float:
        """User and system CPU time [s]."""
        return self.user_s + self.system_s


def turn(writer: Callable[[Path, Frames], Calls], path: Path, frames: Frames) -> Turn:
    """Time [s] and CPU time [s] that one writer takes for all frames, and its slowest call."""
    calls = writer(path, frames)
    next(calls)
    kernel = kernel_threads_s()
    before, start = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    worst = max(calls)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF)
    os.sync()
    kernel = kernel_threads_s() - kernel
    path.unlink()
    os.sync()  # the next writer finds an idle disk
    return Turn(wall, after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime, worst, kernel)


def kernel_threads_s() -> float:
    """CPU time [s] of the kernel's own threads, which are the children of thread 2."""
    total = 0
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(status.read_text(encoding="ascii").rpartition(")")[2].split()[1]) == 2:
                total += int(status.with_name("schedstat").read_text(encoding="ascii").split()[0])
    return total * 1e-9


def machine(folder: Path) -> str:
    """Description of processor, kernel and file system."""
    model = next(
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="ascii").splitlines()
        if "model name" in line
    )
    mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines()]
    kind = max(
        (mount for mount in mounts if folder.resolve().is_relative_to(mount[0])),
        key=lambda mount: len(mount[0]),
    )[1]
    way = "O_DIRECT" if can_write_directly(folder) else "no O_DIRECT"
    load = os.getloadavg()[0]
    return f"{os.cpu_count()} x {model}, Linux {os.uname().release}, {kind} ({way}), load {load:.1f}"


@click.command()
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True),
    help="Folder on the disk to be measured; a temporary one by default.",
)
@click.option("--frames", "count", default=1095, help="Frames per turn; 1095 are three seconds at line rate.")
@click.option("--rounds", default=5)
def main(folder: Path | None, count: int, rounds: int) -> None:
    """Measure all writers and print the table."""
    pool = page_aligned_images(BUFFERS)
    frames: Frames = [pool[number % len(pool)] for number in range(count)]
    megabytes = count * pool[0].nbytes / 1e6
    turns: dict[str, list[Turn]] = {name: [] for name in WRITERS}
    console = Console(width=150)
    with tempfile.TemporaryDirectory(dir=folder, prefix="percuss-bench-") as scratch:
        title = machine(Path(scratch))
        for round_number in track(range(rounds + 1), console=Console(stderr=True), transient=True):
            for name, writer in WRITERS.items():
                done = turn(writer, Path(scratch) / "bench.mcap", frames)
                if round_number:  # the first round only touches the memory of the page cache
                    turns[name].append(done)
    table = Table(
        title=f"{count} frames of {WIDTH} x {HEIGHT} ({megabytes:.0f} MB), medians of {rounds} rounds; "
        + title
    )
    for heading in (
        "writer",
        "MB/s",
        "MB per CPU-s",
        "user",
        "system",
        "kernel threads",
        "CPU at 118 MB/s",
        "worst call",
        "of raw",
        "of raw, same durability",
    ):
        table.add_column(heading, justify="left" if heading == "writer" else "right")
    for name, done in turns.items():
        cpu = statistics.median(each.cpu_s for each in done)
        references = (RATED_RAW, RATED_DURABLE) if name.startswith(RATED) else (RAW, DURABLE)
        ratios = [
            statistics.median(raw.cpu_s / own.cpu_s for raw, own in zip(turns[reference], done, strict=True))
            for reference in references
        ]
        table.add_row(
            name,
            f"{megabytes / statistics.median(each.wall_s for each in done):.0f}",
            f"{megabytes / cpu:.0f}",
            f"{1e6 * statistics.median(each.user_s for each in done) / count:.0f} us",
            f"{1e6 * statistics.median(each.system_s for each in done) / count:.0f} us",
            f"{1e6 * statistics.median(each.kernel_s for each in done) / count:.0f} us",
            f"{100 * 118 * cpu / megabytes:.1f} %",
            f"{1e3 * max(each.worst_s for each in done):.1f} ms",
            *(f"{ratio:.2f}" for ratio in ratios),
        )
    console.print(table)
    console.print("user, system, kernel threads: CPU per frame; of raw: at the same feed")


if __name__ == "__main__":
    main()
