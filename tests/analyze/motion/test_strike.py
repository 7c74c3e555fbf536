"""One strike from corners to verdict, phi and k; and motions that each verdict is made for."""

from dataclasses import replace

import numpy as np
import pytest

from analyze.motion.strike import analyse_strike, end_of_rest_ns, placement_of
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import tip_angle
from schemas.strike_result import Verdict
from tests.analyze.motion.tipping import camera, marker, planned, simulate, track_of

ANCHOR = 10**18


def analyse(tip, tracks=None, markers=None, rolls=False, contact_known=True, unmarked=None, **how):
    tracks = tracks or [track_of(tip, np.random.default_rng(4), **how)]
    contact = int(tip.contact * 1e9) + ANCHOR if contact_known else 0
    task = StrikeTask(
        "s1.1",
        planned(how.get("rho", 0.002), rolls=rolls),
        contact,
        int(tip.time[-1] * 1e9) + ANCHOR,
        unmarked_ns=unmarked,
    )
    return analyse_strike(tracks, markers or [marker()], camera(), task)


def ramp(tip, start=30, length=40):
    return np.clip((np.arange(len(tip.time)) - start) / length, 0, 1)


@pytest.mark.parametrize(
    "how", [{}, {"yaw": np.radians(1.0)}, {"yaw": np.radians(-1.5), "offset": (0.002, 0.001)}]
)
def test_a_good_strike(how):
    tip = simulate(1.05)
    motion = analyse(tip, **how)
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.01
    assert abs(motion.fit.k / tip.k - 1) < 0.005
    assert motion.energy_ratio == pytest.approx(1.05, abs=0.003)
    assert np.degrees(np.std((motion.angle.theta - tip.theta)[:90])) < 0.012
    assert np.abs(motion.angle.slip[:90]).max() < 0.0002
    assert [fit.estimator for fit in motion.alternatives] == ["sign_change"]


def test_strain_that_the_calibration_states_widens_phi():
    tip = simulate(1.05)
    track = track_of(tip, np.random.default_rng(4))
    task = StrikeTask(
        "s1.1", planned(0.002), int(tip.contact * 1e9) + ANCHOR, int(tip.time[-1] * 1e9) + ANCHOR
    )
    exact, strained = (
        analyse_strike([track], [marker()], replace(camera(), strain_sd=sd), task).fit for sd in (0.0, 2e-3)
    )
    assert strained.phi == exact.phi
    by_strain = np.sqrt(strained.covariance[0, 0] - exact.covariance[0, 0])
    assert by_strain == pytest.approx(2e-3 * np.sin(exact.phi) / np.sqrt(2), rel=0.15)


@pytest.mark.parametrize("slower", [8.0, 0.5])
def test_slow_motion_taken_for_true_is_a_good_strike_with_another_k(slower):
    tip = simulate(1.05)
    track = track_of(tip, np.random.default_rng(4))
    begin = int(track.time_ns[0])
    stretched = replace(track, time_ns=begin + np.round((track.time_ns - begin) * slower).astype(np.int64))
    task = StrikeTask("s1.1", planned(0.002), 0, int(stretched.time_ns[-1]))
    motion = analyse_strike([stretched], [marker()], camera(), task)
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.01
    assert abs(motion.fit.k * slower**2 / tip.k - 1) < 0.005


@pytest.mark.parametrize("energy", [1.02, 1.3, 2.0, 3.0])
def test_every_energy_over_the_top_is_good(energy):
    tip = simulate(energy)
    motion = analyse(tip)
    assert motion.verdict is Verdict.GOOD
    assert abs(motion.fit.phi - tip.phi) < max(np.radians(0.02), 3.5 * np.sqrt(motion.fit.covariance[0, 0]))


@pytest.mark.parametrize("energy", [0.6, 0.9, 0.98])
def test_rocking_back_gives_phi(energy):
    tip = simulate(energy)
    motion = analyse(tip)
    assert motion.verdict is Verdict.ROCKED_BACK
    assert abs(motion.fit.phi - tip.phi) < 4 * np.sqrt(motion.fit.covariance[0, 0])
    assert motion.energy_ratio == pytest.approx(energy, abs=0.05)


def test_a_strike_is_analysed_without_a_contact_time():
    tip = simulate(1.05)
    motion = analyse(tip, contact_known=False)
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.01


def test_phases_lie_in_order():
    tip = simulate(1.1)
    phases = analyse(tip).phases
    assert phases.rest[1] == phases.strike[0]
    assert phases.strike[1] == phases.stage_one[0]
    assert phases.stage_one[1] == phases.stage_two[0]
    assert phases.stage_two[1] == phases.landing[0]
    assert tip.theta[phases.stage_two[0] - 1] < tip.phi <= tip.theta[phases.stage_two[0]] + 1e-3
    assert tip.theta[phases.landing[0]] > np.radians(80)


def test_slid():
    tip = simulate(1.05)
    motion = analyse(tip, slip=0.008 * ramp(tip))
    assert motion.verdict is Verdict.SLID
    assert "8.0 mm" in motion.reason or "7." in motion.reason


def test_airborne():
    tip = simulate(1.3)
    assert (
        analyse(tip, lift=0.005 * np.exp(-(((np.arange(len(tip.time)) - 38) / 4) ** 2))).verdict
        is Verdict.AIRBORNE
    )


