"""A tip seen by a camera that reads its rows in turn: phi and k are right only with its line time.

Each point of the tag is drawn where it is at the time at which its own row is read (the row that it falls on:
solved for), so that edges bow and shear as a sensor shows them. Not modelled: exposure time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import TrackingError
from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.tracking.camera_model import distort, project_ideal, undistort, world_to_camera
from analyze.tracking.rolling_shutter import corners_at_one_time
from analyze.tracking.track import track_markers
from analyze.types import ImageFrame
from schemas.strike_result import Verdict
from tests.analyze.motion.tipping import SIZE, camera, marker, planned, simulate
from tests.analyze.tracking.rendering import corners_of, project, render

LINE_S = 30e-6
"""delay between rows of a phone's sensor [s]: 1080 rows in 32 ms, 492 in 15"""
RATE = 60.0
RHO = 0.002
ANCHOR = 10**18
MIDDLE = 245.5
"""middle row of an image of 492 rows"""


class Tipping:
    """Points of a tag in C at any time, from the tip of tipping.py, finely sampled."""

    def __init__(self, energy=1.05):
        self.tip = simulate(energy, RHO, rate=24_000.0, length=0.7)
        self.marker = marker()
        self.R, self.t = world_to_camera(camera())

    def points(self, points_marker, time_s):
        """Positions (n, 3) [m] in C of points (n, 3) [m] on the tag, each at its own time (n,) [s]."""
        theta = np.interp(time_s, self.tip.time, self.tip.theta)
        T = self.marker.T_object_marker
        arm = points_marker @ T[:3, :3].T + T[:3, 3] + np.array(planned(RHO).p_world_object) - [0, 0, RHO]
        cos, sin = np.cos(theta), np.sin(theta)
        turned = np.stack(
            [cos * arm[:, 0] + sin * arm[:, 2], arm[:, 1], cos * arm[:, 2] - sin * arm[:, 0]], axis=-1
        )
        return (
            turned + np.array([0, 0, RHO]) + np.stack([RHO * theta, 0 * theta, 0 * theta], axis=-1)
        ) @ self.R.T + self.t

    def draw(self, cam, points_marker, frame_s, line_s):
        """Raw pixels (n, 2) of points on the tag in the frame whose middle row is read at `frame_s` [s]."""
        found = project(cam, self.points(points_marker, np.full(len(points_marker), frame_s)))
        for _ in range(8):
            found = project(cam, self.points(points_marker, frame_s + line_s * (found[:, 1] - MIDDLE)))
        return found


def frames_of(tipping, line_s, rng, noise=2.0):
    cam = camera()
    times = np.arange(0.05, 0.85, 1 / RATE)
    seen = []
    for i, frame_s in enumerate(times):

        def drawn(cam, points, frame_s=frame_s):
            return tipping.draw(cam, points, frame_s, line_s)

        seen.append(
            ImageFrame(
                ANCHOR + round(1e9 * frame_s),
                i,
                render(cam, [(3, SIZE, np.eye(3), np.zeros(3))], rng, drawn, noise=noise),
            )
        )
    return seen


@pytest.fixture(scope="module")
def tipping():
    return Tipping()


@pytest.fixture(scope="module")
def rolled(tipping):
    return frames_of(tipping, LINE_S, np.random.default_rng(5))


def analysed(tipping, frames, line_s):
    cam = replace(camera(), line_time_s=line_s)
    report = track_markers(frames, cam, [tipping.marker], [3])
    contact = ANCHOR + round(1e9 * tipping.tip.contact)
    task = StrikeTask("s1.1", planned(RHO), contact, report.images_end_ns)
    return analyse_strike(report.tracks, [tipping.marker], cam, task), report.tracks[0]


def test_phi_and_k(tipping, rolled):
    tip = tipping.tip
    without, _ = analysed(tipping, rolled, 0.0)
    motion, track = analysed(tipping, rolled, LINE_S)
    assert motion.verdict is Verdict.GOOD
    assert abs(without.fit.phi - tip.phi) > np.radians(0.1)
    assert abs(without.fit.k / tip.k - 1) > 0.04
    sd_phi, sd_k = np.sqrt(np.diag(motion.fit.covariance))
    assert abs(motion.fit.phi - tip.phi) < min(3 * sd_phi, np.radians(0.02))
    assert abs(motion.fit.k - tip.k) < min(3 * sd_k, 0.004 * tip.k)
    seen = np.interp(1e-9 * (motion.angle.time_ns - ANCHOR), tip.time, tip.theta)
    assert np.degrees(np.std(motion.angle.theta - seen)) < 0.006
    assert (
        np.abs(track.late_ns - 1e9 * LINE_S * (track.corners_px[:, :, 1].mean(axis=1) - MIDDLE)).max() < 1e5
    )
    assert track.frame_ns.tolist() == [frame.time_ns for frame in rolled]


