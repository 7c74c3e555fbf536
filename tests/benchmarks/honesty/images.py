"""Strikes through images: tags drawn on the true body, tracked and analysed as a recording's.

Each frame is drawn by tests/analyze/tracking/rendering.py, which shares nothing with the tracker. Tags lie
flat on the sides that look at the camera. Not drawn: motion within an exposure, shading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from analyze.geometry.station import turned_camera
from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.planning.view import default_camera
from analyze.tracking.track import track_markers
from analyze.types import ImageFrame, TipMotion
from schemas.strike_plan import PlannedStrike
from tests.analyze.tracking.rendering import render
from tests.benchmarks.honesty.observed import T0, View
from tests.benchmarks.honesty.struck import StruckMotion
from tests.benchmarks.honesty.tags import Tags, real_camera, seen_tags

HAND_SD = 3e-3
"""standard deviation of where the hand puts the body, along the table's x and y [m]"""
REST = 0.15
"""time filmed before the push [s]"""


def analyse_images(
    task: StrikeTask,
    made: PlannedStrike,
    tags: Tags,
    motion: StruckMotion,
    view: View,
    rng: np.random.Generator,
) -> TipMotion:
    """Motion of a strike by the tracker, from images of the true motion.

    Args:
        task: the strike as recorded, with its planned strike.
        made: the strike that was made; another one than recorded if the strike is mislabelled.
        tags: tags of the body.
        motion: true poses.
        view: frame rate, and errors of the lens.
        rng: generator of the images' noise and of the frames' phase.
    """
    calibrated = replace(default_camera(), strain_sd=view.strain_sd)
    camera, markers = turned_camera(calibrated, task.planned.heading_rad), list(tags.markers)
    report = track_markers(_frames(motion, tags, made, view, rng), camera, markers)
    task = replace(task, images_end_ns=report.images_end_ns, unmarked_ns=report.unmarked_ns)
    return analyse_strike(report.tracks, markers, camera, task)


def _frames(
    motion: StruckMotion, tags: Tags, made: PlannedStrike, view: View, rng: np.random.Generator
) -> Iterator[ImageFrame]:
    """Yield the images of a strike."""
    camera, rate = real_camera(view), view.rate
    frames = np.arange(-round(REST * rate), int(motion.time[-1] * rate)) / rate + rng.random() / rate
    frames = frames[frames < motion.time[-1]]
    inside = np.clip(frames, 0.0, None)
    rotations = Slerp(motion.time, Rotation.from_quat(motion.quaternion))(inside).as_matrix()
    positions = np.stack([np.interp(inside, motion.time, axis) for axis in motion.position.T], axis=1)
    positions += [*rng.normal(0, HAND_SD, 2), 0.0]
    for number, (time, turned, place) in enumerate(zip(frames, rotations, positions, strict=True)):
        image = render(camera, seen_tags(tags, camera, made.heading_rad, turned, place), rng)
        yield ImageFrame(T0 + round(1e9 * time), number, image)
