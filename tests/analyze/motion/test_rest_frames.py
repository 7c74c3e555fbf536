"""Frames before and after the motion of a strike that is followed by the object's print."""

from types import SimpleNamespace

import numpy as np
import pytest

from analyze.errors import TrackingError
from analyze.motion.rest_frames import end_of_motion, frames_at_rest
from analyze.types import ImageFrame


def _frames(greys: list[float], size: int = 64) -> list[ImageFrame]:
    """Frames with a bar whose grey values change as given."""
    images = [np.full((size, size), 90, np.uint8) for _ in greys]
    for image, grey in zip(images, greys, strict=True):
        image[:, 20:40] += np.uint8(grey)
    return [ImageFrame(number * 10**7, number, image) for number, image in enumerate(images)]


def test_a_coded_video_may_drift_while_the_object_rests():
    drift = [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]
    assert frames_at_rest(_frames([*drift, 30, 60, 80, 80]), 0) == len(drift) - 1


def test_too_few_images_at_rest_are_refused():
    with pytest.raises(TrackingError, match=r"2 images show the object at rest, 3 are needed"):
        frames_at_rest(_frames([0, 0, 30, 60, 80, 80, 80, 80]), 0)


@pytest.mark.parametrize("end", [0.0, 1.5])
def test_motion_ends_with_the_landing_or_back_at_rest(end):
    theta = np.concatenate([np.zeros(10), np.linspace(0, 1.2, 20), np.full(50, end)])
    poses = [SimpleNamespace(x=np.array([each]), explained=1.0) for each in theta]
    poses[-1].explained = 0.0
    times_s = np.arange(len(theta)) / 120
    assert end_of_motion(poses, times_s) == 30 + 12
