"""The free motion ends where the shape's next face lands, also where that does not slow the body."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analyze.motion.landing import landing_angle
from analyze.motion.phases import find_course, phases_of
from analyze.motion.settings import WindowLimits
from analyze.motion.support_function import support_of_outline
from analyze.types import TipAngle
from tests.analyze.motion.tipping import planned

BACK, TOP = 0.06, 0.2


def strike(rounding=0.001, sd=5e-5, phi=0.6):
    made = planned(rounding, phi)
    return made.model_copy(
        update={
            "pivot": made.pivot.model_copy(update={"radius_m": rounding, "sd_m": sd}),
            "phi_predicted_rad": phi,
        }
    )


def chamfered(length, degrees=45.0):
    """(n, 2) m: a box whose lower front edge, at 0, is followed by a face of that length, rising at that
    angle."""
    slope = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    return np.array([[-BACK, 0.0], [0.0, 0.0], length * slope, [length * slope[0], TOP], [-BACK, TOP]])


def centre(rounding, degrees):
    """Of the rounding, between table and that face."""
    return np.array([-rounding * math.tan(math.radians(degrees) / 2), rounding])


def lands(points, degrees, rounding=0.001, **known):
    found = landing_angle(
        support_of_outline(points, centre(rounding, degrees), rounding), strike(rounding, **known)
    )
    return None if found is None else math.degrees(found)


def along(corners, each, noise, rng):
    """Points on the outline as a scan has them."""
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    points = np.concatenate(
        [a + np.linspace(0, 1, each, endpoint=False)[:, None] * (b - a) for a, b in sides]
    )
    return points + rng.normal(0.0, noise, points.shape)


@pytest.mark.parametrize("rounding", [0.0, 0.0005, 0.002, 0.004])
@pytest.mark.parametrize("degrees", [40.0, 45.0, 75.0])
def test_a_chamfer_lands_at_its_own_angle_whatever_the_rounding(degrees, rounding):
    found = lands(chamfered(0.03, degrees), degrees, rounding)
    assert degrees - 2.0 < found < degrees - 0.9


def test_a_box_lands_on_its_wall():
    assert 88.0 < lands(chamfered(0.2, 90.0), 90.0) < 89.1


def test_a_bevel_too_narrow_to_carry_is_passed_over():
    assert 87.0 < lands(chamfered(0.0005), 45.0, 0.0002) < 89.5
    assert 40.0 < lands(chamfered(0.003), 45.0, 0.0002) < 44.1


@pytest.mark.parametrize(("length", "degrees"), [(0.03, 45.0), (0.2, 90.0)])
def test_a_scans_facets_do_not_end_it_early(length, degrees):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        points = along(chamfered(length, degrees), 200, 1e-4, rng)
        assert degrees - 3.5 < lands(points, degrees, sd=2e-4) < degrees - 0.5


def test_a_face_that_lies_down_before_the_balance_ends_nothing():
    assert lands(chamfered(0.03), 45.0, phi=math.radians(50.0)) is None


def steady(theta):
    """As tracked at 120 fps, from rest."""
    n = len(theta)
    return TipAngle(np.arange(1, n + 1) * 8_333_333, theta, np.full(n, 5e-4), np.zeros(n), np.zeros(n))


def test_what_is_hardly_slowed_has_landed_all_the_same():
    theta = np.radians(np.concatenate([np.zeros(20), np.linspace(0.0, 80.0, 50)]))
    seen = find_course(steady(theta), 0, WindowLimits())
    assert seen.ended == len(theta), "the motion does not show it"
    known = find_course(steady(theta), 0, WindowLimits(), math.radians(44.0))
    assert theta[known.ended - 1] < math.radians(44.0) <= theta[known.ended]
    phases = phases_of(steady(theta), known, math.radians(30.0))
    assert phases.stage_two[1] == phases.landing[0] == known.ended


def test_one_wrong_reading_is_no_landing_and_rocking_back_none_either():
    theta = np.radians(
        np.concatenate([np.zeros(20), 30.0 * np.sin(np.linspace(0.0, math.pi, 60)), np.zeros(10)])
    )
    theta[50] = math.radians(60.0)
    with_shape, without = (
        find_course(steady(theta), 0, WindowLimits(), at) for at in (math.radians(44.0), None)
    )
    assert with_shape == without
    assert with_shape.came_back


@pytest.mark.parametrize(
    ("seed", "rate"), [(seed, rate) for seed in range(4) for rate in (120, 240, 960, 2000)]
)
def test_the_course_is_the_same_at_any_frame_rate(seed, rate):
    """At 960 a second the first frames after the guard are still near rest, and a frame's error is a good
    part of a frame's turn."""
    theta = np.radians(
        np.interp(np.arange(0.0, 0.9, 1 / rate), [0.2, 0.3, 0.5, 0.62], [0.0, 15.0, 50.0, 90.0])
    )
    time_ns = np.arange(1, len(theta) + 1) * round(1e9 / rate)
    seen = theta + np.random.default_rng(seed).normal(0.0, np.radians(0.06), len(theta))
    angle = TipAngle(
        time_ns, seen, np.full(len(theta), np.radians(0.06)), np.zeros(len(theta)), np.zeros(len(theta))
    )
    course = find_course(angle, 0, WindowLimits())
    assert not course.came_back
    assert 0.2 < course.released / rate < 0.24
    assert course.ended / rate == pytest.approx(0.62, abs=0.02)
