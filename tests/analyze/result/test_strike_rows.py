"""Entries of strikes in the Result document."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analyze.estimation.edge_radii import EdgeRadius
from analyze.estimation.priors import Scale
from analyze.geometry.edge_radius import ASSUMED
from analyze.result.strike_rows import strike_result
from analyze.types import MotionFit, TipMotion
from schemas.strike_result import Verdict
from tests.analyze.estimation.bodies import SIX_AXES, box_body, planned_strike

SD_PHI, K, SD_K = 2e-4, 90.0, 0.2
BY_RADIUS = (0.0, 10 * K)
"""k errs by 1 % for each millimetre by which the radius exceeds the planned one."""


@pytest.mark.parametrize(("estimated", "sd"), [(1e-3, 2e-4), (3e-4, 2e-4), (3e-4, 0.0)])
def test_error_of_k_includes_that_of_the_planned_radius(estimated, sd):
    body = box_body((0.08, 0.06, 0.15), (0.02, 0.01, 0.0), 0.005, pitch=0.02)
    planned = planned_strike(body, *SIX_AXES[0])
    covariance = np.diag([SD_PHI**2, SD_K**2])
    fit = MotionFit("balance", 0.5, K, covariance, 0.0, 1.0, 0, (0, 9), np.zeros(9), by_radius=BY_RADIUS)
    motion = TipMotion("s1.1", planned.id, Verdict.GOOD, "tipped over", fit=fit)
    radii = [EdgeRadius(planned.axis_id, estimated, sd, ASSUMED)]
    row = strike_result(motion, planned, (), None, None, Scale(0.2, 1e-4, 9.81, 2e-3), radii)
    off = math.hypot(estimated - 1e-3, sd)
    assert row.k.sd == pytest.approx(math.hypot(SD_K, off * BY_RADIUS[1]))
    assert row.phi.sd == pytest.approx(SD_PHI)
    unknown = strike_result(motion, planned, (), None, None, Scale(0.2, 1e-4, 9.81, 2e-3), [])
    assert unknown.k.sd == pytest.approx(SD_K)
