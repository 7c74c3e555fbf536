"""Edge radii: not given, wrongly stated, or stated per edge; and scan errors that edges of one face share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.edge_radii import (
    check_stated_radii,
    estimated_radii,
    strikes_determine_radius,
    with_radius_not_given,
    without_refuted_radii,
)
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel, solve_joint
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.estimation.radius_odds import probability_wrong
from analyze.geometry.edge_radius import ASSUMED, OWN_FRACTION, stated_radius
from analyze.types import EquiPlane, RadiusPrior, RadiusSource
from schemas.object_spec import ObjectSpec
from tests.analyze.estimation.bodies import (
    GRAVITY,
    SIX_AXES,
    box_body,
    fit_of,
    inertial_parameters,
    planned_strike,
    tip,
)

SIZE = (0.08, 0.06, 0.15)
PLANNED, STATED_SD = 1e-3, 1e-4
BODY = box_body(SIZE, (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01, edge_radius=PLANNED)
PRIOR = ComPrior.from_bounds(-np.array(SIZE) / 2, np.array(SIZE) / 2)
SCALE = Scale(BODY.mass, 1e-4, GRAVITY, 2e-3)
SHAPE = shape_prior(BODY.cells)
STATED = RadiusPrior(PLANNED, STATED_SD, OWN_FRACTION * STATED_SD, RadiusSource.STATED)
LINE_SD, NOISE, TILT_SD = 5e-5, 5e-4, 3.5e-3
SPREAD = stated_radius(
    ObjectSpec.model_validate(
        {
            "name": "box",
            "mass_kg": 0.2,
            "mass_sd_kg": 1e-4,
            "shape": {"box": {"size_m": SIZE}},
            "edge_radius_m": 1.15e-3,
            "edge_radius_sd_m": 8.5e-4,
            "marker": [{"id": 0, "size_m": 0.03}],
        }
    )
)
"""radius as stated for edges of 0.3 and 2 mm"""
UPRIGHT = ((2, -1, 1, 1), (2, -1, 1, -1), (2, -1, 0, 1), (2, -1, 0, -1))
NINE = (*SIX_AXES, (0, -1, 1, -1), (1, -1, 2, -1), (2, -1, 0, -1))


def session(
    seed: int, radii: dict[str, float] | float, face_sd: float = 0.0, axes=SIX_AXES
) -> tuple[list[EquiPlane], SystematicErrors]:
    """Equi-planes of a session whose plan has `PLANNED` radii, on a box whose faces are displaced.

    Faces lie off their place by `face_sd`, both where the box rests on them and where they rise from an edge.
    """
    rng = np.random.default_rng(seed)
    errors = SystematicErrors(gravity_tilt_sd=TILT_SD, face_sd=face_sd)
    tilt = rng.normal(0, TILT_SD)
    gravity = rng.normal(0, SCALE.gravity_sd / GRAVITY)
    moved: dict[str, float] = {}
    found = []
    for axis in axes:
        strike = planned_strike(BODY, *axis)
        rest, wall = strike.axis_id.split("/")
        forward, up = np.array(strike.R_world_object)[[0, 2]]
        below = moved.setdefault(rest, rng.normal(0, face_sd))
        ahead = moved.setdefault(wall, rng.normal(0, face_sd)) + rng.normal(0, LINE_SD)
        rho = radii if isinstance(radii, float) else radii[strike.axis_id]
        shift = ahead * forward - below * up + (rho - PLANNED) * (up - forward)
        phi, k = tip(BODY, strike, shift, rho)
        phi += tilt + rng.normal(0, errors.axis_angle_sd)
        k *= np.exp(gravity + rng.normal(0, SCALE.k_relative_sd))
        for repeat in range(2):
            seen = phi + rng.normal(0, np.hypot(NOISE, errors.strike_angle_sd))
            fit = fit_of(seen, k * np.exp(rng.normal(0, 3e-3)), NOISE, 3e-3 * k)
            plane = equiplane_from_fit(f"{strike.axis_id}.{repeat}", strike, fit)
            edge_sd = float(np.hypot(face_sd, LINE_SD))
            found.append(replace(plane, edge_sd=edge_sd, wall=wall, radius_prior=STATED))
    return found, errors


def expecting(planes: list[EquiPlane], prior: RadiusPrior) -> list[EquiPlane]:
    """Copies of the planes as for a plan with the prior's mean radius in place of `PLANNED`."""
    more = prior.mean - PLANNED
    return [
        replace(
            plane,
            point=plane.point + more * (plane.up - np.cross(plane.direction, plane.up)),
            edge_radius=prior.mean,
            radius_prior=prior,
        )
        for plane in planes
    ]


