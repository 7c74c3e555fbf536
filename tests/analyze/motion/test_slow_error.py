"""Errors of theta that neighbouring frames share, in the stated sd of phi and k."""

import math
from dataclasses import replace

import numpy as np

from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.slow_error import RIM_SD, slow_error_sd, with_slow_error
from analyze.motion.tip_angle import PlanarMotion
from analyze.tracking.camera_model import UNSTATED_STRAIN_SD
from analyze.types import TipAngle
from tests.analyze.motion.sliding import Body, push_for, simulate

NOISE, SLOW = math.radians(0.005), math.radians(0.007)
RATE = 120.0


def rocked_back(body, energy):
    """Tipping angle (n,) of a body that rises for a time and falls back onto its face, with the times."""
    course = simulate(body, [push_for(body, energy)], seconds=0.7, rate=RATE)
    first = int(np.argmax((course.time > 0.01) & (course.theta > math.radians(0.8))))
    risen = slice(first, first + int(np.argmin(course.theta[first:] > math.radians(0.8))))
    return course.time[risen], course.theta[risen]


def seen(time, theta, rng, slow_sd=SLOW):
    """Motion with noise, and with a bias that repeats every 1.5 to 4 deg, as a corner's does with pixels."""
    n = len(time)
    period = np.radians(rng.uniform(1.5, 4.0, 2))
    waves = np.sin(2 * np.pi * theta[:, None] / period + rng.uniform(0, 2 * np.pi, 2)).sum(axis=1)
    angle = TipAngle(
        np.rint(1e9 * time).astype(np.int64),
        theta + SLOW * waves + rng.normal(0, NOISE, n),
        np.full(n, NOISE),
        np.zeros(n),
        np.zeros(n),
        slow_sd=slow_sd,
    )
    return PlanarMotion(angle, np.zeros(n), np.full(n, 1e-5), np.full(n, 1e-3), 0.0, np.zeros((n, 3, 3)))


def scores(with_error):
    """Errors of phi and of k of rocked-back strikes, each over its stated sd (strikes, 2)."""
    rng, found = np.random.default_rng(5), []
    for _ in range(40):
        body = Body(phi=rng.uniform(0.25, 0.7), rho=0.0, friction=0.9)
        time, theta = rocked_back(body, rng.uniform(0.8, 0.97))
        for _ in range(3):
            motion = seen(time, theta, rng)
            fit = pivot_fit(motion.angle, (0, len(time)))
            if with_error:
                fit = with_slow_error(fit, motion, rolls=False, radius=0.0)
            sd = np.sqrt(np.diag(fit.covariance))
            found.append([(fit.phi - body.phi) / sd[0], ((fit.k or 0.0) - body.k) / sd[1]])
    return np.array(found)


def test_rocked_back_strikes_state_the_error_that_frames_share():
    """Without it phi and k were off by 1.4 and 1.3 of their sd, rms."""
    assert np.all(np.sqrt(np.mean(scores(with_error=False) ** 2, axis=0)) > 1.25)
    rms = np.sqrt(np.mean(scores(with_error=True) ** 2, axis=0))
    assert np.all((rms > 0.7) & (rms < 1.2))


def test_strike_that_passes_balance_gains_little_error():
    body = Body(rho=0.0, friction=0.9)
    course = simulate(body, [push_for(body, 1.1)], seconds=0.7, rate=RATE)
    past = np.flatnonzero((course.time > 0.01) & (course.theta < body.phi + math.radians(25)))
    motion = seen(course.time[past], course.theta[past], np.random.default_rng(0))
    fit = pivot_fit(motion.angle, (0, len(past)))
    more = with_slow_error(fit, motion, rolls=False, radius=0.0)
    assert more.covariance[0, 0] - fit.covariance[0, 0] < SLOW**2


def test_error_depends_on_rim_twist_and_estimator():
    time = np.arange(40) / RATE
    motion = seen(time, time, np.random.default_rng(0))
    fit = replace(pivot_fit_like(), window=(0, 40))
    assert slow_error_sd(fit, motion, rolls=False) == SLOW
    balance = replace(fit, estimator="moment_balance")
    assert slow_error_sd(balance, motion, rolls=False) == 0.0
    assert slow_error_sd(balance, motion, rolls=True) == RIM_SD
    twisted = replace(motion, angle=replace(motion.angle, off_axis=np.full(40, math.radians(5))))
    assert slow_error_sd(balance, twisted, rolls=True) > 10 * RIM_SD


def pivot_fit_like():
    body = Body(rho=0.0, friction=0.9)
    time, theta = rocked_back(body, 0.9)
    return pivot_fit(seen(time, theta, np.random.default_rng(0)).angle, (0, len(time)))


def test_stated_strain_of_the_image_is_in_the_error_of_phi():
    """Cameras strain the image by 1e-3, 1 sigma; without it, phi was off by 6.7 of its sd, rms."""
    rng, without, stated, unstated = np.random.default_rng(3), [], [], []
    for number in range(30):
        body = Body(phi=0.35 + 0.01 * number, rho=0.0, friction=0.9)
        course = simulate(body, [push_for(body, 1.1)], seconds=0.7, rate=RATE)
        past = np.flatnonzero((course.time > 0.01) & (course.theta < body.phi + math.radians(25)))
        theta, strain, toward = course.theta[past], rng.normal(0, 1e-3), rng.uniform(0, math.pi)
        turned = 0.5 * strain * (np.sin(2 * (theta + toward)) - math.sin(2 * toward))
        motion = seen(course.time[past], theta + turned, rng, slow_sd=0.5 * SLOW)
        fit = pivot_fit(motion.angle, (0, len(past)))
        for strain_sd, scores in ((0.0, without), (1e-3, stated), (UNSTATED_STRAIN_SD, unstated)):
            known = replace(motion, angle=replace(motion.angle, strain_sd=strain_sd))
            phi_sd = math.sqrt(with_slow_error(fit, known, rolls=False, radius=0.0).covariance[0, 0])
            scores.append((fit.phi - body.phi) / phi_sd)
    assert np.sqrt(np.mean(np.square(without))) > 1.8
    assert 0.7 < np.sqrt(np.mean(np.square(stated))) < 1.3
    assert np.sqrt(np.mean(np.square(unstated))) < 1.3
