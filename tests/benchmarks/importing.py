"""What `analyze import` costs on a gigabyte: processor time and time beside those of demuxing or decoding alone, memory.

A film of a resting tag with a tip now and then is coded once, and its packets are repeated until the file is large. Every measurement is a
process of its own; each file is read once before, so that all find it in memory.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from analyze.importing.run import ImportOptions, prepare
from analyze.importing.write import write
from tests.analyze.importing.filmed import REST, angles, picture, setting

WIDTH, HEIGHT, RATE = 1280, 960, 240
STRIKES = 9
GIGABYTE = 10**9


def images(noise: float) -> list[np.ndarray]:
    """A resting box, and after REST frames its tip, four times as large as filmed.py draws it, with sensor noise."""
    random = np.random.default_rng(1)
    found = []
    for theta in angles():
        large = cv2.resize(picture(float(theta)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        found.append(np.clip(large + random.normal(0, noise, large.shape), 0, 255).astype(np.uint8))
    return found


def packets(codec: str, pixels: str, pictures: list[np.ndarray], options: dict[str, str]) -> tuple[bytes, list[bytes]]:
    """What a decoder must know first, and a coded picture each."""
    encoder = av.CodecContext.create(codec, "w")
    encoder.width, encoder.height, encoder.pix_fmt = WIDTH, HEIGHT, pixels
    encoder.time_base, encoder.framerate, encoder.options = Fraction(1, RATE), Fraction(RATE), options
    coded = []
    for number, each in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(each, format="gray").reformat(format=pixels)
        frame.pts = number
        coded += encoder.encode(frame)
    coded += encoder.encode(None)
    return bytes(encoder.extradata or b""), [bytes(packet) for packet in coded]


def make(path: Path, codec: str, pixels: str, noise: float, size: int, **options: str) -> int:
    """A film of about `size` bytes with STRIKES tips; its frames."""
    pictures = images(noise)
    _, rest = packets(codec, pixels, pictures[:REST], options)
    extra, tip = packets(codec, pixels, pictures, options)
    each = sum(map(len, rest))
    between = max(1, (size // STRIKES - sum(map(len, tip))) // each)
    written = 0
    with av.open(str(path), "w", options={"video_track_timescale": "240000"} if path.suffix in {".mp4", ".mov"} else {}) as container:
        stream = container.add_stream(codec, rate=RATE)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        if extra:
            stream.codec_context.extradata = extra
        stream.codec_context.options = options
        for _ in range(STRIKES):
            for group in [*[rest] * between, tip]:
                for number, data in enumerate(group):
                    packet = av.Packet(data)
                    packet.stream, packet.time_base = stream, Fraction(1, RATE)
                    packet.pts = packet.dts = written
                    packet.is_keyframe = codec != "libx264" or number == 0
                    container.mux(packet)
                    written += 1
    return written


def most_memory_mb() -> float:
    """The most that this process held; `ru_maxrss` would be its parent's, where that held more."""
    [line] = [line for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines() if line.startswith("VmHWM")]
    return int(line.split()[1]) / 1024


def measure(work: str, path: Path, folder: Path) -> dict[str, float]:
    """Seconds and the most memory [MB] of one piece of work, in this process."""
    names = [f"s{number + 1}" for number in range(STRIKES)]
    start, started = time.perf_counter(), time.process_time()
    if work == "demux":
        with av.open(str(path)) as container:
            count = sum(1 for _ in container.demux(container.streams.video[0]))
    elif work == "decode":
        with av.open(str(path)) as container:
            container.streams.video[0].thread_type = "AUTO"
            count = sum(1 for _ in container.decode(container.streams.video[0]))
    else:
        object_path, plan_path, camera_path = setting(folder, names)
        text = (
            camera_path.read_text(encoding="utf-8").replace("width = 320", f"width = {WIDTH}").replace("height = 240", f"height = {HEIGHT}")
        )
        camera_path.write_text(text, encoding="utf-8")
        output = folder / "imported.mcap"
        options = ImportOptions((path,), object_path, plan_path, camera_path, ("s1",) if work == "whole" else (), whole=work == "whole")
        with prepare(options) as prepared:
            count = write(prepared, output).images
        output.unlink()
    seconds = time.perf_counter() - start
    own = time.process_time() - started
    return {"seconds": seconds, "processor": own, "memory_mb": most_memory_mb(), "frames": count}


def _child(work: str, path: Path, folder: Path) -> dict[str, float]:
    command = [sys.executable, "-m", "tests.benchmarks.importing", "--work", work, "--film", str(path), "--folder", str(folder)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    """Make the films, measure, print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bytes", type=int, default=GIGABYTE)
    parser.add_argument("--work", help="one measurement, in this process: whole, split, demux or decode")
    parser.add_argument("--film", type=Path)
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    if arguments.work:
        sys.stdout.write(json.dumps(measure(arguments.work, arguments.film, arguments.folder)))
        return
    table = Table("film", "", "frames", "s", "alone, s", "ratio", "of processor time", "most memory", box=None)
    with tempfile.TemporaryDirectory(dir=Path.cwd() / "recordings") as name:
        folder = Path(name)
        h264, mjpeg = folder / "h264.mp4", folder / "mjpeg.mov"
        make(h264, "libx264", "yuv420p", 8.0, arguments.bytes, crf="22", bf="0", preset="veryfast", g="1000")
        make(mjpeg, "mjpeg", "yuvj420p", 3.0, arguments.bytes, qmin="2", qmax="2")
        for film, work, alone in ((h264, "whole", "demux"), (h264, "split", "decode"), (mjpeg, "split", "decode")):
            _child("demux", film, folder)  # into memory
            base = min((_child(alone, film, folder) for _ in range(2)), key=lambda each: each["seconds"])
            own = min((_child(work, film, folder) for _ in range(2)), key=lambda each: each["seconds"])
            ratio, busy = base["seconds"] / own["seconds"], base["processor"] / own["processor"]
            size = f"{film.stat().st_size / 1e9:.2f} GB {film.stem}"
            table.add_row(
                size,
                work,
                f"{own['frames']:.0f}",
                f"{own['seconds']:.1f}",
                f"{alone} {base['seconds']:.1f}",
                f"{ratio:.2f}",
                f"{busy:.2f}",
                f"{own['memory_mb']:.0f} MB",
            )
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