def deviations(sessions) -> np.ndarray:
    """Errors (sessions, 3) of the centre of mass over their stated sd."""
    found = []
    for planes, errors in sessions:
        com = inertial_parameters(planes, errors, PRIOR, SCALE, SHAPE).com
        found.append((com.position - BODY.com) / np.sqrt(np.diag(com.covariance)))
    return np.array(found)


def not_given(planes: list[EquiPlane], errors: SystematicErrors) -> tuple[list[EquiPlane], SystematicErrors]:
    return list(with_radius_not_given(planes)), errors


@pytest.mark.parametrize("radius", [1e-4, 3e-4, 1.2e-3])
def test_centre_of_mass_is_inside_where_the_radius_is_not_given(radius):
    z = deviations(not_given(*session(seed, radius)) for seed in range(16))
    assert np.mean(np.abs(z) < 1.96) >= 0.9
    # With a radius of 0 +- 0 c is up to 9 sd off, if strikes do not scatter.
    sharp = [
        [
            replace(
                plane,
                point=plane.point - PLANNED * (plane.up - np.cross(plane.direction, plane.up)),
                edge_radius=0.0,
                radius_prior=replace(STATED, common_sd=0.0, own_sd=0.0),
            )
            for plane in session(0, 1.2e-3)[0]
        ]
    ]
    errors = replace(session(0, 1.2e-3)[1], strike_angle_sd=1e-6)
    alike = [[replace(plane, sd_phi=np.hypot(plane.sd_phi, 5e-4)) for plane in planes] for planes in sharp]
    assert np.abs(deviations((planes, errors) for planes in alike)).max() > 5
    # Strikes that may scatter by more than stated do so here.
    assert np.abs(deviations((planes, session(0, 1.2e-3)[1]) for planes in sharp)).max() < 2.5


def test_edges_of_unlike_radii_are_inside_where_none_is_given():
    rng = np.random.default_rng(11)
    axes = [planned_strike(BODY, *axis).axis_id for axis in SIX_AXES]
    drawn = [dict(zip(axes, rng.uniform(0, 1.5e-3, len(axes)).tolist(), strict=True)) for _ in range(40)]
    z = deviations(not_given(*session(seed, radii)) for seed, radii in enumerate(drawn))
    assert np.mean(np.abs(z) < 1.96) >= 0.9


def test_wrong_statement_is_refuted_and_a_right_one_stands():
    wrong = [check_stated_radii(*session(seed, 3e-4), PRIOR) for seed in range(25)]
    assert all(check.refuted for check in wrong)
    measured = np.array([(check.measured - 3e-4) / check.measured_sd for check in wrong])
    assert np.mean(np.abs(measured) < 1.96) >= 0.9
    rng = np.random.default_rng(1)
    drawn = [session(seed, PLANNED + float(rng.normal(0, STATED_SD)), axes=NINE) for seed in range(30)]
    assert not any(check_stated_radii(*each, PRIOR).refuted for each in drawn)


def radius_deviations(planes, errors: SystematicErrors, truth: float) -> list[float]:
    """Errors of the edges' estimated radii over their stated sd."""
    radii = estimated_radii(solve_joint(planes, errors, PRIOR, MomentModel(SCALE, SHAPE)))
    return [(each.value - truth) / each.sd for each in radii]


def test_unlikely_statement_that_is_not_refuted_counts_as_less_certain():
    """A radius of 1.0 ± 0.1 mm is stated where 0.6 mm is true: at the limit of what six axes refute."""
    before, after, unrefuted = [], [], 0
    for seed in range(20):
        planes, errors = session(seed, 6e-4)
        checked, check = without_refuted_radii(planes, [0] * len(planes), errors, PRIOR)
        if check.refuted:
            continue
        unrefuted += 1
        assert checked[0].radius_prior.own_sd >= STATED.own_sd
        before += radius_deviations(planes, errors, 6e-4)
        after += radius_deviations(checked, errors, 6e-4)
    assert unrefuted >= 5
    assert np.mean(np.abs(before) < 1.96) < 0.7
    assert np.mean(np.abs(after) < 1.96) >= 0.9


def test_right_statement_mostly_keeps_its_sd():
    """At the least it grows by 8 %: the strikes leave a probability of 3 % that the statement is wrong."""
    rng, sds = np.random.default_rng(2), []
    for seed in range(30):
        planes, errors = session(seed, PLANNED + float(rng.normal(0, STATED_SD)), axes=NINE)
        checked, _ = without_refuted_radii(planes, [0] * len(planes), errors, PRIOR)
        sds += [checked[0].radius_prior.common_sd / STATED_SD]
    assert np.median(sds) == pytest.approx(1.0, abs=0.15)
    assert np.mean(sds) < 1.35


