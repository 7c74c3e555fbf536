"""Masses of parts from a scan whose scale or faces are off, by strikes over its edges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.inertia import inertial_parameters_from_joint, shape_prior
from analyze.estimation.joint import MomentModel, solve_joint
from analyze.estimation.part_masses import measured_moments, part_masses
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.estimation.shape_errors import Box, box_of, shape_errors
from analyze.geometry.polyhedron import MassProperties
from tests.analyze.estimation.bodies import GRAVITY, SIX_AXES, Body, box_body, fit_of, planned_strike, tip
from tests.analyze.estimation.test_part_masses import moments_of

SIZE = np.array((0.08, 0.06, 0.16))
BODY = box_body(tuple(SIZE.tolist()), (0.03, 0.014, 0.004), 0.0, pitch=0.01)
MASSES = np.array([0.3, 0.1])
NAMES = [f"{axis}{sign}" for axis in "xyz" for sign in "-+"]
PLANES = {
    name: np.append(sign * np.eye(3)[axis], -SIZE[axis] / 2)
    for name, (axis, sign) in zip(NAMES, [(a, s) for a in range(3) for s in (-1, 1)], strict=True)
}
SHAPE = shape_prior(BODY.cells)


@pytest.fixture(scope="module", autouse=True)
def fewer_draws() -> Iterator[None]:
    """Draw half of the masses: their sampling, which takes nearly all of the time, is not what is tested."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analyze.estimation.part_masses._STEPS", 50)
        patch.setattr("analyze.estimation.part_masses._BURN_IN_STEPS", 20)
        yield


def uniform_box(low: np.ndarray, high: np.ndarray) -> MassProperties:
    """Uniform solid between two corners."""
    square = (high - low) ** 2
    return MassProperties(float(np.prod(high - low)), (low + high) / 2, np.diag(square.sum() - square) / 12)


PARTS = [
    uniform_box(-SIZE / 2, SIZE / 2 * [1, 1, 0]),
    uniform_box(-SIZE / 2 * [1, 1, 0], SIZE / 2),
]
"""lower and upper half of the scanned box"""


def true_body(outwards: dict[str, float], middle: float, scale: float) -> Body:
    """Two uniform halves whose faces lie farther outwards than those scanned, and are then scaled."""
    points = BODY.points.copy()
    for axis, name in enumerate("xyz"):
        share = points[:, axis] / SIZE[axis]
        points[:, axis] += outwards[name + "+"] * (0.5 + share) - outwards[name + "-"] * (0.5 - share)
    share = 1 - np.abs(BODY.points[:, 2]) / (SIZE[2] / 2)
    points[:, 2] += share * (middle - (outwards["z+"] - outwards["z-"]) / 2)
    upper = BODY.points[:, 2] > 0
    masses = np.where(upper, MASSES[1], MASSES[0]) / (len(points) / 2)
    return replace(BODY, points=points * (1 + scale), masses=masses)


@pytest.mark.parametrize(("face_sd", "scale_sd"), [(3e-4, 0.0), (0.0, 4e-3)])
def test_strikes_over_misplaced_faces_give_the_masses_of_parts(face_sd, scale_sd):
    errors = SystematicErrors(gravity_tilt_sd=2e-4, scale_sd=scale_sd, face_sd=face_sd)
    prior, stated = ComPrior.from_bounds(-SIZE / 2, SIZE / 2), Scale(MASSES.sum(), 1e-5, GRAVITY, 1e-4, 5e-4)
    inside: list[np.ndarray] = []
    off_by = {"known": [], "neglected": []}
    for seed in range(10):
        rng = np.random.default_rng(seed)
        off = dict(zip(NAMES, rng.normal(0, face_sd, 6), strict=True))
        scale = rng.normal(0, scale_sd)
        body = true_body(off, rng.normal(0, face_sd), scale)
        planes = []
        for axis in SIX_AXES:
            strike = planned_strike(BODY, *axis)
            rest, wall = strike.axis_id.split("/")
            moved = off[rest] * PLANES[rest][:3] + off[wall] * PLANES[wall][:3]
            phi, k = tip(body, strike, moved + scale * np.array(strike.pivot.point))
            phi += rng.normal(0, np.hypot(2e-4, errors.strike_angle_sd)) + rng.normal(0, errors.axis_angle_sd)
            fit = fit_of(phi, k * (1 + rng.normal(0, 2e-3)), 2e-4, 2e-3 * k)
            plane = equiplane_from_fit(strike.id, strike, fit)
            planes.append(replace(plane, face=rest, wall=wall, edge_sd=max(face_sd, 1e-5)))
        solution = solve_joint(planes, errors, prior, MomentModel(stated, SHAPE))
        moments = measured_moments(inertial_parameters_from_joint(solution, prior, stated))
        found = shape_errors(solution, PARTS, [box_of(part) for part in PARTS], PLANES)
        for key, each in (("known", found), ("neglected", None)):
            masses = part_masses(moments, ["low", "high"], PARTS, np.random.default_rng(1), each)
            off_by[key].append(masses.masses[0] - MASSES[0])
            if each is not None:
                low, high = masses.intervals.T
                inside.append((low <= MASSES) & (high >= MASSES))
    # 8 or more of 10 are inside with probability 0.99.
    assert np.mean(inside) >= 8 / 10
    # What moves the measured centre of mass moves the parts with it.
    known, neglected = (np.sqrt(np.mean(np.square(each))) for each in off_by.values())
    assert known < neglected


