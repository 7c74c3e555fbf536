"""Send the images of a strike to a replay, by default reduced in rate and encoded as JPEG.

The viewer rerun 0.41 does not draw encoded images at negative times, which frames before the contact have. A
few of those frames are therefore sent as plain images as well, drawn beneath the others.
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
"""Greatest rate [Hz] at which images are sent by default."""
_JPEG_QUALITY = 82
_MAX_PLAIN_IMAGES = 10
"""Approximate number of plain images before the contact, where the object rests, unless all frames are sent:
each has the full size of the camera's image."""
_BATCH = 24
"""Images sent together: few, so that the first ones arrive soon."""
_DRAW_ORDER_BENEATH = -11.0
"""Draw order below that of rerun's images, -10."""
_PNG_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]


@dataclass(frozen=True)
class ImageChoice:
    """Selection and encoding of the images that a replay sends."""

    every_frame: bool = False
    """True to send all frames, False to send at most `FRAME_RATE` per second."""
    lossless: bool = False
    """True for PNG, False for JPEG."""


def limit_frame_rate(frames: Iterable[ImageFrame], rate_hz: float) -> Iterator[ImageFrame]:
    """Yield frames thinned to about `rate_hz` [Hz]: each at least 0.9 / rate_hz after the last one kept.

    Args:
        frames: frames in order of time; the first is kept.
        rate_hz: rate [Hz].
    """
    shown_ns: int | None = None
    for frame in frames:
        if shown_ns is None or frame.time_ns - shown_ns >= 0.9e9 / rate_hz:
            shown_ns = frame.time_ns
            yield frame


def send_pictures(
    timelines: Timelines,
    path: str,
    frames: Iterable[ImageFrame],
    contact_ns: int | None,
    choice: ImageChoice,
) -> None:
    """Send images to a replay in batches as they are read, at about 60 Hz unless all are chosen.

    All are sent with `choice.every_frame`. About ten images before the contact, or all with
    `choice.every_frame`, are sent a second time without encoding, to `<path>_before`.

    Args:
        timelines: the replay's data stream to the viewer or file, with its time axes.
        path: name (entity path) of the images in the viewer.
        frames: images in order of time.
        contact_ns: log time of the strike's contact [ns]; None outside a strike.
        choice: selection and encoding.

    Raises:
        RecordingError: reading `frames` failed; the images before the failure are sent.
    """
    waiting: list[tuple[int, bytes]] = []
    before: _ImagesBeforeContact | None = None
    try:
        for frame in frames if choice.every_frame else limit_frame_rate(frames, FRAME_RATE):
            before = before or _ImagesBeforeContact(timelines, f"{path}_before", frame, contact_ns, choice)
            before.take(frame)
            waiting.append((frame.time_ns, _encoded(frame.image, choice)))
            if len(waiting) == _BATCH:
                _send(timelines, path, waiting, contact_ns, choice)
                waiting.clear()
    finally:
        _send(timelines, path, waiting, contact_ns, choice)


class _ImagesBeforeContact:
    """Sender of a strike's images before its contact, without encoding, to a replay.

    It sends about ten at equal intervals, or all with `choice.every_frame`.

    Args:
        timelines: timelines of the stream.
        path: entity of the images.
        first: first image of the strike; from its time on, images are sent.
        contact_ns: log time of the strike's contact [ns]; None if the images belong to no strike: nothing is
            sent then.
        choice: selection and encoding of the images.
    """

    def __init__(
        self, timelines: Timelines, path: str, first: ImageFrame, contact_ns: int | None, choice: ImageChoice
    ) -> None:
        self._timelines, self._path, self._contact_ns = timelines, path, contact_ns
        self._next_ns = first.time_ns
        self._step_ns = (
            0
            if contact_ns is None or choice.every_frame
            else max(0, contact_ns - first.time_ns) // _MAX_PLAIN_IMAGES
        )
        if contact_ns is not None and first.time_ns < contact_ns:
            timelines.stream.log(path, rr.Image.from_fields(draw_order=_DRAW_ORDER_BENEATH), static=True)

    def take(self, frame: ImageFrame) -> None:
        """Send a frame's image uncompressed to the viewer, if it was taken before the contact and is due.

        It is due if a fixed interval has passed since the last frame sent. Other frames are ignored.
        """
        if self._contact_ns is None or not self._next_ns <= frame.time_ns < self._contact_ns:
            return
        self._next_ns = frame.time_ns + self._step_ns
        self._timelines.set_time(frame.time_ns, self._contact_ns)
        self._timelines.stream.log(self._path, rr.Image(frame.image))


def _encoded(image: np.ndarray, choice: ImageChoice) -> bytes:
    if choice.lossless:
        _, data = cv2.imencode(".png", image, _PNG_FAST)
    else:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return data.tobytes()


def _send(
    timelines: Timelines,
    path: str,
    images: list[tuple[int, bytes]],
    contact_ns: int | None,
    choice: ImageChoice,
) -> None:
    if not images:
        return
    kind = "image/png" if choice.lossless else "image/jpeg"
    timelines.stream.send_columns(
        path,
        indexes=timelines.time_columns(np.array([time_ns for time_ns, _ in images]), contact_ns),
        columns=rr.EncodedImage.columns(blob=[data for _, data in images], media_type=[kind] * len(images)),
    )
