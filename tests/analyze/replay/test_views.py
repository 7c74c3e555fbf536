"""Arrays that a replay draws: poses, curves, plane sections, regions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from analyze.pipeline.estimate import estimate_evidence
from analyze.replay import views
from tests.analyze.simulated_session import carton, session


@pytest.fixture(scope="module")
def evidence():
    evidence = session(carton(), np.random.default_rng(5), repeats=1)
    # the simulated tip begins with frame 29: frame 30 is its first step
    motions = [
        dataclasses.replace(m, fit=dataclasses.replace(m.fit, time0_ns=int(m.angle.time_ns[29])))
        for m in evidence.motions
    ]
    return dataclasses.replace(evidence, motions=tuple(motions))


@pytest.fixture(scope="module")
def estimate(evidence):
    return estimate_evidence(evidence)


def test_object_turns_about_its_pivot(evidence):
    motion = evidence.motions[0]
    planned = evidence.planned(motion)
    R, p = views.object_poses(planned, motion.angle)
    pivot = np.array(planned.pivot.point)
    rolled = planned.pivot.radius_m * motion.angle.theta[:, None] * [1.0, 0.0, 0.0]
    np.testing.assert_allclose(
        R @ pivot + p - rolled, np.tile(R[0] @ pivot + p[0] - rolled[0], (len(R), 1)), atol=1e-12
    )
    np.testing.assert_allclose(R[0], np.array(planned.R_world_object), atol=5e-3)
    assert np.all(np.linalg.det(R) > 0.999999)


def test_centre_of_mass_is_above_the_pivot_at_phi(evidence, estimate):
    for motion in evidence.motions:
        planned = evidence.planned(motion)
        R, p = views.object_poses(planned, motion.angle)
        path = R @ estimate.com.position + p
        pivot = R @ np.array(planned.pivot.point) + p
        side = np.interp(motion.fit.phi, motion.angle.theta[33:-14], (path - pivot)[33:-14, 0])
        assert abs(side) < 1e-3  # 0.05 degrees of noise per frame at 80 mm, and the estimate's own error


def test_fitted_curves_follow_the_measured_ones(evidence):
    motion = evidence.motions[0]
    fitted = views.fitted_curves(motion.angle, motion.fit)
    assert np.degrees(np.std(fitted.residual)) < 0.1
    measured = views.measured_curves(motion.angle)
    middle = slice(5, -5)
    rate = np.interp(fitted.time_ns, measured.time_ns, measured.omega)[middle]
    assert (
        np.degrees(np.sqrt(np.mean((rate - fitted.omega[middle]) ** 2))) < 10.0
    )  # 0.05 deg at 120 fps, differenced


def test_plane_section_lies_on_plane_and_hull(evidence, estimate):
    for plane in estimate.planes:
        cut = views.plane_section(evidence.model, plane.point, plane.normal, margin=1.0)
        assert len(cut) >= 3
        np.testing.assert_allclose((cut - plane.point) @ plane.normal, 0.0, atol=1e-12)
        assert np.all(cut >= evidence.model.bounds[0] - 1e-9)
        assert np.all(cut <= evidence.model.bounds[1] + 1e-9)
    outside = views.plane_section(evidence.model, np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    assert outside.shape == (0, 3)


def test_ellipsoid_holds_95_percent():
    rng = np.random.default_rng(2)
    A = rng.normal(size=(3, 3)) * 1e-3
    half, axes = views.ellipsoid(A @ A.T, 0.0)
    drawn = rng.normal(size=(20_000, 3)) @ A.T
    assert np.mean(np.sum((drawn @ axes / half) ** 2, axis=1) < 1) == pytest.approx(0.95, abs=0.01)


def test_fitted_acceleration_agrees_with_the_fitted_angle(evidence):
    motion = evidence.motions[0]
    fitted = views.fitted_curves(motion.angle, motion.fit)
    # about the edge theta'' = k (theta - phi) near the balance, whatever the estimator
    near = np.abs(fitted.theta - motion.fit.phi) < 0.12
    slope = np.polyfit(fitted.theta[near] - motion.fit.phi, fitted.alpha[near], 1)[0]
    assert slope == pytest.approx(motion.fit.k, rel=0.1)
    measured = views.measured_curves(motion.angle)
    assert len(measured.alpha) == len(measured.theta)
    middle = (measured.time_ns > fitted.time_ns[5]) & (measured.time_ns < fitted.time_ns[-6])
    smooth = np.interp(measured.time_ns[middle], fitted.time_ns, fitted.alpha)
    assert (
        np.sqrt(np.mean((measured.alpha[middle] - smooth) ** 2)) < 8.0
    )  # rad/s^2: 0.05 deg at 120 fps, differentiated twice


def test_drawn_answer_has_regions_and_a_density_for_every_cell(estimate):
    answer = views.drawn_answer(estimate)
    assert [region.name for region in answer.regions] == list(estimate.distribution.names)
    assert len(answer.voxels.points) == len(answer.voxels.density)


def test_balance_moment_is_the_end_of_stage_one_or_a_default(evidence):
    motion = evidence.motions[0]
    contact = views.contact_from_motion(motion)
    assert 0.02 < views.balance_moment(motion, contact) < 0.6
    assert views.balance_moment(None, None) == pytest.approx(0.2)
    assert views.balance_moment(dataclasses.replace(motion, angle=None), contact) == pytest.approx(0.2)


def test_contact_from_the_motion_is_the_begin_of_the_tip_within_a_frame(evidence):
    for motion in evidence.motions:
        time_ns = motion.angle.time_ns
        assert abs(views.contact_from_motion(motion) - time_ns[29]) <= time_ns[1] - time_ns[0]
    assert views.contact_from_motion(dataclasses.replace(motion, phases=None)) is None
    first = motion.angle.time_ns[motion.phases.strike[0]]
    assert views.contact_from_motion(dataclasses.replace(motion, fit=None)) == first


def test_names_are_spread_as_little_as_their_height_requires():
    places = np.array([0.07, 0.0, 0.071, -0.07])
    moved = views.spread(places, 0.01)
    assert np.all(np.diff(np.sort(moved)) >= 0.01 - 1e-12)
    assert moved == pytest.approx([0.0655, 0.0, 0.0755, -0.07])
