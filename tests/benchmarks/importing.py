"""Cost of `analyze import` on a gigabyte compared with its peers: time, CPU time, memory, output size.

A video of a resting tag with a tip now and then is encoded once, and its packets are repeated until the file
is large. Every measurement is a process of its own; they take turns, and the fastest turn of each counts.
Peers are demuxing or decoding alone, which write nothing; writing as many bytes alone; demuxing with plain
`write()` of every packet; the same with another thread that writes; remuxing by FFmpeg. The faster of the two
that demux and write is the lower limit for an import that writes as many bytes. "From disk": the file is
evicted from the page cache before each turn, for all alike.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import av
from rich.console import Console
from rich.table import Table

from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.reading.image_message import decode_image_file
from analyze.sources.message_files import open_message_file
from analyze.sources.pictures import grey_values, parse_picture
from tests.analyze.importing.tip_videos import setting
from tests.benchmarks.imported_videos import GIGABYTE, HEIGHT, LARGE_STRIKES, STRIKES, WIDTH, make, make_files

TURNS = 3
BLOCK = 1 << 20
Figures = dict[str, float]


def most_memory_mb() -> float:
    """Peak memory [MB] of this process; `ru_maxrss` would be its parent's if that is larger."""
    [line] = [
        line
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        if line.startswith("VmHWM")
    ]
    return int(line.split()[1]) / 1024


def measure(work: str, path: Path, folder: Path, strikes: int) -> Figures:
    """Run one measurement in this process: seconds, CPU time, peak memory [MB], frames and bytes written."""
    output = folder / f"written{'.mcap' if work in {'whole', 'split'} else path.suffix}"
    start, started = time.perf_counter(), time.process_time()
    count = (
        _imported(work, path, folder, output, strikes)
        if work in {"whole", "split"}
        else _PEERS[work](path, output)
    )
    seconds = time.perf_counter() - start
    own = time.process_time() - started
    written = output.stat().st_size if output.exists() else 0
    output.unlink(missing_ok=True)
    return {
        "seconds": seconds,
        "processor": own,
        "memory_mb": most_memory_mb(),
        "frames": count,
        "bytes": written,
    }


def _imported(work: str, path: Path, folder: Path, output: Path, strikes: int) -> int:
    names = [f"s{number + 1}" for number in range(strikes)]
    object_path, plan_path, camera_path = setting(folder, names)
    text = (
        camera_path.read_text(encoding="utf-8")
        .replace("width = 320", f"width = {WIDTH}")
        .replace("height = 240", f"height = {HEIGHT}")
    )
    camera_path.write_text(text, encoding="utf-8")
    whole = work == "whole"
    options = ImportOptions(
        (path,), object_path, plan_path, camera_path, ("s1",) if whole else (), whole=whole, aside=folder
    )
    with prepare(options) as prepared:
        return write_recording(prepared, output).images


def _size(path: Path) -> int:
    """Bytes of a file, or of a folder's files."""
    return sum(each.stat().st_size for each in path.iterdir()) if path.is_dir() else path.stat().st_size


def _demux(path: Path, output: Path) -> int:
    del output
    with av.open(str(path)) as container:
        return sum(1 for _ in container.demux(container.streams.video[0]))


def _decode(path: Path, output: Path) -> int:
    del output
    if path.is_dir():
        return sum(decode_image_file(each.read_bytes()) is not None for each in sorted(path.glob("0*")))
    if path.suffix == ".mcap":
        file = open_message_file(path)
        [topic] = file.topics()
        pictures = (
            parse_picture(topic.encoding, topic.schema, message.data) for message in file.messages(topic)
        )
        return sum(1 for picture in pictures if grey_values(picture).size)
    with av.open(str(path)) as container:
        container.streams.video[0].thread_type = "AUTO"
        return sum(1 for _ in container.decode(container.streams.video[0]))


