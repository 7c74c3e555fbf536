"""Images of a strike: thinned and as JPEG, unless more is asked.

rerun 0.41 draws no encoded image at a negative time, which frames before the contact have: a few of them go along as plain images, under
the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import rerun as rr

if TYPE_CHECKING:
    from analyze.replay.timelines import Timelines
    from analyze.types import ImageFrame

FRAME_RATE = 60.0
"""Hz, of what is shown of faster cameras"""
_QUALITY = 82
_MOST_BEFORE = 10
"""plain images before the contact, where the object rests: each is as large as the camera's"""
_BATCH = 24
"""images sent at once: few enough that the first are there soon"""
_UNDER = -11.0
"""images are drawn at -10"""
_PNG_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]


@dataclass(frozen=True)
class ImageChoice:
    """Which images are shown, and how."""

    every_frame: bool = False
    """False: at most `FRAME_RATE`"""
    lossless: bool = False
    """PNG; False: JPEG"""


def thinned(frames: Iterable[ImageFrame], rate_hz: float) -> Iterator[ImageFrame]:
    """Frames at most so often."""
    shown_ns: int | None = None
    for frame in frames:
        if shown_ns is None or frame.time_ns - shown_ns >= 0.9e9 / rate_hz:
            shown_ns = frame.time_ns
            yield frame


def send_pictures(
    timelines: Timelines, path: str, frames: Iterable[ImageFrame], contact_ns: int | None, choice: ImageChoice | None = None
) -> int:
    """Send images as they come; how many there were.

    Raises:
        RecordingError: whatever reading `frames` raises; what came before it is sent.
    """
    choice = choice or ImageChoice()
    waiting: list[tuple[int, bytes]] = []
    before: _Before | None = None
    count = 0
    try:
        for frame in frames if choice.every_frame else thinned(frames, FRAME_RATE):
            before = before or _Before(timelines, f"{path}_before", frame, contact_ns, choice)
            before.take(frame)
            waiting.append((frame.time_ns, _encoded(frame.image, choice)))
            count += 1
            if len(waiting) == _BATCH:
                _send(timelines, path, waiting, contact_ns, choice)
                waiting.clear()
    finally:
        _send(timelines, path, waiting, contact_ns, choice)
    return count


class _Before:
    """Plain images until the contact."""

    def __init__(self, timelines: Timelines, path: str, first: ImageFrame, contact_ns: int | None, choice: ImageChoice) -> None:
        self._timelines, self._path, self._contact_ns = timelines, path, contact_ns
        self._next_ns = first.time_ns
        self._step_ns = 0 if contact_ns is None or choice.every_frame else max(0, contact_ns - first.time_ns) // _MOST_BEFORE
        if contact_ns is not None and first.time_ns < contact_ns:
            timelines.stream.log(path, rr.Image.from_fields(draw_order=_UNDER), static=True)

    def take(self, frame: ImageFrame) -> None:
        """Send it, if it is time for one."""
        if self._contact_ns is None or not self._next_ns <= frame.time_ns < self._contact_ns:
            return
        self._next_ns = frame.time_ns + self._step_ns
        self._timelines.at(frame.time_ns, self._contact_ns)
        self._timelines.stream.log(self._path, rr.Image(frame.image))


def _encoded(image: np.ndarray, choice: ImageChoice) -> bytes:
    if choice.lossless:
        _, data = cv2.imencode(".png", image, _PNG_FAST)
    else:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()


def _send(timelines: Timelines, path: str, images: list[tuple[int, bytes]], contact_ns: int | None, choice: ImageChoice) -> None:
    if not images:
        return
    kind = "image/png" if choice.lossless else "image/jpeg"
    timelines.stream.send_columns(
        path,
        indexes=timelines.columns(np.array([time_ns for time_ns, _ in images]), contact_ns),
        columns=rr.EncodedImage.columns(blob=[data for _, data in images], media_type=[kind] * len(images)),
    )