def test_a_line_time_too_long_for_the_frame_rate_is_refused(tipping, rolled):
    with pytest.raises(
        TrackingError,
        match=r"read-out of an image takes 49\.2 ms, but images are 16\.7 ms apart: correct line_time_s",
    ):
        analysed(tipping, rolled[:5], 1e-4)


def test_a_camera_that_reads_all_rows_at_once_keeps_its_times(tipping, rolled):
    (track,) = track_markers(rolled[:3], camera(), [tipping.marker], [3]).tracks
    assert track.late_ns is None
    assert track.frame_ns is track.time_ns


def fitted(tipping, frame_s, size, line_s):
    """Ideal corners (4, 2) that edges.py finds without noise, and their rows (4,) [px].

    They are intersections of lines fitted to the bowed edges without their ends.
    """
    cam = camera()
    corners = corners_of(size)
    points = np.concatenate(
        [
            corners[i] + (corners[(i + 1) % 4] - corners[i]) * np.linspace(0.04, 0.96, 40)[:, None]
            for i in range(4)
        ]
    )
    seen = undistort(cam, tipping.draw(cam, points, frame_s, line_s)).reshape(4, 40, 2)
    middle = seen.mean(axis=1)
    normal = np.array([np.linalg.svd(edge - edge.mean(axis=0))[2][1] for edge in seen])
    level = np.sum(normal * middle, axis=1)
    ideal = np.array([np.linalg.solve(normal[[i - 1, i]], level[[i - 1, i]]) for i in range(4)])
    return ideal, distort(cam, ideal)[:, 1]


@pytest.mark.parametrize(
    ("energy", "size", "rate"), [(1.05, 0.03, 60.0), (3.0, 0.04, 60.0), (1.3, 0.03, 30.0)]
)
def test_corrected_corners_match_the_true_ones(energy, size, rate):
    """At rest, through the impact and after it, except for the frame of the impact."""
    tipping, cam = Tipping(energy), camera()
    frame_s = np.arange(0.1, min(0.6, tipping.tip.time[np.argmax(tipping.tip.theta > 1.0)] or 1), 1 / rate)
    seen = [fitted(tipping, each, size, LINE_S) for each in frame_s]
    ideal, late_s = (
        np.array([each for each, _ in seen]),
        LINE_S * (np.array([row for _, row in seen]) - MIDDLE),
    )
    common_s = late_s.mean(axis=1)
    found = corners_at_one_time(frame_s, ideal, late_s, common_s, 0.01)
    truth = np.array(
        [
            project_ideal(cam, tipping.points(corners_of(size), np.full(4, each)))
            for each in frame_s + common_s
        ]
    )
    span = frame_s[:, None] + late_s
    struck = (span.min(axis=1) < tipping.tip.contact) & (span.max(axis=1) > tipping.tip.contact)
    assert np.count_nonzero(struck) <= 1
    assert np.abs(ideal - truth)[~struck].max() > 0.5
    assert np.abs(found - truth)[~struck].max() < 0.02


def test_the_rows_may_be_read_upwards(tipping):
    """A video that was rotated by 180 degrees has its rows read upwards."""
    frame_s = np.arange(0.3, 0.5, 1 / RATE)
    seen = [fitted(tipping, each, SIZE, -LINE_S) for each in frame_s]
    late_s = -LINE_S * (np.array([row for _, row in seen]) - MIDDLE)
    found = corners_at_one_time(
        frame_s, np.array([each for each, _ in seen]), late_s, late_s.mean(axis=1), 0.01
    )
    truth = [
        project_ideal(camera(), tipping.points(corners_of(SIZE), np.full(4, each)))
        for each in frame_s + late_s.mean(axis=1)
    ]
    assert np.abs(found - truth).max() < 0.01


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_a_marker_seen_in_a_few_frames_only(tipping, frames):
    frame_s = 0.4 + np.arange(frames) / RATE
    seen = [fitted(tipping, each, SIZE, LINE_S) for each in frame_s]
    late_s = LINE_S * (np.array([row for _, row in seen]) - MIDDLE)
    found = corners_at_one_time(
        frame_s, np.array([each for each, _ in seen]), late_s, late_s.mean(axis=1), 0.01
    )
    truth = [
        project_ideal(camera(), tipping.points(corners_of(SIZE), np.full(4, each)))
        for each in frame_s + late_s.mean(axis=1)
    ]
    assert np.abs(found - truth).max() < [3.0, 0.3, 0.05][frames - 1]