def test_intervals_hold_the_error_of_faces_that_no_strike_depends_on():
    """Moments as good as strikes give them; each face of both parts is 0.3 mm off."""
    solution = solved(SystematicErrors(gravity_tilt_sd=1e-3, face_sd=3e-4))
    inside = {"known": [], "neglected": []}
    for seed in range(10):
        rng = np.random.default_rng(seed)
        true = [
            uniform_box(
                part.centroid - box_of(part).sides / 2 - rng.normal(0, 3e-4, 3),
                part.centroid + box_of(part).sides / 2 + rng.normal(0, 3e-4, 3),
            )
            for part in PARTS
        ]
        moments = moments_of(true, MASSES, rng, com_sd=1e-4, relative_sd=4e-3)
        found = shape_errors(solution, PARTS, [box_of(part) for part in PARTS], {})
        for key, each in (("known", found), ("neglected", None)):
            low, high = part_masses(moments, ["low", "high"], PARTS, rng, each).intervals.T
            inside[key].append((low <= MASSES) & (high >= MASSES))
    # 8 or more of 10 are inside with probability 0.99.
    assert np.mean(inside["known"]) >= 8 / 10
    assert np.mean(inside["neglected"]) < 8 / 10


def solved(errors: SystematicErrors):
    """Joint solution of exact strikes on the scanned box."""
    planes = []
    for axis in SIX_AXES:
        strike = planned_strike(BODY, *axis)
        rest, wall = strike.axis_id.split("/")
        phi, k = tip(BODY, strike)
        plane = equiplane_from_fit(strike.id, strike, fit_of(phi, k, 1e-4, 1e-3 * k))
        planes.append(replace(plane, face=rest, wall=wall, edge_sd=3e-4))
    prior = ComPrior.from_bounds(-SIZE / 2, SIZE / 2)
    return solve_joint(planes, errors, prior, MomentModel(Scale(BODY.mass, 1e-4, GRAVITY, 1e-3), SHAPE))


def test_an_exact_shape_has_no_errors():
    errors = shape_errors(
        solved(SystematicErrors(gravity_tilt_sd=1e-3)), PARTS, [box_of(part) for part in PARTS], PLANES
    )
    assert errors is None


def test_a_face_out_of_place_moves_the_centroid_by_half_and_stretches_the_part():
    solution = solved(SystematicErrors(gravity_tilt_sd=1e-3, face_sd=3e-4))
    errors = shape_errors(solution, PARTS[:1], [box_of(PARTS[0])], {})
    assert errors is not None
    assert errors.covariance == pytest.approx(np.eye(6))
    # The order is x-, x+, y-, y+, z-, z+.
    (moved,) = errors.moved(PARTS[:1], 10 * np.eye(6)[5])
    wider = uniform_box(-SIZE / 2, SIZE / 2 * [1, 1, 0] + [0, 0, 3e-3])
    assert moved.centroid == pytest.approx(wider.centroid)
    assert moved.unit_inertia == pytest.approx(wider.unit_inertia, rel=1e-9, abs=1e-12)


def test_parts_in_one_box_share_its_errors():
    whole = Box(np.zeros(3), SIZE)
    solution = solved(SystematicErrors(gravity_tilt_sd=1e-3, face_sd=3e-4))
    errors = shape_errors(solution, PARTS, [whole, whole], PLANES)
    assert errors is not None
    assert len(errors.mean) == 6
    # The strikes know the resting face z- and so its error is not independent of c's.
    assert abs(errors.with_com[:, 4]).max() > 1e-6
    low, high = errors.moved(PARTS, 10 * np.eye(6)[5])
    assert low.centroid[2] - PARTS[0].centroid[2] == pytest.approx(0.75e-3)
    assert high.centroid[2] - PARTS[1].centroid[2] == pytest.approx(2.25e-3)
