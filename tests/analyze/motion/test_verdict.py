"""Verdicts on motions given as arrays: each limit, just inside and just outside."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analyze.motion import strike
from analyze.motion.phases import Course
from analyze.motion.settings import MotionSettings, VerdictLimits
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import PlanarMotion
from analyze.motion.verdict import judge_contact, judge_fit, judge_hard, judge_motion, judge_vague
from analyze.types import MotionFit, TipAngle
from schemas.strike_result import Verdict
from tests.analyze.motion.tipping import planned

LIMITS = VerdictLimits()
N = 60
FRAME_NS = 8_333_333
COURSE = Course(moved_frame=10, released_frame=13, top_frame=N - 1, end_frame=N, came_back=False)


def motion(theta_max=1.2, slip=0.0, lift=0.0, off_axis=0.0):
    """Smooth tip over 60 frames, with the given slip, lift and rotation off the axis from frame 20 on."""
    theta = np.where(np.arange(N) < 10, 0.0, theta_max * (np.arange(N) - 9) / (N - 10))
    late = np.arange(N) >= 20
    angle = TipAngle(
        np.arange(N) * FRAME_NS,
        theta,
        np.full(N, 1e-4),
        off_axis * late,
        np.asarray(slip * late, dtype=float),
    )
    sd = np.full(N, 1e-5)
    return PlanarMotion(angle, lift * late, sd, np.full(N, 1e-4), 0.0, np.zeros((N, 3, 3)))


def fit(phi=0.6, phi_sd=1e-3):
    return MotionFit(
        "pivot_fit", phi, 70.0, np.diag([phi_sd**2, 1.0]), 0.0, 4.0, 0, (13, N), np.zeros(N - 13)
    )


@pytest.fixture
def task():
    return StrikeTask("s1.1", planned())


def without_frames(whole, dropped):
    kept = np.delete(np.arange(N), dropped)
    angle = whole.angle
    return replace(
        whole,
        angle=TipAngle(
            angle.time_ns[kept], angle.theta[kept], angle.sd[kept], angle.off_axis[kept], angle.slip[kept]
        ),
    ), replace(COURSE, top_frame=len(kept) - 1, end_frame=len(kept))


def test_a_tip_has_no_verdict_by_its_raw_motion(task):
    assert judge_motion(motion(), COURSE, task, LIMITS) is None


def test_an_object_that_did_not_turn_has_not_moved_or_slid(task):
    still = Course(moved_frame=None, released_frame=None, top_frame=None, end_frame=N, came_back=False)
    assert judge_motion(motion(theta_max=0.0), still, task, LIMITS).code is Verdict.NOT_MOVED
    assert judge_motion(motion(theta_max=0.0, slip=0.01), still, task, LIMITS).code is Verdict.SLID


@pytest.mark.parametrize(("gap", "lost"), [(LIMITS.max_marker_gap, False), (LIMITS.max_marker_gap + 1, True)])
def test_a_gap_is_a_lost_marker_beyond_its_limit(task, gap, lost):
    seen, course = without_frames(motion(), slice(20, 20 + gap))
    found = judge_motion(seen, course, task, LIMITS)
    assert (found is not None and found.code is Verdict.MARKER_LOST) == lost


def test_missing_images_are_the_cameras_fault_not_the_markers(task):
    seen, course = without_frames(motion(), slice(15, 55))
    unmarked = replace(task, unmarked_ns=np.zeros(0, dtype=np.int64))
    found = judge_motion(seen, course, unmarked, LIMITS)
    assert found.code is Verdict.UNREADABLE
    assert "the camera left frames out" in found.reason


@pytest.mark.parametrize(
    ("deviation", "rolls", "verdict"),
    [
        ({"slip": 1.1 * LIMITS.slip}, False, Verdict.SLID),
        ({"slip": 0.9 * LIMITS.slip}, False, None),
        ({"lift": 1.1 * LIMITS.lift}, False, Verdict.AIRBORNE),
        ({"lift": 0.9 * LIMITS.lift}, False, None),
        ({"off_axis": 1.1 * LIMITS.twist}, False, Verdict.TWISTED),
        ({"off_axis": 1.1 * LIMITS.twist}, True, Verdict.ROLLED),
        ({"off_axis": 0.9 * LIMITS.twist}, False, None),
    ],
)
def test_the_contact_is_judged_within_the_window(deviation, rolls, verdict):
    found = judge_contact(motion(**deviation), (13, N), rolls, LIMITS)
    assert (None if found is None else found.code) is verdict
    assert judge_contact(motion(**deviation), (13, 20), rolls, LIMITS) is None, "before it happened"


def test_a_lift_after_the_balance_counts_only_for_a_hard_strike():
    flown = motion(lift=2 * LIMITS.lift)
    assert judge_hard(flown, COURSE, 0.9 * LIMITS.hard_energy_ratio, LIMITS) is None
    assert judge_hard(flown, COURSE, 1.1 * LIMITS.hard_energy_ratio, LIMITS).code is Verdict.AIRBORNE
    assert judge_hard(motion(), COURSE, 1.1 * LIMITS.hard_energy_ratio, LIMITS) is None


def test_a_vague_phi_is_rocked_back_or_unreadable():
    vague = fit(phi_sd=2 * LIMITS.phi_sd)
    assert judge_vague(fit(), COURSE, 1.2, LIMITS) is None
    assert judge_vague(vague, COURSE, 0.3, LIMITS).code is Verdict.ROCKED_BACK
    assert judge_vague(vague, COURSE, 1.2, LIMITS).code is Verdict.UNREADABLE


def test_a_clean_motion_tipped_or_rocked_back():
    assert judge_fit(fit(), COURSE, 1.1, 1.2).code is Verdict.GOOD
    assert judge_fit(fit(), replace(COURSE, came_back=True), 0.9, 0.4).code is Verdict.ROCKED_BACK
    assert judge_fit(fit(), COURSE, 0.9, 0.4).code is Verdict.ROCKED_BACK


def test_a_rim_that_rolled_is_not_said_to_have_left_the_table():
    """Rolling along a rim lifts the planned point: by 3 to 10 mm where its place is known to 30 mm."""
    rolled = motion(lift=0.01, off_axis=0.15)
    found = judge_contact(rolled, (13, N), rolls=True, limits=LIMITS)
    assert found is not None
    assert found.code is Verdict.ROLLED
    assert "turn its heavy side towards the striker" in found.reason
    found = judge_contact(rolled, (13, N), rolls=False, limits=LIMITS)
    assert found is not None
    assert found.code is Verdict.AIRBORNE


@pytest.mark.parametrize("rolls", [True, False])
def test_an_uncertain_balance_point_on_a_rim_is_put_down_to_rolling(monkeypatch, task, rolls):
    """An object rolls aside from 5 deg past its supposed balance on: striking less hard does not help."""
    seen = motion(lift=0.01)
    seen.angle.off_axis[42:] = 0.15
    seen.lift[:42] = 0.0
    fits = SimpleNamespace(chosen=fit(phi_sd=0.1), motion=seen, second_impact=None, problem="", others=())
    monkeypatch.setattr(strike, "fit_strike", lambda *_: fits)
    monkeypatch.setattr(strike, "find_course", lambda *_: COURSE)
    monkeypatch.setattr(strike, "measure_pivot", lambda *_: None)
    at = replace(task, planned=task.planned.model_copy(update={"rolls": rolls}))
    found = strike._analysed(seen, at, MotionSettings())
    assert found.fit is None
    assert found.verdict is (Verdict.ROLLED if rolls else Verdict.UNREADABLE)
    assert ("turn its heavy side towards the striker" in found.reason) is rolls
