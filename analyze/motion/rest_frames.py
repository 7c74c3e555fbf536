"""Frames before and after the motion of a strike that is followed by the object's print."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import TrackingError
from analyze.tracking.print_follower import THETA

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.tracking.print_follower import PrintPose
    from analyze.types import Array, ImageFrame

_REST_BEFORE_CONTACT_NS = 4_000_000
"""time before the contact by which a resting frame's exposure must have ended [ns]"""
_LEAST_REST = 3
"""least number of frames at rest"""
_MOVED_NOISE = 4.0
"""change of grey against the first images, over that among them, above which the object moves"""
_MOVED_SHARE = 0.06
"""the same over the largest change: coding leaves no noise in the first images, and lets still ones drift"""
_SETTLED_RAD, _AFTER_LANDING_S = math.radians(1.0), 0.1
"""distance from the last tip within which the object has landed [rad], and time after the landing that still
belongs to the motion [s]"""


def frames_at_rest(frames: Sequence[ImageFrame], contact_time_ns: int) -> int:
    """Number of the first frames in which the object is at rest.

    Without a known contact these are the frames before the grey values change by more than noise.

    Raises:
        TrackingError: there are fewer than three.
    """
    if contact_time_ns:
        count = sum(frame.time_ns < contact_time_ns - _REST_BEFORE_CONTACT_NS for frame in frames)
    else:
        count = _frames_before_change(frames)
    if count < _LEAST_REST:
        raise TrackingError(
            f"{count} images show the object at rest, {_LEAST_REST} are needed: start the recording earlier"
        )
    return count


def _frames_before_change(frames: Sequence[ImageFrame]) -> int:
    """Number of frames before the grey values change by more than noise and coding do, twice in a row."""
    if len(frames) < 2 * _LEAST_REST:
        return 0
    small = np.array([frame.image[::4, ::4].astype(np.float32) for frame in frames])
    first = small[:_LEAST_REST].mean(axis=0)
    change = np.quantile(np.abs(small - first), 0.98, axis=(1, 2))
    moving = change > max(_MOVED_NOISE * np.median(change[:_LEAST_REST]), _MOVED_SHARE * change.max())
    both = moving[:-1] & moving[1:]
    return max(int(np.argmax(both)) - 1, 0) if both.any() else len(frames)


def end_of_motion(poses: Sequence[PrintPose], times_s: Array) -> int:
    """Number of frames until the object has landed, or come back to rest; all if it does not move.

    Args:
        poses: (n,) poses of the frames.
        times_s: (n,) their times [s].
    """
    seen = [
        (time_s, float(pose.x[THETA])) for pose, time_s in zip(poses, times_s, strict=True) if pose.explained
    ]
    final = float(np.median([theta for _, theta in seen[-_LEAST_REST:]])) if seen else 0.0
    moving = [time_s for time_s, theta in seen if abs(theta - final) > _SETTLED_RAD]
    return int(np.sum(times_s <= moving[-1] + _AFTER_LANDING_S)) if moving else len(poses)
