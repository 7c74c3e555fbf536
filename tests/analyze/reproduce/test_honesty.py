"""Errors over stated sd: drawn errors have the stated sd, and repeating errors are separated."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.reproduce.paper.miscalibrated import (
    K_SD,
    MASS_SD,
    OWN_RADIUS_SD,
    RADIUS_SD,
    TILT_SD,
    with_calibration_errors,
)
from analyze.reproduce.paper.record import Condition, MethodAnswer, SessionRecord, ThetaSource
from analyze.reproduce.paper.scores import scatter_of_mean, standardised_masses
from schemas.strike_plan import PlanMethod
from tests.analyze.reproduce.theta_sessions import theta_session

DRAWS = 400


def session(off_sd: float) -> SessionRecord:
    """Session on a body without a lower part whose masses are off by `off_sd` of their stated sd."""
    true, sd = np.array([0.03, 0.01, 0.0]), np.array([2e-3, 1e-3, 1e-3])
    found = true + off_sd * sd
    answer = MethodAnswer(
        com_m=(0.0, 0.0, 0.0),
        masses_kg=found.tolist(),
        masses_sd_kg=sd.tolist(),
        masses_low_kg=(found - 2 * sd).tolist(),
        masses_high_kg=(found + 2 * sd).tolist(),
    )
    return SessionRecord(
        object="carton",
        seed=1,
        source=ThetaSource.SIMULATED,
        method=PlanMethod.OURS,
        strikes=9,
        axes=3,
        singular=False,
        mass_kg=0.04,
        volume_m3=1e-3,
        centroid_m=(0.0, 0.0, 0.0),
        true_com_m=(0.0, 0.0, 0.0),
        true_masses_kg=true.tolist(),
        cpu_s=1.0,
        angles=[],
        ours={Condition.DRAWN: answer},
        paper={},
        naive_kg={},
    )


@pytest.mark.parametrize(
    ("offs", "scatter", "alike", "held"),
    [((1, -1), 1, 0, 1), ((1, 1), 1, 1, 1), ((3, 1), np.sqrt(5), 2, 0.5)],
)
def test_scatter_and_scatter_of_the_mean(offs, scatter, alike, held):
    records = [session(off) for off in offs]
    found = standardised_masses(records, Condition.DRAWN, "")
    # The empty part's mass is at its lower bound: its error does not test the sd, but its interval counts.
    assert len(found.scores) == 2 * len(offs)
    assert len(found.held) == 3 * len(offs)
    assert found.scatter == pytest.approx(scatter)
    assert found.held.mean() == pytest.approx(held)
    assert scatter_of_mean(records, Condition.DRAWN) == pytest.approx(alike, abs=1e-9)


def test_drawn_errors_have_the_stated_sd():
    evidence, _ = theta_session("carton", 1)
    rng = np.random.default_rng(3)
    before = {
        motion.strike_id: motion.fit.k
        for motion in evidence.motions
        if motion.fit is not None and motion.fit.k
    }
    axis_of = {strike.id: strike.axis_id for strike in evidence.plan.strikes}
    axes = sorted(set(axis_of.values()))
    slower, masses, rounder = [], [], []
    for _ in range(DRAWS):
        drawn = with_calibration_errors(evidence, rng)
        ratio = {axis: set() for axis in axes}
        for motion in drawn.motions:
            if motion.strike_id in before:
                ratio[axis_of[motion.plan_strike_id]].add(
                    round(motion.fit.k / before[motion.strike_id] - 1, 12)
                )
        assert all(len(each) == 1 for each in ratio.values()), "strikes about one axis share its k"
        slower.append([next(iter(ratio[axis])) for axis in axes])
        masses.append(drawn.spec.mass_kg - evidence.spec.mass_kg)
        of_axis = {strike.axis_id: strike.pivot.radius_m for strike in drawn.plan.strikes}
        rounder.append([of_axis[axis] for axis in axes])
        assert drawn.spec.mass_sd_kg == MASS_SD
        assert drawn.spec.edge_radius_sd_m == RADIUS_SD
        assert drawn.manifest.gravity_tilt_sd_rad == TILT_SD
    assert np.std(slower) == pytest.approx(K_SD, rel=0.1)
    assert np.std(masses) == pytest.approx(MASS_SD, rel=0.12)
    assert np.std(np.diff(rounder, axis=1)) == pytest.approx(np.sqrt(2) * OWN_RADIUS_SD, rel=0.12)
    assert np.std(np.mean(rounder, axis=1)) == pytest.approx(RADIUS_SD, rel=0.12)
