"""Videos of a gigabyte that the benchmark of `analyze import` reads, and the packets in them."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av
import cv2
import foxglove
import numpy as np
from foxglove.channels import CompressedImageChannel
from foxglove.messages import CompressedImage, Timestamp

from tests.analyze.importing.tip_videos import REST, angles, picture

WIDTH, HEIGHT, RATE = 1280, 960, 240
STRIKES, LARGE_STRIKES = 9, 4
"""number of strikes in a video of a gigabyte, and in one of half-megabyte pictures, so that the object rests
before each"""
GIGABYTE = 10**9


def images(noise: float) -> list[np.ndarray]:
    """Images of a resting box and, after REST frames, of its tip, with sensor noise.

    They are four times as large as those of tip_videos.py.
    """
    random = np.random.default_rng(1)
    found = []
    for theta in angles():
        large = cv2.resize(picture(float(theta)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        found.append(np.clip(large + random.normal(0, noise, large.shape), 0, 255).astype(np.uint8))
    return found


def packets(
    codec: str, pixels: str, pictures: list[np.ndarray], options: dict[str, str]
) -> tuple[bytes, list[bytes]]:
    """Decoder configuration, and one encoded packet per picture."""
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


def make(
    path: Path, codec: str, pixels: str, noise: float, size: int, strikes: int, /, **options: str
) -> None:
    """Write a video of about `size` bytes with tips."""
    pictures = images(noise)
    _, rest = packets(codec, pixels, pictures[:REST], options)
    extra, tip = packets(codec, pixels, pictures, options)
    written = 0
    with av.open(
        str(path), "w", options={"video_track_timescale": "240000"} if path.suffix in {".mp4", ".mov"} else {}
    ) as container:
        stream = container.add_stream(codec, rate=RATE)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        if extra:
            stream.codec_context.extradata = extra
        stream.codec_context.options = options
        for group in _stretches(rest, tip, size, strikes):
            for number, data in enumerate(group):
                packet = av.Packet(data)
                packet.stream, packet.time_base = stream, Fraction(1, RATE)
                packet.pts = packet.dts = written
                packet.is_keyframe = codec != "libx264" or number == 0
                container.mux(packet)
                written += 1


def _stretches(rest: list[bytes], tip: list[bytes], size: int, strikes: int) -> Iterator[list[bytes]]:
    """Encoded stretches at rest and tips, of about `size` bytes together."""
    between = max(1, (size // strikes - sum(map(len, tip))) // sum(map(len, rest)))
    for _ in range(strikes):
        yield from [rest] * between
        yield tip


def make_files(path: Path, suffix: str, noise: float, size: int, strikes: int) -> None:
    """Write a folder of image files with a CSV of times, or a topic of images if `path` is an MCAP file."""
    coded = [cv2.imencode(suffix, each)[1].tobytes() for each in images(noise)]
    times_ns = (round(number * 1e9 / RATE) for number in range(10**9))
    timed = zip(times_ns, chain.from_iterable(_stretches(coded[:REST], coded, size, strikes)), strict=False)
    if path.suffix == ".mcap":
        context = foxglove.Context()
        with foxglove.open_mcap(path, context=context, allow_overwrite=True):
            channel = CompressedImageChannel("/camera/image", context=context)
            for time_ns, data in timed:
                stamp = Timestamp(1_790_000_000 + time_ns // 10**9, time_ns % 10**9)
                channel.log(
                    CompressedImage(timestamp=stamp, format=suffix[1:], data=data),
                    log_time=1_790_000_000 * 10**9 + time_ns,
                )
        return
    path.mkdir()
    with (path / "times.csv").open("w", encoding="ascii") as rows:
        rows.write("name,time_s\n")
        for number, (time_ns, data) in enumerate(timed):
            (path / f"{number:06d}{suffix}").write_bytes(data)
            rows.write(f"{number:06d}{suffix},{time_ns * 1e-9:.9f}\n")
