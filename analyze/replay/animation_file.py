"""Write pictures as an animation of limited size: WebP, GIF or MP4."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.replay.viewer import ReplayError
from schemas.output_file import write_bytes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.progress import Progress

    Pictures = Sequence[NDArray[np.uint8]]

MAX_BYTES = 2_000_000
"""size [bytes] below which an animation is encoded, as pages and mails accept"""
RATE_HZ = 20
"""pictures shown per second"""
HOLD_S = 2.0
"""time [s] for which the last picture stays before the animation begins anew"""
_SAMPLED = 6
"""one of so many pictures is encoded to choose the quality"""


@dataclass(frozen=True)
class Quality:
    """Quality at which an animation is encoded."""

    scale: float
    """size of the pictures relative to the drawn one"""
    level: int
    """the encoder's own number: quality of WebP (0 to 100), colours of GIF, constant rate factor of MP4"""


@dataclass(frozen=True)
class _Encoder:
    """Encoder of one file format, and the qualities to try, the best first."""

    encode: Callable[[Pictures, int], bytes]
    """from pictures of one size and the level of quality to the file's content"""
    qualities: tuple[Quality, ...]
    """qualities to try; the last one is taken if even that exceeds the limit"""


def refuse_other_suffix(output: Path) -> None:
    """Raise ReplayError unless the file's suffix names a format of animations.

    Raises:
        ReplayError: it names none.
    """
    if output.suffix.lower() not in _ENCODERS:
        raise ReplayError(
            f"{output}: an animation is {', '.join(sorted(_ENCODERS))}, by its suffix: name it "
            f"{output.with_suffix('.webp').name}"
        )


def write_animation(pictures: Pictures, output: Path, progress: Progress, max_bytes: int = MAX_BYTES) -> int:
    """Encode pictures as an animation that repeats, and write it; the format is that of the suffix.

    The quality is the best one with which the file is not larger than `max_bytes`, or the least.

    Args:
        pictures: RGB pictures (height, width, 3), at least one; all of one size, height and width even.
        output: the file, which appears complete or not at all.
        progress: called with (name of the step, units of work done, units in all).
        max_bytes: greatest size [bytes].

    Returns:
        Size of the file [bytes].

    Raises:
        ReplayError: the suffix names no format of animations.
        OutputError: the file cannot be written.
    """
    refuse_other_suffix(output)
    encoder = _ENCODERS[output.suffix.lower()]
    sample = pictures[:: min(_SAMPLED, max(1, len(pictures) // 3))]
    last = len(encoder.qualities) - 1
    for number, quality in enumerate(encoder.qualities):
        progress(f"encoding {output.name}", number, last + 1)
        # Pictures further apart have more to encode: the sample's size is an upper estimate.
        estimated = len(_encoded(encoder, sample, quality)) * len(pictures) / len(sample)
        if estimated > 2 * max_bytes and number < last:
            continue
        data = _encoded(encoder, pictures, quality)
        if len(data) <= max_bytes or number == last:
            write_bytes(output, data)
            return len(data)
    raise AssertionError("the last quality is always taken")


def _encoded(encoder: _Encoder, pictures: Pictures, quality: Quality) -> bytes:
    if quality.scale < 1.0:
        height, width = pictures[0].shape[:2]
        # Video encoders require even numbers.
        size = tuple(2 * round(quality.scale * each / 2) for each in (width, height))
        smaller = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in pictures)
        pictures = [np.asarray(each, dtype=np.uint8) for each in smaller]
    return encoder.encode(pictures, quality.level)


def _durations_ms(pictures: Pictures) -> list[int]:
    return [1000 // RATE_HZ] * (len(pictures) - 1) + [round(1000 * HOLD_S)]


def _webp(pictures: Pictures, level: int) -> bytes:
    from PIL import Image

    first, *others = (Image.fromarray(each) for each in pictures)
    buffer = io.BytesIO()
    settings = {"duration": _durations_ms(pictures), "loop": 0, "quality": level, "method": 4}
    first.save(buffer, "WEBP", save_all=True, append_images=others, **settings)
    return buffer.getvalue()


def _gif(pictures: Pictures, level: int) -> bytes:
    from PIL import Image

    # One palette for all: with one each, colours would flicker.
    few = np.vstack([each[::3, ::3] for each in pictures])
    palette = Image.fromarray(few).quantize(level, Image.Quantize.MEDIANCUT)
    reduced = [Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    buffer = io.BytesIO()
    durations = _durations_ms(pictures)
    reduced[0].save(buffer, "GIF", save_all=True, append_images=reduced[1:], duration=durations, loop=0)
    return buffer.getvalue()


def _mp4(pictures: Pictures, level: int) -> bytes:
    import av
    from av.codec.codec import UnknownCodecError

    buffer = io.BytesIO()
    height, width = pictures[0].shape[:2]
    with av.open(buffer, "w", format="mp4") as container:
        options = {"crf": str(level), "preset": "medium"}
        try:
            stream = container.add_stream("libx264", rate=RATE_HZ, options=options)
        except UnknownCodecError:
            raise ReplayError(
                "the installed package av has no encoder libx264 for MP4: name a .webp file"
            ) from None
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for picture in [*pictures, *[pictures[-1]] * round(HOLD_S * RATE_HZ)]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return buffer.getvalue()


_SCALES = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.3)
_ENCODERS = {
    ".webp": _Encoder(
        _webp,
        tuple(Quality(1.0, level) for level in (85, 70, 55)) + tuple(Quality(s, 55) for s in _SCALES[1:]),
    ),
    ".gif": _Encoder(_gif, tuple(Quality(scale, 64) for scale in _SCALES)),
    ".mp4": _Encoder(
        _mp4,
        tuple(Quality(1.0, level) for level in (20, 26, 32)) + tuple(Quality(s, 32) for s in _SCALES[1:]),
    ),
}