def _write(path: Path, output: Path) -> int:
    block = os.urandom(BLOCK)
    with output.open("wb", buffering=0) as file:
        for _ in range(path.stat().st_size // BLOCK):
            file.write(block)
    return 0


def _demux_and_write(path: Path, output: Path) -> int:
    count = 0
    with av.open(str(path)) as container, output.open("wb", buffering=BLOCK) as file:
        for packet in container.demux(container.streams.video[0]):
            file.write(packet)
            count += 1
    return count


def _written_beside(path: Path, output: Path) -> int:
    waiting: queue.Queue[bytes] = queue.Queue(4)
    group, size, count = list[av.Packet](), 0, 0
    with av.open(str(path)) as container, output.open("wb", buffering=0) as file:
        writer = threading.Thread(target=lambda: [file.write(block) for block in iter(waiting.get, b"")])
        writer.start()
        for packet in container.demux(container.streams.video[0]):
            group.append(packet)
            count, size = count + 1, size + packet.size
            if size >= BLOCK:
                waiting.put(b"".join(group))
                group, size = [], 0
        waiting.put(b"".join(group))
        waiting.put(b"")
        writer.join()
    return count


def _remux(path: Path, output: Path) -> int:
    count = 0
    with av.open(str(path)) as container, av.open(str(output), "w") as other:
        stream = container.streams.video[0]
        copy = other.add_stream_from_template(stream)
        for packet in container.demux(stream):
            if packet.dts is not None:
                packet.stream = copy
                other.mux(packet)
                count += 1
    return count


_PEERS = {
    "demux": _demux,
    "decode": _decode,
    "write": _write,
    "demux and write": _demux_and_write,
    "demux, write beside": _written_beside,
    "remux": _remux,
}


def _forget(path: Path) -> None:
    """Evict the file from the page cache."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _child(work: str, path: Path, folder: Path, strikes: int) -> Figures:
    command = [
        sys.executable,
        "-m",
        "tests.benchmarks.importing",
        "--work",
        work,
        "--film",
        str(path),
        "--folder",
        str(folder),
    ]
    command += ["--strikes", str(strikes)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def turns(
    path: Path,
    folder: Path,
    works: Sequence[str],
    count: int = TURNS,
    *,
    cold: bool = False,
    strikes: int = STRIKES,
) -> dict[str, Figures]:
    """Fastest of `count` turns of each measurement."""
    if not cold and path.suffix in {".mp4", ".mov"}:
        _child("demux", path, folder, strikes)  # into memory
    found: dict[str, list[Figures]] = {work: [] for work in works}
    for _ in range(count):
        for work in works:
            if cold:
                _forget(path)
            found[work].append(_child(work, path, folder, strikes))
    return {work: min(each, key=lambda figures: figures["seconds"]) for work, each in found.items()}


def print_figures(name: str, path: Path, found: dict[str, Figures], own: str) -> None:
    """Print the table of one file: time of each measurement, and its ratio to the import's."""
    size = _size(path)
    written = f"{found[own]['frames']:.0f} frames written, recording / file {found[own]['bytes'] / size:.3f}"
    title = f"{size / 1e9:.2f} GB of {name}, {written}"
    table = Table(
        "",
        "s",
        "over the import's",
        "processor, s",
        "over the import's",
        "most memory",
        title=title,
        box=None,
        title_justify="left",
    )
    for work, figures in found.items():
        ratio, busy = (
            figures["seconds"] / found[own]["seconds"],
            figures["processor"] / found[own]["processor"],
        )
        shown = ("", "") if work == own else (f"{ratio:.2f}", f"{busy:.2f}")
        word = f"import, {work}" if work == own else work
        seconds, processor = f"{figures['seconds']:.2f}", f"{figures['processor']:.2f}"
        table.add_row(word, seconds, shown[0], processor, shown[1], f"{figures['memory_mb']:.0f} MB")
    Console(width=120).print(table)


def _kept_videos(folder: Path, size: int) -> None:
    """Print the tables of H.264."""
    h264, phone = folder / "h264.mp4", folder / "phone.mp4"
    usual = {"bf": "0", "preset": "veryfast", "g": "1000"}
    kept = ("write", "demux", "demux and write", "demux, write beside", "remux", "whole")
    make(h264, "libx264", "yuv420p", 8.0, size, STRIKES, crf="22", **usual)
    print_figures("H.264 of 9 kB a picture, from memory", h264, turns(h264, folder, kept), "whole")
    print_figures(
        "H.264 of 9 kB a picture, from disk", h264, turns(h264, folder, kept[1:], cold=True), "whole"
    )
    make(h264, "libx264", "yuv420p", 8.0, size // 4, STRIKES, crf="22", **usual)
    print_figures(
        "H.264 of 9 kB a picture, split", h264, turns(h264, folder, ("decode", "split"), 2), "split"
    )
    h264.unlink()
    make(phone, "libx264", "yuv420p", 8.0, size, STRIKES, crf="20", **usual)
    print_figures("H.264 of 77 kB a picture, from memory", phone, turns(phone, folder, kept), "whole")
    print_figures(
        "H.264 of 77 kB a picture, from disk", phone, turns(phone, folder, kept[1:], cold=True), "whole"
    )
    phone.unlink()


def _images(folder: Path, size: int) -> None:
    """Print the tables of formats that are decoded, with only the strikes' windows stored."""
    mjpeg, ffv1 = folder / "mjpeg.mov", folder / "ffv1.mkv"
    works = ("decode", "split")
    make(mjpeg, "mjpeg", "yuvj420p", 3.0, size, STRIKES, qmin="2", qmax="2")
    print_figures("Motion JPEG", mjpeg, turns(mjpeg, folder, works, 2), "split")
    mjpeg.unlink()
    make(ffv1, "ffv1", "gray", 3.0, size, LARGE_STRIKES, level="3", slices="4")
    print_figures("FFV1", ffv1, turns(ffv1, folder, works, 2, strikes=LARGE_STRIKES), "split")
    ffv1.unlink()
    cases = (
        ("a folder of PNG", ".png", LARGE_STRIKES),
        ("a folder of JPEG", ".jpeg", STRIKES),
        ("a topic of JPEG", ".jpeg", STRIKES),
    )
    for name, suffix, strikes in cases:
        path = folder / ("topic.mcap" if "topic" in name else "images")
        make_files(path, suffix, 3.0, size, strikes)
        print_figures(name, path, turns(path, folder, works, 2, strikes=strikes), "split")
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def main() -> None:
    """Make the files, measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bytes", type=int, default=GIGABYTE)
    parser.add_argument("--work", help="run one measurement in this process")
    parser.add_argument("--film", type=Path)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--strikes", type=int, default=STRIKES)
    parser.add_argument("--images", action="store_true", help="only formats that are not kept as a video")
    arguments = parser.parse_args()
    if arguments.work:
        sys.stdout.write(
            json.dumps(measure(arguments.work, arguments.film, arguments.folder, arguments.strikes))
        )
        return
    with tempfile.TemporaryDirectory(dir=Path.cwd() / "recordings") as name:
        folder = Path(name)
        if not arguments.images:
            _kept_videos(folder, arguments.bytes)
        _images(folder, arguments.bytes)


if __name__ == "__main__":
    main()
