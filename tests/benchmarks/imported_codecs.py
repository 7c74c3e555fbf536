"""phi and c from the same virtual strikes, recorded live and imported from other cameras' formats.

Each strike window of a virtual rig's recording becomes a file, with the images' own times: H.264 visually
lossless and as a phone writes it (with B-frames and without), FFV1, MJPEG, a folder of PNG; a Foxglove MCAP
file, ROS 2 bags. Then with the defects of real files: a variable frame rate, slow motion, rotation, a dropped
stretch, cut short. `python -m tests.benchmarks.imported_codecs FILE.mcap` prints the table.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import click
import cv2
import numpy as np
from av.video.stream import VideoStream

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.pipeline.estimate import Estimate
from analyze.pipeline.estimate_recordings import estimate_recordings
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from analyze.sources.open_source import SourceOptions
from analyze.types import ImageFrame
from schemas.session_manifest import OBJECT_ATTACHMENT, PLAN_ATTACHMENT, RIG_ATTACHMENT
from schemas.strike_result import Verdict
from tests.benchmarks.imported_topics import foxglove_file, ros_colour_bag, ros_jpeg_bag

MICROSECONDS = Fraction(1, 1_000_000)


def encode_video(
    path: Path,
    codec: str,
    pixels: str,
    options: dict[str, str],
    frames: Iterable[ImageFrame],
    rate: int,
    turned_deg: int = 0,
    slower: int = 1,
) -> None:
    """Encode images with their own times, or `slower` times as slow; `turned_deg` is the display rotation."""
    with av.open(
        str(path), "w", options={"video_track_timescale": "1000000"} if path.suffix == ".mp4" else {}
    ) as container:
        stream: VideoStream | None = None
        start_ns = 0
        for frame in frames:
            if stream is None:
                stream = cast(VideoStream, container.add_stream(codec, rate=rate, options=options))
                stream.height, stream.width = frame.image.shape
                stream.pix_fmt = pixels
                stream.codec_context.time_base = MICROSECONDS
                stream.set_display_rotation(turned_deg)
                start_ns = frame.time_ns
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame.image), format="gray").reformat(
                format=pixels
            )
            picture.pts, picture.time_base = slower * (frame.time_ns - start_ns) // 1000, MICROSECONDS
            container.mux(stream.encode(picture))
        if stream is not None:
            container.mux(stream.encode(None))


def png_folder(path: Path, frames: Iterable[ImageFrame]) -> None:
    """Write PNG images with a CSV file of their times."""
    path.mkdir()
    with (path / "times.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["name", "time_s"])
        for number, frame in enumerate(frames):
            cv2.imwrite(str(path / f"{number:05d}.png"), frame.image)
            rows.writerow([f"{number:05d}.png", f"{frame.time_ns * 1e-9:.9f}"])


def thinned(frames: Iterable[ImageFrame]) -> Iterator[ImageFrame]:
    """Images without a random fifth of them: a variable frame rate."""
    rng = np.random.default_rng(1)
    return (frame for frame in frames if rng.random() > 0.2)


def interrupted(frames: Iterable[ImageFrame]) -> Iterator[ImageFrame]:
    """Yield the images without those of a gap of 1/12 s, from 0.4 s after the first one.

    A window begins some 0.3 s before the impact, so that the gap is in the tip of most strikes.
    """
    start_ns = None
    for frame in frames:
        start_ns = frame.time_ns if start_ns is None else start_ns
        if not 0.4 < 1e-9 * (frame.time_ns - start_ns) < 0.4 + 1 / 12:
            yield frame


@dataclass(frozen=True)
class Format:
    """File format, with its encoder."""

    name: str
    suffix: str
    make: Callable[[Path, Iterable[ImageFrame]], None]
    source: SourceOptions = field(default_factory=SourceOptions)


def _video(
    codec: str, pixels: str, rate: int, **options: str
) -> Callable[[Path, Iterable[ImageFrame]], None]:
    return lambda path, frames: encode_video(path, codec, pixels, options, frames, rate)


def _defective(rate: int) -> list[Format]:
    """H.264 at crf 12, with the defects of real files."""
    options = {"preset": "veryfast", "g": str(rate), "crf": "12", "bf": "0"}

    def coded(path: Path, frames: Iterable[ImageFrame], turned_deg: int = 0, slower: int = 1) -> None:
        encode_video(path, "libx264", "yuv420p", options, frames, rate, turned_deg, slower)

    def cut_short(path: Path, frames: Iterable[ImageFrame]) -> None:
        coded(path, frames)
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size * 4 // 5)

    slower = SourceOptions(capture_hz=float(rate))
    return [
        Format("variable frame rate", ".mp4", lambda path, frames: coded(path, thinned(frames))),
        Format(
            "stated rate an eighth of the true one, `--capture-fps`",
            ".mp4",
            lambda path, frames: coded(path, frames, slower=8),
            slower,
        ),
        Format(
            "display rotation of 90 deg",
            ".mp4",
            lambda path, frames: coded(path, frames, turned_deg=-90),
        ),
        Format(
            "a twelfth of a second missing in the tip",
            ".mp4",
            lambda path, frames: coded(path, interrupted(frames)),
        ),
        Format("cut short (MKV)", ".mkv", cut_short),
        Format("cut short (MP4)", ".mp4", cut_short),
    ]


def formats(rate: int) -> list[Format]:
    """All formats: H.264 nearly lossless and as phones write it, formats of measuring cameras, images."""
    fast = {"preset": "veryfast", "g": str(rate)}
    return [
        Format("H.264 crf 12", ".mp4", _video("libx264", "yuv420p", rate, crf="12", bf="0", **fast)),
        Format("H.264 crf 28", ".mp4", _video("libx264", "yuv420p", rate, crf="28", bf="0", **fast)),
        Format(
            "H.264 crf 28, B-frames", ".mp4", _video("libx264", "yuv420p", rate, crf="28", bf="3", **fast)
        ),
        Format("FFV1", ".mkv", _video("ffv1", "gray", rate)),
        Format("MJPEG q 3", ".mkv", _video("mjpeg", "yuvj420p", rate, qmin="3", qmax="3")),
        Format("PNG folder", "", png_folder),
        Format("Foxglove MCAP, mono8", ".mcap", foxglove_file),
        Format("ROS 2 bag (sqlite3), bgr8", "", ros_colour_bag),
        Format("ROS 2 bag (mcap), JPEG", "", ros_jpeg_bag),
        *_defective(rate),
    ]


def strikes_of(recording_path: Path, file_format: Format, folder: Path) -> tuple[list[Path], list[str]]:
    """Write a file per strike; return the files, and the id of the planned strike of each."""
    files, planned = [], []
    with open_recording(recording_path) as recording:
        for record in recording.strikes:
            path = folder / f"{record.strike_id}{file_format.suffix}"
            file_format.make(
                path, recording.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns)
            )
            recording.release_memory()
            files.append(path)
            planned.append(record.plan_strike_id)
    return files, planned


def attached(recording_path: Path, folder: Path) -> tuple[Path, Path, Path]:
    """Object, plan and rig file of a recording."""
    with open_recording(recording_path) as recording:
        names = (OBJECT_ATTACHMENT, PLAN_ATTACHMENT, RIG_ATTACHMENT)
        for name in names:
            (folder / name).write_bytes(recording.attachments[name])
    first, second, third = (folder / name for name in names)
    return first, second, third


def _row(name: str, live: Estimate, other: Estimate, truth: np.ndarray, ratio: str) -> str:
    def phis(estimate: Estimate) -> dict[str, float]:
        return {
            motion.strike_id: motion.fit.phi for motion in estimate.evidence.motions if motion.fit is not None
        }

    mine, theirs = phis(live), phis(other)
    off = np.degrees([theirs[key] - mine[key] for key in mine if key in theirs])
    com = other.com.position
    moved = 1000 * np.linalg.norm(com - live.com.position)
    verdicts = sum(motion.verdict is Verdict.GOOD for motion in other.evidence.motions)
    median, worst = (np.median(np.abs(off)), np.max(np.abs(off))) if len(off) else (np.nan, np.nan)
    error = 1000 * np.linalg.norm(com - truth)
    return f"| {name} | {verdicts} | {median:.4f} | {worst:.4f} | {moved:.3f} | {error:.3f} | {ratio} |"


def main() -> None:
    """Estimate from every format and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--only", help="part of the names of the formats to be tried")
    arguments = parser.parse_args()
    live = estimate_recordings([arguments.recording])
    truth = np.array(read_truth(arguments.recording).body.com_object)
    rate = round(live.evidence.manifest.cameras[0].frame_rate_hz)
    click.echo(
        "| | good strikes | phi minus live, median, deg | worst | c from live, mm | c from ground truth, mm "
        "| recording / file |"
    )
    click.echo("|---|---|---|---|---|---|---|")
    click.echo(_row("live", live, live, truth, ""))
    for file_format in formats(rate):
        if arguments.only and arguments.only not in file_format.name:
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            object_path, plan_path, rig_path = attached(arguments.recording, folder)
            files, planned = strikes_of(arguments.recording, file_format, folder)
            output = folder / "imported.mcap"
            options = ImportOptions(
                tuple(files),
                object_path,
                plan_path,
                rig_path,
                tuple(planned),
                whole=True,
                source=file_format.source,
            )
            try:
                with prepare(options) as prepared:
                    written = write_recording(prepared, output)
            except ImportRefused as error:
                click.echo(
                    f"| {file_format.name} | refused: {str(error).removeprefix(f'{folder}/')} |  |  |  |  |  "
                    "|"
                )
                continue
            size = sum(
                file.stat().st_size
                for path in files
                for file in (path.rglob("*") if path.is_dir() else [path])
            )
            click.echo(
                _row(
                    file_format.name, live, estimate_recordings([output]), truth, f"{written.size / size:.2f}"
                )
            )


if __name__ == "__main__":
    main()
