from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.estimation.equiplane import balance_direction, equiplane, equiplane_from_fit, standing_angle
from analyze.estimation.joint_model import centre_line_shift
from analyze.motion.next_line import carried_strike, planned_axis
from analyze.types import SupportLine, TipMotion
from schemas.strike_result import Verdict
from tests.analyze.estimation.bodies import SIX_AXES, box_body, fit_of, planned_strike, tip

BODY = box_body((0.08, 0.06, 0.15), (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)


@pytest.mark.parametrize("axis", SIX_AXES)
def test_true_phi_gives_a_plane_through_the_centre_of_mass(axis):
    strike = planned_strike(BODY, *axis)
    phi, k = tip(BODY, strike)
    plane = equiplane_from_fit("s", strike, fit_of(phi, k, 1e-3, 0.1))
    assert abs(plane.normal @ (BODY.com - plane.point)) < 1e-12
    assert abs(plane.normal @ plane.direction) < 1e-12
    assert standing_angle(BODY.com, plane.direction, plane.up, plane.point) == pytest.approx(phi, abs=1e-12)


def test_normal_is_the_papers_equation_4():
    strike = planned_strike(BODY, *SIX_AXES[0])
    plane = equiplane_from_fit("s", strike, fit_of(0.4, 80.0, 1e-3, 0.1))
    # In W at rest: l = +y, up = +z; R turns up by -phi about y; n = (R up) x l.
    R_world_object = np.array(strike.R_world_object)
    expected = np.cross([-np.sin(0.4), 0, np.cos(0.4)], [0, 1, 0])
    assert np.allclose(R_world_object @ plane.normal, expected, atol=1e-12)


def test_distance_from_the_plane_is_r_times_the_angle():
    strike = planned_strike(BODY, *SIX_AXES[1])
    plane = equiplane_from_fit("s", strike, fit_of(0.3, 80.0, 1e-3, 0.1))
    point = plane.point + 0.1 * balance_direction(plane.direction, plane.up, 0.3 + 0.01)
    assert plane.normal @ (point - plane.point) == pytest.approx(0.1 * np.sin(0.01), rel=1e-6)


def test_pivot_off_the_worlds_y_is_refused():
    strike = planned_strike(BODY, *SIX_AXES[0])
    turned = strike.model_copy(
        update={"pivot": strike.pivot.model_copy(update={"direction": [1.0, 0.0, 0.0]})}
    )
    with pytest.raises(EstimationError, match="make the plan anew"):
        equiplane_from_fit("s", turned, fit_of(0.3, 80.0, 1e-3, 0.1))


def test_plane_of_a_strike_that_another_line_carried_lies_on_that_line():
    strike = planned_strike(BODY, *SIX_AXES[0])
    line = SupportLine(4e-3, 1e-3, np.arctan2(1, 4), radius_m=5e-4)
    carried = carried_strike(strike, line)
    assert carried.axis_id == f"{strike.axis_id}+4.1mm"
    assert planned_axis(carried.axis_id) == strike.axis_id
    phi, k = tip(BODY, carried)
    found = TipMotion("s", strike.id, Verdict.GOOD, "", fit=fit_of(phi, k, 1e-3, 0.1), carried_by=line)
    plane = equiplane("s", carried, found)
    assert abs(plane.normal @ (BODY.com - plane.point)) < 1e-12
    # A larger rounding leaves both facets where they are: the line moves inwards from each by as much.
    wall = np.cross(plane.direction, plane.up)
    shift = centre_line_shift(replace(plane, wall_lean=-line.takes_over_rad))
    assert shift @ plane.base_up == pytest.approx(1.0)
    assert shift @ wall == pytest.approx(-1.0)
