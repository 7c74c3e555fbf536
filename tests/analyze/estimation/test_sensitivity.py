"""Sensitivity of c compared with a new estimate after one strike, stated error or mass was changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel, solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.priors import ComPrior
from analyze.estimation.sensitivity import ErrorSource
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.estimate import estimate_evidence
from schemas.object_spec import MarkerSpec
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")

STEP_RAD = 1e-5


@pytest.fixture(scope="module")
def evidence():
    return session(carton(), np.random.default_rng(3), repeats=2)


@pytest.fixture(scope="module")
def estimate(evidence):
    return estimate_evidence(evidence)


def solved(estimate, planes, systematic=None):
    evidence = estimate.evidence
    moments = MomentModel(estimate.scale, shape_prior(estimate.cells))
    return solve_joint(
        planes,
        systematic or systematic_errors(evidence),
        ComPrior.from_bounds(*evidence.model.bounds),
        moments,
    )


def test_influence_of_a_strike_agrees_with_a_new_estimate(estimate):
    planes = estimate.fitted_planes
    # The new estimate weighs the strikes by a new scatter.
    before = solved(estimate, planes).x[COM]
    for i in (0, 5, 11):
        influence = estimate.sensitivity.strikes[i]
        assert influence.strike_id == planes[i].strike_id
        turned = [
            replace(plane, phi=plane.phi + STEP_RAD) if j == i else plane for j, plane in enumerate(planes)
        ]
        assert np.allclose(
            (solved(estimate, turned).x[COM] - before) / STEP_RAD, influence.by_phi, rtol=0.02, atol=5e-4
        )
        faster = [
            replace(p, k=p.k * (1 + 1e-5), sd_k=p.sd_k * (1 + 1e-5)) if j == i else p
            for j, p in enumerate(planes)
        ]
        assert np.allclose(
            (solved(estimate, faster).x[COM] - before) / 1e-5, influence.by_log_k, rtol=0.02, atol=5e-4
        )


def test_contributions_add_up_to_the_covariance(estimate):
    total = sum(share.covariance for share in estimate.sensitivity.shares)
    assert np.allclose(total, estimate.com.covariance, rtol=1e-6, atol=1e-15)
    for share in estimate.sensitivity.shares:
        assert np.linalg.eigvalsh(share.covariance).min() > -1e-9 * np.trace(estimate.com.covariance)


def test_contribution_of_the_tilt_agrees_with_the_strikes_influence(estimate):
    """All strikes have one heading, so that a tilt changes each phi equally."""
    planes = equiplanes(estimate.evidence, estimate.evidence.motions)
    sd = solved(estimate, planes).model.systematic.gravity_tilt_sd
    moved = sd * sum(each.by_phi for each in estimate.sensitivity.strikes)
    part = next(share.covariance for share in estimate.sensitivity.shares if share.source is ErrorSource.TILT)
    # The strikes scatter by more than stated, which widens the covariance and not the estimate.
    assert np.allclose(np.outer(moved, moved), part, rtol=0.25, atol=1e-13)


@pytest.mark.parametrize(
    ("source", "without"),
    [
        (ErrorSource.TILT, {"gravity_tilt_sd": 1e-9}),
        (ErrorSource.ROUNDING, {"edge_radius_sd": 1e-9}),
        (ErrorSource.ANGLE, {"axis_angle_sd": 1e-9}),
    ],
)
def test_contribution_agrees_with_an_estimate_without_the_error(estimate, source, without):
    """Without a source the covariance falls by its contribution or more.

    The strikes are then also weighted better.
    """
    evidence = estimate.evidence
    systematic = replace(systematic_errors(evidence), **without)
    planes = estimate.fitted_planes
    if source is ErrorSource.ROUNDING:
        planes = tuple(replace(plane, radius_prior=None) for plane in planes)
    less = solved(estimate, planes, systematic)
    part = next(share.covariance for share in estimate.sensitivity.shares if share.source is source)
    gained = np.trace(estimate.com.covariance - less.covariance[COM, COM])
    assert 0.4 * gained < np.trace(part) < 1.02 * gained


def test_mass_of_markers_contributes(evidence):
    marker = MarkerSpec(id=0, size_m=0.03, mass_kg=2e-3, thickness_m=1e-3, T_object_marker=np.eye(4).tolist())
    spec = evidence.spec.model_copy(update={"marker": [marker], "mass_sd_kg": 5e-4})
    found = estimate_evidence(replace(evidence, spec=spec))
    total = sum(share.covariance for share in found.sensitivity.shares)
    assert np.allclose(total, found.com.covariance, rtol=1e-6, atol=1e-15)
    assert ErrorSource.MASS in {share.source for share in found.sensitivity.shares}
