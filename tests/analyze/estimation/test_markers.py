import numpy as np
import pytest

from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.inertia import shape_prior
from analyze.estimation.markers import can_subtract, without_markers
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from schemas.object_spec import MarkerSpec
from tests.analyze.estimation.bodies import (
    GRAVITY,
    SIX_AXES,
    Body,
    box_body,
    fit_of,
    inertial_parameters,
    planned_strike,
    tip,
)

SIZE = (0.08, 0.06, 0.15)
BODY = box_body(SIZE, (0.02, 0.01, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)
PLACE = np.eye(4)
PLACE[:3, 3] = (0.01, 0.0, 0.075)
CARD = MarkerSpec(id=0, size_m=0.005, mass_kg=5e-4, T_object_marker=PLACE.tolist())


def with_card() -> Body:
    """Body with a point mass of half a gram on its top."""
    nearest = int(np.argmin(np.linalg.norm(BODY.points - PLACE[:3, 3], axis=1)))
    points = BODY.points.copy()
    # One more point in place of none: the cubes there keep their masses.
    return Body(
        BODY.size,
        BODY.pitch,
        np.vstack([points, PLACE[:3, 3]]),
        np.append(BODY.shell, BODY.shell[nearest]),
        np.append(BODY.masses, CARD.mass_kg),
        BODY.regions,
        BODY.border,
        BODY.edge_radius,
    )


def whole():
    body = with_card()
    strikes = [planned_strike(body, *axis) for axis in SIX_AXES]
    planes = [equiplane_from_fit(s.id, s, fit_of(*tip(body, s), 1e-6, 1e-4)) for s in strikes]
    exact = SystematicErrors(0.0, axis_angle_sd=0.0, strike_angle_sd=0.0)
    half = np.array(SIZE) / 2
    return inertial_parameters(
        planes,
        exact,
        ComPrior.from_bounds(-half, half),
        Scale(body.mass, 1e-6, GRAVITY, 0.0, 0.0),
        shape_prior(BODY.cells),
    )


def test_half_a_gram_on_34_moves_c_by_a_millimetre_and_is_subtracted():
    found = whole()
    assert np.linalg.norm(found.com.position - BODY.com) > 0.7e-3
    bare = without_markers(found, [CARD])
    assert bare.mass == pytest.approx(BODY.mass)
    assert bare.com.position == pytest.approx(BODY.com, abs=5e-6)
    for axis in bare.axes:
        assert axis.i_com == pytest.approx(axis.direction @ BODY.inertia @ axis.direction, rel=2e-3)
        assert axis.i_edge > axis.i_com


def test_mass_error_contributes_to_c():
    found = whole()
    bare = without_markers(found, [CARD])
    assert bare.covariance.shape == (10, 10)
    assert np.linalg.eigvalsh(bare.com.covariance).min() > 0
    assert bare.covariance[0, 0] == pytest.approx(found.mass_sd**2)


def test_markers_without_mass_have_no_effect_and_without_pose_cannot_be_subtracted():
    found = whole()
    assert without_markers(found, [MarkerSpec(id=1, size_m=0.03)]) is found
    assert can_subtract([CARD, MarkerSpec(id=1, size_m=0.03)])
    assert not can_subtract([CARD, MarkerSpec(id=2, size_m=0.03, mass_kg=1e-3)])
