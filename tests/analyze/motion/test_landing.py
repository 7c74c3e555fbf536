"""The free motion ends where the shape's next face lands, also where that does not slow the body."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analyze.motion.landing import landing_angle
from analyze.motion.support_function import support_of_outline
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
    """Outline (n, 2) [m] of a box with a chamfer of `length` [m] ahead of its lower front edge at 0.

    The chamfer rises at the given angle.
    """
    slope = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    return np.array([[-BACK, 0.0], [0.0, 0.0], length * slope, [length * slope[0], TOP], [-BACK, TOP]])


def centre(rounding, degrees):
    """Centre of the rounding between the table and the face at `degrees`."""
    return np.array([-rounding * math.tan(math.radians(degrees) / 2), rounding])


def lands(points, degrees, rounding=0.001, **known):
    found = landing_angle(
        support_of_outline(points, centre(rounding, degrees), rounding), strike(rounding, **known)
    )
    return None if found is None else math.degrees(found)


def along(corners, each, noise, rng):
    """Points on the outline as a scan has them, with noise."""
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


def test_a_box_lands_on_its_side_face():
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
