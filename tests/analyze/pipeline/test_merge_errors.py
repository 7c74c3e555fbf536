"""Errors of merged recordings: their covariance, and what shared errors and differing bodies do to it."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.agreement import Agreement, agreement
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import merge_evidence
from analyze.result.answer import answer_evidence
from schemas.result import WarningCode
from tests.analyze.estimation.bodies import SIX_AXES, box_body, planned_strike
from tests.analyze.pipeline.merged_sessions import (
    BODY,
    com_of,
    part,
    recording,
    session_without_frames,
)
from tests.analyze.simulated_session import session

pytestmark = pytest.mark.usefixtures("coarse_regions")

CHI2_RUNS = 40
CHI2_3 = (1.85, 4.35)
"""limits of the mean of 40 values of chi squared with 3 degrees of freedom: 3 - 3 and 3 + 3.5 standard
deviations (2.45 / sqrt 40 each), because its distribution is skew"""


def squared_mahalanobis(seed: int, *, tables: int) -> float:
    """Squared Mahalanobis error of c from two merged sessions with errors drawn from their stated sd."""
    rng = np.random.default_rng(seed)
    sd_edge, sd_tilt = 2e-4, 1e-3
    moved: dict[str, np.ndarray] = {}
    for axis in SIX_AXES:
        strike = planned_strike(BODY, *axis)
        turned = np.array(strike.R_world_object)
        moved[strike.axis_id] = turned[0] * rng.normal(0, sd_edge) + turned[2] * rng.normal(0, sd_edge)
    radius = rng.normal(0, 1e-4)
    for axis in SIX_AXES:
        strike = planned_strike(BODY, *axis)
        turned = np.array(strike.R_world_object)
        moved[strike.axis_id] = moved[strike.axis_id] + (turned[2] - turned[0]) * radius
    tilts = rng.normal(0, sd_tilt, 2)
    if tables == 1:
        tilts[1] = tilts[0]
    slips = {axis: rng.normal(0, 2e-4) for axis in moved}
    sessions = []
    for i, axes in enumerate((SIX_AXES[:4], SIX_AXES[2:])):
        found = session_without_frames(rng, tilts[i], moved, axes)
        motions = [
            replace(m, fit=dataclasses.replace(m.fit, phi=m.fit.phi + slips[found.planned(m).axis_id]))
            for m in found.motions
        ]
        rig = {"name": f"bench {i if tables == 2 else 0}"}
        sessions.append(
            recording(
                replace(found, motions=tuple(motions)),
                "ab"[i] * (i + 1),
                rig=rig,
                gravity_tilt_sd_rad=sd_tilt,
            )
        )
    com = com_of(merge_evidence(sessions))
    off = com.position - BODY.com
    return float(off @ np.linalg.solve(com.covariance, off))


def refilled(evidence: Evidence, moved_kg: float) -> Evidence:
    """Evidence of the same object with `moved_kg` of its upper part moved to the lower."""
    body = box_body(
        (0.08, 0.06, 0.15), (0.026, 0.014 - moved_kg, 0.004 + moved_kg), 0.005, (0.5, -0.35, 0.79)
    )
    other = session(body, np.random.default_rng(2))
    return replace(evidence, motions=other.motions, plan=other.plan)


def test_object_refilled_between_recordings_gives_a_warning(whole, halves, joint):
    assert WarningCode.RECORDINGS_DISAGREE not in {warning.code for warning in joint.result.warnings}
    found = answer_evidence(merge_evidence((halves[0], part(refilled(whole, 0.002), 6, 12, "bb"))))
    text = next(
        warning.text for warning in found.result.warnings if warning.code is WarningCode.RECORDINGS_DISAGREE
    )
    assert re.search(
        r"centres of mass lie 2\.\d mm apart, more than their errors allow: was the object opened, refilled"
        r" or exchanged",
        text,
    )


def test_recordings_of_one_body_agree_and_of_two_bodies_disagree(whole):
    def compared(*evidence: Evidence) -> Agreement:
        both = merge_evidence(evidence)
        planes = equiplanes(both, both.motions)
        numbers = [both.recorded_in.get(plane.strike_id, 0) for plane in planes]
        return agreement(
            planes, numbers, com_of(both), systematic_errors(both), ComPrior.from_bounds(*both.model.bounds)
        )

    alone = compared(whole)
    assert alone.holds
    assert alone.chi_squared == 0
    one = part(whole, 0, 12, "a")
    same = compared(one, part(refilled(whole, 0.0), 0, 12, "bb"))
    assert same.holds
    assert same.largest_shift < 1e-4
    other = compared(one, part(refilled(whole, 0.0005), 0, 12, "bb"))
    assert not other.holds
    # 0.5 g moved by 67 mm in 44 g
    assert other.largest_shift == pytest.approx(7.7e-4, rel=0.1)


@pytest.mark.parametrize("tables", [1, 2])
def test_covariance_of_joint_sessions_matches_the_errors(tables):
    found = np.array([squared_mahalanobis(seed, tables=tables) for seed in range(CHI2_RUNS)])
    low, high = CHI2_3
    assert low < found.mean() < high
    assert np.mean(found < 7.81) > 0.86, "95 % regions hold the true value"
