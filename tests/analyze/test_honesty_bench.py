"""The trial of the whole answer (`make bench-honesty`) runs: sessions, scores, tables, and their limits."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console
from scipy.optimize import brentq

from schemas.result import Result
from tests.benchmarks.honesty.scores import Score, SessionScore, score_session
from tests.benchmarks.honesty.session import run_session, specimen
from tests.benchmarks.honesty.statics import true_tip
from tests.benchmarks.honesty.struck import Bank
from tests.benchmarks.honesty.tables import print_tables
from tests.benchmarks.honesty.verdicts import false_doubts, statuses


def test_session_is_scored_and_printed(tmp_path):
    trial = run_session("sharp", "none", 1, Bank(tmp_path))
    assert trial is not None
    scored = score_session(trial, "sharp", "none", 1)
    by_name = {score.name: score for score in scored.scores}
    assert abs(by_name["cx"].value - by_name["cx"].truth) < 1  # mm
    assert sum(score.quantity == "phi good (deg)" for score in scored.scores) >= 6
    _assert_regions_are_cut_along_the_answers_plane(trial, scored)
    out = io.StringIO()
    print_tables(Console(file=out, width=190), [scored])
    assert "centre of mass" in out.getvalue()


def test_intervals_of_one_specimen_count_as_one_for_the_deviation():
    """One specimen of five misses in each of its ten sessions: 20 %, to about as much."""
    sessions = []
    for seed in range(5):
        missed = 3.0 if seed == 0 else 0.0
        for disturbance in 10 * ["none"]:
            score = Score("c (mm)", "cx", "trust", missed, 0.0, -1.0, 1.0)
            sessions.append(SessionScore("lump", disturbance, seed, scores=[score]))
    out = io.StringIO()
    print_tables(Console(file=out, width=190), sessions)
    assert "80±20 " in out.getvalue()


def _assert_regions_are_cut_along_the_answers_plane(trial, scored):
    """Masses are stated on either side of the answer's plane, here another one than the body's own."""
    assert trial.result is not None
    made, regions = trial.specimen, trial.result.regions
    inside = made.masses[~made.in_shell], made.points[~made.in_shell]
    above = inside[1] @ np.array(regions.dividing_plane_normal) > regions.dividing_plane_offset_m
    share = 100 * inside[0][above].sum() / made.masses.sum()
    (upper,) = (each for each in scored.scores if (each.quantity, each.name) == ("regions (%)", "upper"))
    np.testing.assert_allclose(upper.truth, share, atol=1e-6)
    assert upper.holds


@pytest.mark.slow
def test_mislabelled_strikes_are_recognised_by_their_tags_at_rest(tmp_path):
    """A second whole session; motion/test_placement.py has the recognition itself."""
    trial = run_session("sharp", "mislabelled", 1, Bank(tmp_path))
    assert trial is not None
    assert trial.evidence is not None
    scored = score_session(trial, "sharp", "mislabelled", 1)
    assert (scored.mislabelled, scored.recognised, scored.misplaced) == (2, 2, 0)
    reasons = [motion.reason for motion in trial.evidence.motions if motion.fit is None]
    assert sum(reason.startswith("looks like") for reason in reasons) == 2
    assert scored.wrong_lines_good == 0


def test_bank_returns_the_motion_that_it_simulated(tmp_path):
    made, pose = specimen("rounded", 0), np.eye(3)
    first, again = Bank(tmp_path), Bank(tmp_path)
    simulated = first.motion(made, pose, 0.1, np.zeros(2), "over0")
    kept = again.motion(made, pose, 0.1, np.zeros(2), "over0")
    assert (first.simulated, again.simulated) == (1, 0)
    assert simulated is not None
    assert kept is not None
    np.testing.assert_array_equal(kept.position, simulated.position)
    assert simulated.over


def test_foot_balances_over_the_edge_that_lands_first():
    made = specimen("foot", 0)
    tip = true_tip(made, np.eye(3), np.zeros(2))
    assert tip is not None
    # The foot's edge lies 4 mm inside the chamfer's, which takes the tip over.
    np.testing.assert_allclose(tip.line[0], 0.045 - 3e-4, atol=1e-4)


def test_body_that_falls_at_rest_is_not_struck():
    made = specimen("hammer", 1)
    # The head's weight is not over the handle's end, 30 mm wide, on which the handle would stand.
    assert made.com[0] > -0.012
    assert true_tip(made, np.diag([-1.0, -1.0, 1.0]), np.zeros(2)) is None
    assert true_tip(made, np.diag([1.0, -1.0, -1.0]), np.zeros(2)) is not None


def test_edge_with_unlike_ends_rests_on_both_while_it_tips():
    made = specimen("mixed", 0)
    up, along = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    tip = true_tip(made, np.stack([np.cross(along, up), along, up]), np.zeros(2))
    assert tip is not None
    # It rolls until both ends touch the table; balance is then the maximum of c's height.
    ahead = np.cross(along, up)
    ends = [int(np.argmax(made.body.centres @ (side * along - up + ahead))) for side in (-1, 1)]

    def heights(roll, theta):
        normal = np.cos(roll) * (np.cos(theta) * up - np.sin(theta) * ahead) + np.sin(roll) * along
        return normal @ made.com - (made.body.centres[ends] @ normal - made.body.radii[ends])

    theta = tip.phi + np.radians(np.linspace(-1, 1, 21))
    rolls = [brentq(lambda roll, at=at: np.diff(heights(roll, at))[0], -0.01, 0.01) for at in theta]
    curve = np.polyfit(theta - tip.phi, [heights(*each)[0] for each in zip(rolls, theta, strict=True)], 2)
    assert abs(np.degrees(curve[1] / (2 * curve[0]))) < 0.01


def test_half_widths_off_count_from_the_middle_of_the_interval():
    score = Score("c (mm)", "cx", "trust", truth=3.0, value=1.0, low=0.0, high=2.0)
    assert not score.holds
    assert score.half_widths_off == 2


def test_verdict_is_read_by_quantity():
    verdict = [
        "trust the centre of mass, to 0.2 mm: 9 of 9 strikes move as predicted from the others",
        "trust Ixx, Izz of the tensor: strikes measured them",
        "doubt Iyy of the tensor: they come from the shape",
        "doubt strike s1.1: its estimators differ",
    ]
    result = Result.model_construct(verdict=verdict)
    found = statuses(result)
    assert (found["c"], found["Ixx"], found["Iyy"], found["regions"]) == (
        "trust",
        "trust",
        "doubt",
        "not mentioned",
    )
    assert false_doubts(result) == verdict[3:]
