"""What writing a recording costs: `make bench-capture` (half a minute).

The same noisy mono8 frames go through this recorder, two other MCAP writers, and plain write(), in rounds in which every writer has
its turn; the table shows medians over the rounds. CPU is that of this process, kernel included. "Same durability" is fdatasync every
32 MB and fsync at the end, as the recorder does. The whole recorder is fed at twice the line rate, the others as fast as they take it.
"""

from __future__ import annotations

import os
import resource
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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

from acquire.config import RecorderConfig
from acquire.recorder.block_memory import BlockMemory
from acquire.recorder.frame_queue import BATCH_BYTES
from acquire.recorder.frame_recorder import Arrival, FrameRecorder, backlog_bytes
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.writer import SYNC_BYTES, ImageMessage, McapWriter
from schemas import topics

WIDTH, HEIGHT, RATE_HZ = 656, 492, 365
PERIOD_NS = 10**9 // RATE_HZ
T0_NS = 1_700_000_000_000_000_000
BURST = 8
BATCH = BATCH_BYTES // (WIDTH * HEIGHT)
Frames = list[NDArray[np.uint8]]
Calls = Iterator[float]
"""0 once it is ready, then the seconds that each call took"""


def raw_write(path: Path, frames: Frames, sync_bytes: int) -> Calls:
    """write(), a frame at a time; `sync_bytes` 0: the kernel decides when it goes to the disk."""
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


def recorder_writer(path: Path, frames: Frames) -> Calls:
    """The writer of this recorder, frames in chunks as it is given them at line rate."""
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


def whole_recorder(path: Path, frames: Frames) -> Calls:
    """All of this recorder: copy into its memory, queue, writing thread, and each frame's meta."""
    writer = McapWriter(path, BlockMemory(backlog_bytes(WIDTH, HEIGHT, RATE_HZ)))
    recorder = FrameRecorder(writer, "main", WIDTH, HEIGHT, RATE_HZ, RecorderConfig(mode="continuous"), T0_NS)
    yield 0.0
    begun = time.perf_counter()
    for number, frame in enumerate(frames, 1):
        if number % BURST == 0:  # the benchmark's own waiting must not count
            time.sleep(max(0.0, begun + number / (2 * RATE_HZ) - time.perf_counter()))
        mid = number * PERIOD_NS
        start = time.perf_counter()
        recorder.add(Arrival(frame, number, number, mid, mid, mid, 1000, 1500.0, 0))
        yield time.perf_counter() - start
    recorder.close()
    writer.finish()
    if recorder.dropped:
        raise click.ClickException(f"{recorder.dropped} frames were dropped: the disk is too slow for this")


def mcap_writer(path: Path, frames: Frames) -> Calls:
    """mcap.Writer, no compression, chunks of 4 MB, CRC on; the message is put together as cheaply as ours."""
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
    """foxglove-sdk, no compression, chunks of 4 MB."""
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
WRITERS: dict[str, Callable[[Path, Frames], Calls]] = {
    RAW: lambda path, frames: raw_write(path, frames, 0),
    DURABLE: lambda path, frames: raw_write(path, frames, SYNC_BYTES),
    f"this recorder: writer, {BATCH} frames a chunk": recorder_writer,
    "this recorder: all of it, with meta": whole_recorder,
    "mcap.Writer": mcap_writer,
    "foxglove-sdk": foxglove_writer,
}


@dataclass(frozen=True)
class Turn:
    """One writer, all frames, once."""

    wall_s: float
    user_s: float
    system_s: float
    worst_s: float

    @property
    def cpu_s(self) -> float:
        """User and system."""
        return self.user_s + self.system_s


def turn(writer: Callable[[Path, Frames], Calls], path: Path, frames: Frames) -> Turn:
    """Let a writer write all frames."""
    calls = writer(path, frames)
    next(calls)
    before, start = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    worst = max(calls)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF)
    path.unlink()
    os.sync()  # the next writer finds an idle disk
    return Turn(wall, after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime, worst)


@click.command()
@click.option("--folder", type=click.Path(path_type=Path, exists=True), help="On the disk to be measured; a temporary one by default.")
@click.option("--frames", "count", default=720, help="Per turn; 720 are two seconds at line rate.")
@click.option("--rounds", default=7)
def main(folder: Path | None, count: int, rounds: int) -> None:
    """Measure and tabulate."""
    pool = np.random.default_rng(1).integers(0, 256, (64, HEIGHT, WIDTH), dtype=np.uint8)
    frames: Frames = [pool[number % len(pool)] for number in range(count)]
    megabytes = count * pool[0].nbytes / 1e6
    turns: dict[str, list[Turn]] = {name: [] for name in WRITERS}
    console = Console(width=130)
    with tempfile.TemporaryDirectory(dir=folder, prefix="percuss-bench-") as scratch:
        for round_number in track(range(rounds + 1), console=Console(stderr=True), transient=True):
            for name, writer in WRITERS.items():
                done = turn(writer, Path(scratch) / "bench.mcap", frames)
                if round_number:  # the first round only touches the memory of the page cache
                    turns[name].append(done)
    table = Table(title=f"{count} frames of {WIDTH} x {HEIGHT} ({megabytes:.0f} MB), medians of {rounds} rounds")
    for heading in (
        "writer",
        "MB/s",
        "MB per CPU-s",
        "user",
        "system",
        "CPU at 118 MB/s",
        "worst call",
        "of raw",
        "of raw, same durability",
    ):
        table.add_column(heading, justify="left" if heading == "writer" else "right")
    for name, done in turns.items():
        cpu = statistics.median(each.cpu_s for each in done)
        ratios = [
            statistics.median(raw.cpu_s / own.cpu_s for raw, own in zip(turns[reference], done, strict=True))
            for reference in (RAW, DURABLE)
        ]
        table.add_row(
            name,
            f"{megabytes / statistics.median(each.wall_s for each in done):.0f}",
            f"{megabytes / cpu:.0f}",
            f"{1e6 * statistics.median(each.user_s for each in done) / count:.0f} us",
            f"{1e6 * statistics.median(each.system_s for each in done) / count:.0f} us",
            f"{100 * 118 * cpu / megabytes:.1f} %",
            f"{1e3 * max(each.worst_s for each in done):.1f} ms",
            *(f"{ratio:.2f}" for ratio in ratios),
        )
    console.print(table)
    console.print("user, system: CPU per frame")


if __name__ == "__main__":
    main()