@pytest.mark.parametrize(("rolls", "verdict"), [(False, Verdict.TWISTED), (True, Verdict.ROLLED)])
def test_twisted_or_rolled(rolls, verdict):
    tip = simulate(1.05)
    assert analyse(tip, rolls=rolls, twist=np.radians(8) * ramp(tip)).verdict is verdict


def test_a_small_wobble_leaves_phi_alone():
    tip = simulate(1.05)
    motion = analyse(tip, twist=np.radians(2) * ramp(tip))
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.02


def test_struck_twice_and_what_follows_is_still_fitted():
    tip = simulate(1.0, speed_change=(0.12, 1.3))
    motion = analyse(tip)
    assert motion.verdict is Verdict.STRUCK_TWICE
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.05


def test_a_light_second_contact_right_after_the_first_leaves_a_good_strike():
    tip = simulate(1.05, speed_change=(0.045, 1.05))
    motion = analyse(tip)
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.02
    assert "the striker still touched" in motion.fit.note


def test_a_phi_hardly_known_is_not_used():
    tip = simulate(0.6)
    motion = analyse(tip, sd=0.4)
    assert motion.verdict is Verdict.ROCKED_BACK
    assert motion.fit is None
    assert motion.energy_ratio is None
    assert "deg only: strike harder" in motion.reason


def test_not_moved():
    motion = analyse(simulate(1e-6))
    assert motion.verdict is Verdict.NOT_MOVED
    assert motion.fit is None


def seen_in(track, kept):
    fields = {
        name: getattr(track, name)[kept]
        for name in ("time_ns", "corners_px", "corner_sd_px", "R_camera_marker", "p_camera_marker")
    }
    return type(track)(track.marker_id, frames_total=track.frames_total, **fields)


def test_marker_lost_in_the_tip():
    tip = simulate(1.05)
    track = track_of(tip, np.random.default_rng(1))
    kept = np.ones(len(track.time_ns), dtype=bool)
    kept[45:60] = False
    motion = analyse(tip, [seen_in(track, kept)])
    assert motion.verdict is Verdict.MARKER_LOST
    assert "15 frames" in motion.reason


def test_frames_not_taken_do_not_count_as_a_lost_marker():
    """A third of the frames were never taken, as by a phone in poor light."""
    tip = simulate(1.05)
    track = track_of(tip, np.random.default_rng(1))
    kept = np.arange(len(track.time_ns)) % 3 > 0
    assert analyse(tip, [seen_in(track, kept)]).verdict is Verdict.MARKER_LOST, (
        "where no image is known it must be thought so"
    )
    assert analyse(tip, [seen_in(track, kept)], unmarked=track.time_ns[~kept]).verdict is Verdict.MARKER_LOST
    motion = analyse(tip, [seen_in(track, kept)], unmarked=np.zeros(0, dtype=np.int64))
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.02
    (alternative,) = motion.alternatives
    assert abs(alternative.phi - motion.fit.phi) < 4 * np.sqrt(alternative.covariance[0, 0])


@pytest.mark.parametrize(("left_out", "verdict"), [((45, 55), Verdict.GOOD), ((40, 75), Verdict.UNREADABLE)])
def test_a_stretch_without_images(left_out, verdict):
    tip = simulate(1.05)
    track = track_of(tip, np.random.default_rng(1))
    kept = np.ones(len(track.time_ns), dtype=bool)
    kept[slice(*left_out)] = False
    motion = analyse(tip, [seen_in(track, kept)], unmarked=np.zeros(0, dtype=np.int64))
    assert motion.verdict is verdict, motion.reason
    if verdict is Verdict.GOOD:
        assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.02
    else:
        assert (
            motion.reason == "no images for 300 ms during the tip: the camera left frames out; strike again"
        )


def test_no_marker_at_all():
    motion = analyse_strike([], [marker()], camera(), StrikeTask("s1.1", planned()))
    assert motion.verdict is Verdict.MARKER_LOST
    assert motion.angle is None


def test_two_markers_give_a_smaller_sd_than_one():
    tip = simulate(1.05)
    rng = np.random.default_rng(4)
    marks = [marker(3, 0.0, 0.03), marker(4, 0.0, -0.03)]
    tracks = [track_of(tip, rng, mark=mark) for mark in marks]
    end = end_of_rest_ns(tracks, int(tip.contact * 1e9) + ANCHOR)
    one = tip_angle(tracks[:1], marks, camera(), placement_of(planned()), end)
    both = tip_angle(tracks, marks, camera(), placement_of(planned()), end)
    assert np.median(both.angle.sd) < 0.6 * np.median(one.angle.sd)
    assert np.std(both.angle.theta[:29]) < np.std(one.angle.theta[:29])


def test_a_marker_of_unknown_place_gives_the_angle():
    tip = simulate(1.05)
    bare = type(marker())(3, marker().size, None)
    motion = analyse(tip, markers=[bare])
    assert motion.verdict is Verdict.GOOD
    assert abs(np.degrees(motion.fit.phi - tip.phi)) < 0.05


@pytest.mark.parametrize("yaw", [1.2, -0.4, 2.2])
def test_the_yaw_of_the_placement_is_found(yaw):
    """A parabola through three headings, 1.1 deg apart, gave 2.5 for the last."""
    tip = simulate(1.05)
    track = track_of(tip, np.random.default_rng(4), yaw=np.radians(yaw))
    found = tip_angle([track], [marker()], camera(), placement_of(planned()), int(tip.contact * 1e9) + ANCHOR)
    assert np.degrees(found.yaw) == pytest.approx(yaw, abs=0.15)
