"""A strike with object and striker turned by 180 degrees on the table, seen by a camera that stays."""

import numpy as np
import pytest

from analyze.geometry.station import turned_camera
from analyze.motion.rest_pose import placement_error
from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.types import Marker
from schemas.strike_result import Verdict
from tests.analyze.motion.tipping import SIZE, D, camera, planned, simulate, track_of


def on_the_back():
    T = np.eye(4)
    T[:3, :3] = np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]])
    T[:3, 3] = [0.0, D / 2, 0.03]
    return Marker(3, SIZE, T)


def test_a_turned_strike_is_tracked_and_fitted():
    """A strike with the object yawed by half a turn: it tips towards W's -x and shows its other side."""
    tip = simulate(energy=1.08)
    strike = planned(phi=tip.phi).model_copy(update={"heading_rad": np.pi})
    track = track_of(tip, np.random.default_rng(1), mark=on_the_back(), yaw=np.pi)
    task = StrikeTask("s1.1", strike, int((10**9 + tip.contact) * 1e9), int(track.time_ns[-1]))
    seen_from = turned_camera(camera(), strike.heading_rad)
    motion = analyse_strike((track,), [on_the_back()], seen_from, task)
    assert motion.verdict is Verdict.GOOD, motion.reason
    assert motion.fit.phi == pytest.approx(tip.phi, abs=4 * np.sqrt(motion.fit.covariance[0, 0]) + 2e-4)
    assert motion.fit.k == pytest.approx(tip.k, rel=0.02)
    wrong, _ = placement_error(
        [track.R_camera_marker[0]], [on_the_back()], camera(), np.array(strike.R_world_object)
    )
    right, _ = placement_error(
        [track.R_camera_marker[0]], [on_the_back()], seen_from, np.array(strike.R_world_object)
    )
    assert right < np.radians(1) < np.radians(179) < wrong, "an object that was not turned is found out"


def test_without_a_heading_the_camera_stays_as_it_is():
    assert turned_camera(camera(), 0.0).T_world_camera.tolist() == camera().T_world_camera.tolist()
    quarter = turned_camera(camera(), np.pi / 2).T_world_camera
    assert quarter[:3, 3] == pytest.approx([-0.55, -0.03, 0.08]), (
        "at the station's -y, which is the turned frame's -x"
    )
    assert np.linalg.det(quarter[:3, :3]) == pytest.approx(1)
