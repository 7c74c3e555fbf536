"""Strikes recorded under another strike's name, and objects put down in another way than planned."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.motion.strike import analyse_strike, end_of_rest_ns, placement_of
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import tip_angle
from analyze.types import Marker
from schemas.strike_result import Verdict
from tests.analyze.registration import tagged_boxes as boxes


@pytest.fixture(scope="module")
def session():
    """Box with tags in known places, the plan of its strikes, and the tracks of each."""
    rng = np.random.default_rng(4)
    box = boxes.draw_box(rng, edges=4)
    plans = [boxes.plan_of(box.size, edge, i + 1) for i, edge in enumerate(box.edges)]
    tracks = []
    for edge, plan in zip(box.edges, plans, strict=True):
        course, draw = boxes.strike_course(box, edge, rng), boxes.Draw()
        R, p = boxes.poses(box, plan, course, rng.normal(0, draw.yaw), rng.normal(0, draw.place, 2))
        tracks.append(boxes.drawn_track(box.camera, boxes.facing(plan), course, R, p, draw, rng))
    markers = [Marker(each.name, each.size_m, box.T[each.name]) for each in box.spec.marker]
    return box, plans, tracks, markers


def analysed(session, number, name, markers=None):
    """Motion of strike `number`, recorded under the name of strike `name`."""
    box, plans, tracks, placed = session
    task = StrikeTask(f"{plans[name].id}.1", plans[name], boxes.T0, plan_strikes=tuple(plans))
    return analyse_strike([tracks[number]], markers or placed, box.camera, task)


def test_strike_under_another_name_is_recognised(session):
    """A strike under a wrong name was read as slid by 10^13 mm, rocked back from 10^12 deg, or good.

    Numpy's warnings count as errors.
    """
    plans = session[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(len(plans)):
            for name in range(len(plans)):
                motion = analysed(session, number, name)
                if number == name:
                    assert motion.verdict is Verdict.GOOD
                    continue
                assert motion.verdict is Verdict.WRONG_PLACEMENT
                assert motion.reason.startswith(f"looks like {plans[number].id}, not {plans[name].id}: ")
                assert "leave it out with --exclude" in motion.reason
                assert motion.fit is None


def test_object_that_fits_no_strike_of_the_plan_is_described(session):
    plans, markers = session[1], session[3]
    turned = [
        replace(marker, T_object_marker=_turned(plans[0], math.radians(35)) @ marker.T_object_marker)
        for marker in markers
    ]
    motion = analysed(session, 0, 0, turned)
    assert motion.verdict is Verdict.WRONG_PLACEMENT
    assert "turned by 35 deg about the vertical, and it fits no other strike of the plan" in motion.reason


def _turned(plan, angle):
    """Rotation (4, 4) of the object in O, about the vertical of a strike's rest pose."""
    R = np.array(plan.R_world_object)
    T = np.eye(4)
    T[:3, :3] = R.T @ boxes.about([0, 0, 1], angle) @ R
    return T


def test_motion_about_a_wrong_edge_gives_no_number_outside_sense(session):
    """Without the check of the placement: angles of 10^15 deg came out, and means of empty slices."""
    box, plans, tracks, markers = session
    refused = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for track in tracks:
            for plan in plans:
                rest_end_ns = end_of_rest_ns([track], boxes.T0)
                try:
                    motion = tip_angle([track], markers, box.camera, placement_of(plan), rest_end_ns)
                except EstimationError as error:
                    refused += "check that this is the planned strike" in str(error)
                    continue
                assert np.abs(motion.angle.theta).max() < 2 * math.pi
                assert np.abs(motion.angle.slip).max() < 3.0
    assert refused >= 3