@pytest.mark.parametrize(
    ("measured_mm", "sd_mm", "likely"),
    [
        ((1.0, 1.0, 1.0), 9.0, 0),
        ((1.0, 1.1, 0.9), 0.05, 0),
        ((0.3, 0.3, 0.4), 0.1, 2),
        ((0.1, 1.4, 0.6), 0.1, 1),
    ],
)
def test_odds_tell_a_wrong_mean_from_edges_that_differ(measured_mm, sd_mm, likely):
    """Stated are 1.0 ± 0.1 mm for three edges of three faces; hypotheses: right, unlike, alike but wrong."""
    information = np.eye(3) / (1e-3 * sd_mm) ** 2
    off = 1e-3 * np.array(measured_mm) - 1e-3
    stated = 1e-8 * (np.ones((3, 3)) + 0.2 * np.eye(3))
    wide = ASSUMED.common_sd**2 + np.eye(3) * (ASSUMED.face_sd**2 + ASSUMED.own_sd**2)
    wrong = probability_wrong(information @ off, information, (stated, wide), np.full(3, ASSUMED.mean - 1e-3))
    odds = [1 - wrong.any - wrong.alike, wrong.any, wrong.alike]
    assert np.argmax(odds) == likely
    assert odds[likely] > 0.75
    if sd_mm > 5:
        assert odds == pytest.approx([0.8, 0.1, 0.1], abs=0.01)


def test_strikes_that_hardly_determine_the_radius_leave_its_statement():
    """Three axes determine the radius only by the prior of the centre of mass, which is off by 1 sd."""
    sd = 5e-3
    off = ComPrior(BODY.com + sd, np.full(3, sd))
    for seed in range(3):
        planes, errors = session(seed, PLANNED, axes=SIX_AXES[:3])
        _, check = without_refuted_radii(planes, [0] * len(planes), errors, off)
        assert 1 < abs(check.difference_sds) < 1.5
        assert check.excess * STATED_SD < ASSUMED.sd


def test_wide_statement_covers_edges_that_differ():
    """Edges of 0.3 and 2 mm have a stated radius of 1.15 ± 0.85 mm."""
    axes = [planned_strike(BODY, *axis).axis_id for axis in SIX_AXES]
    rng = np.random.default_rng(4)

    def stated(seed: int, prior: RadiusPrior):
        radii = dict(zip(axes, rng.permutation([3e-4] * 3 + [2e-3] * 3).tolist(), strict=True))
        planes, errors = session(seed, radii)
        return expecting(planes, prior), errors

    alike = replace(SPREAD, own_sd=0.3 * SPREAD.common_sd)
    apart = deviations(stated(seed, SPREAD) for seed in range(24))
    assert np.mean(np.abs(deviations(stated(seed, alike) for seed in range(24))) < 1.96) < 0.85
    assert np.mean(np.abs(apart) < 1.96) >= 0.92


@pytest.mark.parametrize(("prior", "large"), [(SPREAD, 2e-3), (ASSUMED, 1.5e-3)])
def test_faces_whose_edges_differ_from_those_of_others_are_inside(prior, large):
    """Edges of 0.3 mm round one end, larger ones round the other.

    c_z was off while the difference of their radii counted as each edge's own error.
    """
    axes = (*UPRIGHT, (2, 1, 1, 1), (2, 1, 0, 1))
    names = [planned_strike(BODY, *axis).axis_id for axis in axes]

    def struck(seed: int, prior: RadiusPrior):
        below, above = (large, 3e-4) if seed % 2 else (3e-4, large)
        radii = {name: below if name.startswith("z-") else above for name in names}
        planes, errors = session(seed, radii, axes=axes)
        return expecting(planes, prior), errors

    alike = replace(prior, face_sd=0.0, own_sd=2**0.5 * prior.own_sd)
    before = deviations(struck(seed, alike) for seed in range(16))
    after = deviations(struck(seed, prior) for seed in range(16))
    assert np.mean(np.abs(before[:, 2]) < 1.96) < 0.85
    assert np.mean(np.abs(after) < 1.96) >= 0.9
    assert np.abs(after).max() < 2 * 1.96


