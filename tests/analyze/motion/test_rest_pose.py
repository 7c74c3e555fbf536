"""Turn of the object at rest about the pivot axis, from corners of its markers without images."""

from dataclasses import replace

import numpy as np
import pytest

from analyze.geometry.station import turned_camera
from analyze.motion.rest_pose import _camera_side
from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.types import MARKER_TURN_SD
from tests.analyze.motion.tipping import camera, marker, planned, simulate, track_of

ANCHOR = 10**18


def rest_turns(crumb, mark=None, stated=None, seen_from=None, **how):
    """Turns at rest of a strike before which the object stood turned by `crumb` [rad] towards the tip."""
    tip = simulate(1.05)
    tip = replace(tip, theta=tip.theta + crumb)
    track = track_of(tip, np.random.default_rng(7), mark=mark, **how)
    task = StrikeTask("s1.1", planned(), int(tip.contact * 1e9) + ANCHOR, int(tip.time[-1] * 1e9) + ANCHOR)
    return analyse_strike([track], [stated or mark or marker()], seen_from or camera(), task).rest_turns


@pytest.mark.parametrize("yaw", [0.0, 0.03])
@pytest.mark.parametrize("crumb", np.radians([0.0, 0.3, -0.5]))
def test_a_crumb_under_the_object_is_measured(crumb, yaw):
    (turn,) = rest_turns(crumb, yaw=yaw)
    assert abs(turn.angle - crumb) < 3 * turn.sd + 2e-5
    assert turn.sd < np.radians(0.03)


def test_a_measured_markers_error_is_the_stated_one_and_an_assumed_one_is_wide():
    measured = replace(marker(), turn_sd=1e-3)
    assert rest_turns(0.0, stated=measured)[0].marker_sd == 1e-3
    assert rest_turns(0.0)[0].marker_sd > 10 * MARKER_TURN_SD


def test_a_marker_without_a_place_shows_no_turn():
    assert rest_turns(0.005, stated=replace(marker(), T_object_marker=None)) == ()


def test_views_from_one_place_have_one_camera_name():
    first, second = (rest_turns(crumb)[0] for crumb in (0.0, 0.005))
    assert first.camera == second.camera
    assert first.marker == second.marker == "3"


def test_headings_of_a_few_degrees_have_one_camera_name_and_those_half_a_turn_apart_two():
    names = [rest_turns(0.0, seen_from=turned_camera(camera(), heading))[0].camera for heading in (0.0, 0.03)]
    assert names[0] == names[1]
    assert _camera_side(turned_camera(camera(), np.pi).T_world_camera) != names[0]
