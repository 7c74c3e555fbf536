"""True seconds from a falling tag: accuracy, honest errors, and what is no fall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.motion.fall_window import fall_windows
from analyze.motion.free_fall import FallSetup, settled_fall
from analyze.motion.true_time import true_time
from analyze.tracking.pose import position_covariance
from tests.analyze.motion.falling import CAMERA, GRAVITY, Drop, moved, track

DROP = Drop(fall=0.5, bounces=False, held_s=0.25)
SETUP = FallSetup(
    size=0.04,
    size_sd=1e-4,
    gravity=GRAVITY,
    gravity_sd=0.02,
    mass=0.1,
    line_time=0.0,
    rows=CAMERA.height,
    time_sd=0.0,
)


def falls_in(seen, setup=SETUP):
    covariance = position_covariance(
        seen.R_camera_marker, seen.p_camera_marker, seen.corner_sd_px, setup.size, CAMERA.K
    )
    sd = np.sqrt(np.median(np.einsum("nii->ni", covariance), axis=0))
    windows = fall_windows(seen.time_ns, seen.p_camera_marker, sd)
    return [fall for window in windows if (fall := settled_fall(seen, covariance, window, setup)) is not None]


def falls_of(drop, setup=SETUP, missing=()):
    return falls_in(track(drop, missing), setup)


def off(drop, setup=SETUP, missing=()):
    """Relative error of q (true over stated time), and this error over its sd.

    The sd leaves out the tag's size and g, which are exact here.
    """
    answer = true_time(falls_of(drop, setup, missing), setup)
    true = drop.stated_fps / drop.fps
    return answer.time_ratio / true - 1, (answer.time_ratio - true) / answer.by_noise


@pytest.mark.parametrize(
    "drop",
    [
        DROP,
        replace(DROP, stated_fps=30.0),
        replace(DROP, fps=60.0, stated_fps=60.0),
        replace(DROP, fps=30.0, stated_fps=60.0, fall=0.8),
        replace(DROP, spin=(0.6, 1.0, -0.8), arm=(0.02, 0.01, -0.03)),
        replace(DROP, down=(0.0, 1.0, 0.5)),
        replace(DROP, drag=0.03),
    ],
    ids=[
        "240",
        "240 stated as 30",
        "60",
        "30 stated as 60",
        "turning off centre",
        "partly towards the camera",
        "air",
    ],
)
def test_the_rate_is_found_to_half_a_percent_and_within_its_error(drop):
    relative, standardised = off(drop)
    assert abs(relative) < 5e-3
    assert abs(standardised) < 3


def test_stated_errors_of_q_match_their_scatter():
    rng = np.random.default_rng(3)
    each = [
        off(
            replace(
                DROP,
                fall=rng.uniform(0.3, 0.8),
                spin=tuple(rng.normal(0, 0.5, 3)),
                arm=tuple(rng.normal(0, 0.02, 3)),
                drag=rng.uniform(0, 0.03),
                corner_sd=rng.uniform(0.03, 0.15),
                seed=seed,
            )
        )
        for seed in range(12)
    ]
    relative, standardised = np.array(each).T
    assert np.sqrt(np.mean(relative**2)) < 4e-3
    assert 0.3 < np.sqrt(np.mean(standardised**2)) < 1.6


def test_a_rolling_shutter_is_corrected_where_it_is_stated_and_allowed_for_where_not():
    rolling = replace(DROP, line_time=2e-6)
    for line_time in (2e-6, None):
        relative, standardised = off(rolling, replace(SETUP, line_time=line_time))
        assert abs(relative) < 5e-3
        assert abs(standardised) < 3
    stated = falls_of(DROP, replace(SETUP, line_time=0.0))[0]
    unknown = falls_of(DROP, replace(SETUP, line_time=None))[0]
    assert unknown.shared_sd > stated.shared_sd


def test_a_bounce_is_a_second_fall_and_lost_frames_do_no_harm():
    bouncing = replace(DROP, fall=0.7, bounces=True)
    falls = falls_of(bouncing, missing=(80, 81, 110))
    assert len(falls) == 2
    relative, standardised = off(bouncing, missing=(80, 81, 110))
    assert abs(relative) < 5e-3
    assert abs(standardised) < 3


def test_the_tags_size_enters_by_its_root():
    small, large = (
        falls_of(replace(DROP, seed=1), SETUP),
        falls_of(replace(DROP, seed=1), replace(SETUP, gravity=GRAVITY / 1.02)),
    )
    assert large[0].time_ratio / small[0].time_ratio == pytest.approx(1.02**0.5, rel=1e-3)
    answer = true_time(small, SETUP)
    assert answer.by_size == pytest.approx(answer.time_ratio * 1e-4 / 0.04 / 2)


@pytest.mark.parametrize("motion", ["held", "swung", "lifted", "pushed"])
def test_hand_motion_is_not_a_fall(motion):
    time = np.arange(240) / 240
    u = np.clip((time - 0.2) / 0.6, 0, 1)
    along = {
        "held": 0 * time,
        "swung": 0.2 * np.sin(2 * np.pi * 1.2 * time),
        "lifted": -0.4 * (10 * u**3 - 15 * u**4 + 6 * u**5),
        "pushed": 0.6 * time,
    }[motion]
    p = np.array([0.0, 0.0, 1.3]) + along[:, None] * [0.1, 1.0, 0.0]
    assert falls_in(moved(p, DROP)) == []