def test_one_radius_stated_for_faces_that_differ_is_doubted_for_all_edges():
    """0.3 ± 0.1 mm is stated, and holds at one end only: c_z was up to 3.0 half widths off, 2.1 sd rms."""
    axes = (*UPRIGHT, (2, 1, 1, 1), (2, 1, 0, 1))
    names = [planned_strike(BODY, *axis).axis_id for axis in axes]
    stated = replace(STATED, mean=3e-4, face_sd=STATED.own_sd)
    found = []
    for seed in range(16):
        below, above = (2e-3, 3e-4) if seed % 2 else (3e-4, 2e-3)
        radii = {name: below if name.startswith("z-") else above for name in names}
        planes, errors = session(seed, radii, axes=axes)
        checked, _ = without_refuted_radii(expecting(planes, stated), [0] * len(planes), errors, PRIOR)
        found.append((checked, errors))
    z = deviations(found)
    assert np.mean(np.abs(z) < 1.96) >= 0.9
    assert np.abs(z).max() < 1.5 * 1.96


def test_k_that_errs_with_the_radius_is_corrected_by_it():
    """The moment balance's k is 1 % too large for each millimetre by which the radius exceeds the planned."""
    before, after, names = [], [], [planned_strike(BODY, *axis).axis_id for axis in NINE]
    rng = np.random.default_rng(3)
    for seed in range(16):
        radii = dict(zip(names, rng.uniform(0, 1.5e-3, len(names)).tolist(), strict=True))
        planes, errors = session(seed, radii, axes=NINE)
        planes = expecting(
            [replace(each, k=each.k * (1 + 10 * (radii[each.axis_id] - ASSUMED.mean))) for each in planes],
            ASSUMED,
        )
        before.append((planes, errors))
        after.append(([replace(each, by_radius=(0.0, 10 * each.k)) for each in planes], errors))
    rms = [np.sqrt(np.mean(deviations(sessions) ** 2)) for sessions in (before, after)]
    assert rms[1] < 0.85 * rms[0]
    assert rms[1] < 1.2


def test_axes_that_check_the_radius_are_told_from_those_that_do_not():
    for axes, face_sd, known in ((NINE, 0.0, True), (SIX_AXES, 0.0, True), (UPRIGHT[:3], 3e-4, False)):
        planes, errors = session(1, PLANNED, face_sd, axes)
        solution = solve_joint(with_radius_not_given(planes), errors, PRIOR, MomentModel(SCALE, SHAPE))
        assert strikes_determine_radius(solution) == known


def test_statement_that_the_strikes_cannot_check_stands():
    """Upright tips alone do not determine the radius."""
    checks = [
        check_stated_radii(*session(seed, 3e-4, face_sd=3e-4, axes=UPRIGHT), PRIOR) for seed in range(20)
    ]
    assert sum(check.refuted for check in checks) <= 1


def test_single_edge_that_differs_is_named():
    axes = [planned_strike(BODY, *axis).axis_id for axis in NINE]
    radii = dict.fromkeys(axes, PLANNED) | {axes[0]: 3e-3}
    check = check_stated_radii(*session(3, radii, axes=NINE), PRIOR)
    assert axes[0] in check.axis_ids


def test_no_stated_radius_means_no_check():
    planes, errors = session(0, 3e-4)
    assert check_stated_radii(with_radius_not_given(planes), errors, PRIOR) is None


def test_estimated_radius_is_within_its_interval():
    off = []
    for seed in range(25):
        planes, errors = not_given(*session(seed, 4e-4))
        solution = solve_joint(planes, errors, PRIOR, MomentModel(SCALE, SHAPE))
        radii = estimated_radii(solution)
        assert [each.axis_id for each in radii] == list(dict.fromkeys(plane.axis_id for plane in planes))
        assert all(each.sd < ASSUMED.sd for each in radii)
        off += [(each.value - 4e-4) / each.sd for each in radii]
    assert np.mean(np.abs(off) < 1.96) >= 0.9


def test_scan_errors_that_edges_of_one_face_share_are_covered():
    axes = tuple(
        (face, sign, along, side)
        for face, sign, along in ((2, -1, 1), (2, -1, 0), (0, -1, 1), (1, -1, 0))
        for side in (1, -1)
    )
    sessions = [session(seed, PLANNED, face_sd=3e-4, axes=axes) for seed in range(60)]
    shared = deviations(sessions)
    alone = deviations(([replace(plane, wall="") for plane in planes], errors) for planes, errors in sessions)
    assert 0.90 <= np.mean(np.abs(shared) < 1.96) <= 0.99
    rms = np.sqrt(np.mean(shared**2, axis=0))
    assert rms.max() < 1.25
    assert np.sqrt(np.mean(alone**2, axis=0)).max() > 1.1 * rms.max()


def test_strikes_on_leaning_walls_move_the_line_along_the_wall():
    planes, errors = session(0, PLANNED)
    leaning = [replace(plane, wall_lean=0.3) for plane in planes]
    upright, tilted = (centre_of_mass(each, errors, PRIOR) for each in (planes, leaning))
    assert not np.allclose(upright.covariance, tilted.covariance, rtol=1e-3, atol=0.0)
