"""Phases of a strike by theta(t): where it moves, lands, comes back, and where only gravity acts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from analyze.motion.phases import find_course, free_window, phases_of, speed_jump
from analyze.motion.settings import WindowLimits
from analyze.types import TipAngle


def squat_body(energy, k=141.0, phi=0.68, rate=120.0):
    """Tipping angle theta(t) of the pendulum's equation, for a small body.

    Near its top it loses a third of its speed in a frame.
    """

    def falls(t, y):
        return y[0] if t > 0.02 else 1.0

    falls.terminal = True
    omega = np.sqrt(2 * k * (1 - np.cos(phi)) * energy)
    out = solve_ivp(
        lambda _, y: [y[1], -k * np.sin(phi - y[0])],
        (0, 0.6),
        [0.0, omega],
        rtol=1e-9,
        dense_output=True,
        events=[falls],
        max_step=0.01,
    )
    time = np.arange(80) / rate
    since = time - 30.4 / rate
    theta = np.where((since > 0) & (since < out.t[-1]), out.sol(np.clip(since, 0, out.t[-1]))[0], 0.0)
    return TipAngle((time * 1e9).astype(np.int64) + 1, theta, np.full(80, 2e-5), np.zeros(80), np.zeros(80))


def steady(theta):
    """TipAngle of `theta` (n,) as tracked at 120 fps, with its zero at rest."""
    n = len(theta)
    return TipAngle(np.arange(1, n + 1) * 8_333_333, theta, np.full(n, 5e-4), np.zeros(n), np.zeros(n))


def test_the_landing_angle_ends_the_motion_without_a_loss_of_speed():
    theta = np.radians(np.concatenate([np.zeros(20), np.linspace(0.0, 80.0, 50)]))
    seen = find_course(steady(theta), 0, WindowLimits())
    assert seen.end_frame == len(theta), "the motion does not show it"
    known = find_course(steady(theta), 0, WindowLimits(), math.radians(44.0))
    assert theta[known.end_frame - 1] < math.radians(44.0) <= theta[known.end_frame]
    phases = phases_of(steady(theta), known, math.radians(30.0))
    assert phases.stage_two[1] == phases.landing[0] == known.end_frame


def test_one_wrong_reading_is_no_landing_and_rocking_back_none_either():
    theta = np.radians(
        np.concatenate([np.zeros(20), 30.0 * np.sin(np.linspace(0.0, math.pi, 60)), np.zeros(10)])
    )
    theta[50] = math.radians(60.0)
    with_shape, without = (
        find_course(steady(theta), 0, WindowLimits(), at) for at in (math.radians(44.0), None)
    )
    assert with_shape == without
    assert with_shape.came_back


@pytest.mark.parametrize(
    ("seed", "rate"), [(seed, rate) for seed in range(4) for rate in (120, 240, 960, 2000)]
)
def test_the_course_is_the_same_at_any_frame_rate(seed, rate):
    """Release and landing of a tip are found to 20 ms at 120 to 2000 frames per second.

    At high rates the first free frames are near rest, and the turn from one frame to the next is hardly
    larger than a frame's error.
    """
    theta = np.radians(
        np.interp(np.arange(0.0, 0.9, 1 / rate), [0.2, 0.3, 0.5, 0.62], [0.0, 15.0, 50.0, 90.0])
    )
    time_ns = np.arange(1, len(theta) + 1) * round(1e9 / rate)
    seen = theta + np.random.default_rng(seed).normal(0.0, np.radians(0.06), len(theta))
    angle = TipAngle(
        time_ns, seen, np.full(len(theta), np.radians(0.06)), np.zeros(len(theta)), np.zeros(len(theta))
    )
    course = find_course(angle, 0, WindowLimits())
    assert not course.came_back
    assert 0.2 < course.released_frame / rate < 0.24
    assert course.end_frame / rate == pytest.approx(0.62, abs=0.02)


def test_the_window_ends_25_degrees_past_phi_and_begins_after_the_guard():
    theta = np.radians(np.concatenate([np.zeros(20), np.linspace(1.0, 80.0, 50)]))
    course = find_course(steady(theta), 0, WindowLimits())
    first, last = free_window(steady(theta), course, math.radians(30.0), WindowLimits())
    assert first == course.moved_frame + WindowLimits().guard_frames
    assert theta[last - 1] <= math.radians(55.0) < theta[last]


def test_the_window_ends_where_a_body_that_falls_over_a_rim_turns_aside():
    """A single wrong reading does not end it, nor a turn before balance, which the verdict judges."""
    theta = np.radians(np.concatenate([np.zeros(20), np.linspace(0.0, 80.0, 50)]))
    course = find_course(steady(theta), 0, WindowLimits())
    off_axis = np.radians(5.0) * (np.degrees(theta) > 40.0)
    off_axis[(np.degrees(theta) > 15.0) & (np.degrees(theta) < 25.0)] = np.radians(5.0)
    off_axis[np.searchsorted(theta, np.radians(35.0))] = np.radians(30.0)
    angle = replace(steady(theta), off_axis=off_axis)
    first, last = free_window(angle, course, math.radians(30.0), WindowLimits(), rolls=True)
    assert np.degrees(theta[last]) == pytest.approx(40.0, abs=3.4)
    assert np.degrees(theta[free_window(angle, course, math.radians(30.0), WindowLimits())[1]]) > 55
    assert free_window(angle, replace(course, end_frame=first), 0.5, WindowLimits()) == (first, first)


@pytest.mark.parametrize(("frame", "size"), [(15, 0.3), (25, -0.3)])
def test_a_jump_in_speed_is_found_with_its_size(frame, size):
    seconds, sd = np.arange(40) / 120, np.full(40, 1e-4)
    residual = size * np.maximum(seconds - seconds[frame], 0.0)
    found, estimated, gain = speed_jump(seconds, residual, sd, np.column_stack([np.ones(40), seconds]))
    # The straight line is fitted out of the residual and of the jump alike.
    line = np.column_stack([np.ones(40), seconds])
    left = residual - line @ np.linalg.lstsq(line, residual, rcond=None)[0]
    again, exact, most = speed_jump(seconds, left, sd, line)
    assert (found, again) == (frame, frame)
    assert estimated == pytest.approx(exact) == pytest.approx(size)
    assert gain == pytest.approx(most)


@pytest.mark.parametrize("energy", [0.6, 0.7, 0.8, 0.9])
def test_gravity_turning_a_squat_body_back_is_no_landing(energy):
    angle = squat_body(energy)
    top = int(np.argmax(angle.theta))
    assert np.degrees(angle.theta[top]) > 14
    course = find_course(angle, 0, WindowLimits())
    assert course.came_back
    assert course.end_frame > top + 10
    assert course.top_frame == top
