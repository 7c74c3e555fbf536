"""When and how hard the arm met the object, from the servo's samples.

The contact is the first touch: what the images can be compared with. A touch lasts a few milliseconds and the object is light, so that the
arm loses 5-30 % of its speed: in the reads the beginning itself does not show, only the course of the loss as two registers tell it. It is
fitted with touches of two shapes (a damped linear spring; a ball on a flat), whose damping the restitution gives, and of a duration known
to half a millisecond; at 1 kHz the first touch comes out to 0.2 ms, most of it that duration, the shape and where in a read the sample is.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from acquire.striker.velocity_register import FINE_S, TAKEN_SD, VELOCITY_SD, Reads, RegisterModel, filtered, learn_register

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from acquire.striker.servo import Sample

CONTACT_SD_M = 0.001
"""where the tip touches, against angle 0 (the stand is set by hand)"""
TOUCH_S, TOUCH_SD_S = 0.003, 0.0005
"""how long a touch of a hard tip with a package lasts"""
TOUCH_GRID = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
"""durations tried, in sd"""
FORCE_EXPONENTS = (1.0, 1.5)
"""of depth: a spring; a ball on a flat"""
SHAPE_SD_S = 1e-4
"""what shapes other than these two leave open"""
SPRING_STEP, SPRING_STEPS = 0.02, 1000
BEFORE_S = 0.04
"""of even speed before the touch that is fitted"""
GRID_BEFORE_S = 0.02
"""from here on a touch is looked for"""
RECOVERY_PER_S, RECOVERY_SD_PER_S = 150.0, 40.0
"""how fast the servo makes up for a loss of speed: acceleration = this times the loss (XM430 with 0.0025 kg m2: 149 by its data sheet)"""
TYPICAL_DROP, DROP_SD = 0.2, 0.5
"""of the speed: an arm that stops and bounces back from a wall loses 1.5, so that even few reads give no absurd loss"""
GRID_S = 1e-4
LEAST_NOISE = 0.4
"""of what the fit allows for (registers' rounding, and as much again for a servo that differs), as variance: less is chance"""
SIGNIFICANT = 9.0
"""chi-square by which a touch must beat an even speed"""
FEWEST_READS = 8


@dataclass(frozen=True)
class Contact:
    """One contact as the arm felt it."""

    time_ns: int
    """host monotonic, first touch"""
    time_sd_ns: float
    velocity: float
    """rad/s, arm, just before"""
    velocity_sd: float
    drop: float | None
    """rad/s that the touch took from the arm; None where no drop stands out"""
    drop_sd: float


def fit_contact(samples: Sequence[Sample], turned_ns: int, arm_length: float, restitution: float) -> Contact | None:
    """Fit an even speed, a touch and the servo's recovery from it to position and velocity.

    x'(t) = b - d lost(u) - d_r d lost / d r, u = t - tc: `lost` is the share of the drop d that is taken and not yet recovered at the
    rate r, d_r = d times r's error; the velocity register shows x' through what `learn_register` found. tc, the touch's duration and the
    register's model are scanned, the rest (x(tc), b, d, d_r) is linear, d and d_r with what is known of them before any read, and
    integrated out; tc's prior is where the tip should touch, with the tails of a Cauchy distribution, so that a clear drop elsewhere wins.

    Args:
        samples: of the swing and of the retraction, in order.
        turned_ns: when the retraction was commanded (host monotonic): later samples only tell of the register.
        arm_length: m.
        restitution: of the touch, 0-1: shapes its force.

    Returns:
        None when the arm neither came to angle 0 nor lost speed before it.
    """
    swing = [s for s in samples if s.time_ns <= turned_ns]
    if len(swing) < 2:
        return None
    arrived = swing[-1].position_rad > -3 * CONTACT_SD_M / arm_length
    origin_ns = swing[-1].time_ns
    near = [s for s in swing if origin_ns - s.time_ns < (BEFORE_S + 0.01) * 1e9]
    if len(near) < FEWEST_READS:
        return _crossing(swing, arm_length) if arrived else None
    reads = Reads.of(near, origin_ns)
    models = learn_register(samples, turned_ns)
    fits = _touches(reads, models, restitution)
    line = _even(reads)
    noise = max(LEAST_NOISE, float(fits.chi2.min()) / max(1, 2 * len(near) - 4))
    scale = max(1.0, noise)
    log_weight = fits.log_prior - 0.5 * fits.chi2 / scale + 0.5 * np.linalg.slogdet(fits.covariance)[1]
    log_weight = log_weight - np.log1p((fits.solution[:, 0] * arm_length / CONTACT_SD_M) ** 2)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ fits.solution
    spread = np.einsum("g,gij->ij", weight, fits.covariance * scale) + (fits.solution - mean).T @ ((fits.solution - mean) * weight[:, None])
    read_sd = TAKEN_SD * float(np.median(reads.width))
    lag_sd = sum(model.weight * model.lag_sd for model in models)
    best = int(np.argmax(log_weight))
    if (line.chi2 - fits.chi2[best]) / scale > SIGNIFICANT and mean[2] > 0:
        when = float(weight @ fits.time)
        when_sd = float(
            np.sqrt(min(1.0, noise) * (weight @ (fits.time - when) ** 2) + GRID_S**2 / 12 + read_sd**2 + SHAPE_SD_S**2 + lag_sd**2)
        )
        velocity_sd, drop_sd = np.sqrt(np.diag(spread)[1:3])
        return Contact(origin_ns + round(when * 1e9), when_sd * 1e9, float(mean[1]), float(velocity_sd), float(mean[2]), float(drop_sd))
    if line.velocity <= 0 or not arrived:
        return None
    when = -line.position / line.velocity
    when_sd = float(np.hypot(CONTACT_SD_M / arm_length / line.velocity, read_sd))
    return Contact(origin_ns + round(when * 1e9), when_sd * 1e9, line.velocity, line.velocity_sd, None, 0.0)


def _crossing(samples: Sequence[Sample], arm_length: float) -> Contact | None:
    """From the reads on either side of angle 0: all that is left when the host stood still in a swing."""
    after = next((k for k, s in enumerate(samples) if k and s.position_rad >= 0), len(samples) - 1)
    first, last = samples[after - 1], samples[after]
    recent = [s.velocity_rad_s for s in samples[max(0, after - 8) : after]]
    velocity = float(np.median(recent))
    if velocity <= 0:
        return None
    gap_ns = last.time_ns - first.time_ns
    late_ns = min(max(0.0, -first.position_rad / velocity * 1e9), gap_ns)
    sd_ns = float(np.hypot(CONTACT_SD_M / arm_length / velocity * 1e9, gap_ns / np.sqrt(12)))
    return Contact(first.time_ns + round(late_ns), sd_ns, velocity, float(np.hypot(np.std(recent), VELOCITY_SD)), None, 0.0)


@dataclass(frozen=True)
class _Line:
    position: float
    velocity: float
    velocity_sd: float
    chi2: float


def _even(reads: Reads) -> _Line:
    """Constant speed through all of it: position at t = 0, velocity, and how badly it fits."""
    one, zero = np.ones_like(reads.time), np.zeros_like(reads.time)
    x_sd, v_sd = reads.position_sd, np.full_like(one, VELOCITY_SD)
    A = np.concatenate([np.stack([one, reads.time], -1) / x_sd[:, None], np.stack([zero, one], -1) / v_sd[:, None]])
    y = np.concatenate([reads.position / x_sd, reads.velocity / v_sd])
    inverse = np.linalg.inv(A.T @ A)
    position, velocity = inverse @ (A.T @ y)
    residual = y - A @ np.array([position, velocity])
    chi2 = float(residual @ residual)
    return _Line(float(position), float(velocity), float(np.sqrt(inverse[1, 1] * max(1.0, chi2 / (len(y) - 2)))), chi2)


@dataclass(frozen=True)
class _Touches:
    """Fits, one per time, duration and register model (g,): (x at tc, b, d, d_r) and what speaks for each."""

    time: NDArray[np.float64]
    """s, of first touch"""
    solution: NDArray[np.float64]
    """(g, 4)"""
    covariance: NDArray[np.float64]
    """(g, 4, 4)"""
    chi2: NDArray[np.float64]
    log_prior: NDArray[np.float64]


def _touches(reads: Reads, models: Sequence[RegisterModel], restitution: float) -> _Touches:
    """Every hypothesis fitted. A touch after the last read cannot be told from none; one too early leaves no speed to compare with."""
    tc = np.arange(max(-GRID_BEFORE_S, 0.67 * reads.time[0]), reads.time[-1], GRID_S)
    u = reads.time[None, :] - tc[:, None]
    one, zero = np.ones_like(u), np.zeros_like(u)
    x_sd = reads.position_sd
    speed = max(float(np.median(reads.velocity)), VELOCITY_SD)
    # What is known of d and d_r before any read.
    known = np.diag([1.0 / (DROP_SD * speed), 1.0 / (RECOVERY_SD_PER_S * TYPICAL_DROP * speed)]) @ np.eye(4)[2:]
    known = np.broadcast_to(known, (len(u), 2, 4))
    parts: list[_Touches] = []
    for z, exponent in itertools.product(TOUCH_GRID, FORCE_EXPONENTS):
        courses = _courses(_force(restitution, exponent), TOUCH_S + float(z) * TOUCH_SD_S, -float(reads.time[0]))
        way = [_at(np.cumsum(course) * FINE_S, u) for course in courses]
        from_position = np.stack([one, u, -way[0], -way[1]], -1) / x_sd[None, :, None]
        for model in models:
            age, age_sd = reads.age(model.phase_ns)
            v_sd = reads.velocity_sd(age_sd)
            seen = u - age - model.lag
            shown = [_at(filtered(course, model.tau), seen) for course in courses]
            from_velocity = np.stack([zero, one, -shown[0], -shown[1]], -1) / v_sd[None, :, None]
            A = np.concatenate([from_position, from_velocity, known], axis=1)
            y = np.concatenate([reads.position / x_sd, reads.velocity / v_sd, [TYPICAL_DROP / DROP_SD, 0.0]])
            covariance: NDArray[np.float64] = np.linalg.inv(np.swapaxes(A, 1, 2) @ A).astype(np.float64)
            solution = np.einsum("gij,gj->gi", covariance, np.einsum("gni,n->gi", A, y))
            residual = y[None, :] - np.einsum("gni,gi->gn", A, solution)
            chi2 = np.einsum("gn,gn->g", residual, residual) + 2 * float(np.log(v_sd / VELOCITY_SD).sum())
            prior = float(np.log(model.weight)) - 0.5 * float(z) ** 2
            parts.append(_Touches(tc, solution, covariance, chi2, np.full_like(tc, prior)))
    return _Touches(*(np.concatenate([getattr(part, name) for part in parts]) for name in _Touches.__dataclass_fields__))


def _at(course: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """A course that starts at u = 0 in steps of FINE_S, at times u of any shape; 0 before it."""
    return np.interp(u.ravel(), np.arange(len(course)) * FINE_S, course, left=0.0).reshape(u.shape)


def _courses(
    force_course: tuple[NDArray[np.float64], NDArray[np.float64]], duration: float, length: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From first touch in steps of FINE_S for `length` [s]: share of the drop that is lost, and its derivative by the rate of recovery."""
    force = np.interp(np.arange(0.0, length + FINE_S, FINE_S) / duration, *force_course, right=0.0)
    taken = (np.cumsum(force) - 0.5 * force) / force.sum()
    slower, lost, faster = (
        taken - filtered(taken, 1.0 / rate)
        for rate in (RECOVERY_PER_S - RECOVERY_SD_PER_S, RECOVERY_PER_S, RECOVERY_PER_S + RECOVERY_SD_PER_S)
    )
    return lost, (faster - slower) / (2 * RECOVERY_SD_PER_S)


@cache
def _force(restitution: float, exponent: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Force of a touch over its duration (0-1), zero where it would pull.

    x'' = -x^n (1 + c x') for a ball on a flat, n = 1.5 (Hunt and Crossley 1975); x'' = -x - c x' for a linear spring and damper, n = 1
    (Kelvin and Voigt; Nagurka and Huang 2004); from x = 0, x' = 1. The damping c is halved in until x' at the end is minus the restitution.
    """
    low, high = 0.0, 20.0
    for _ in range(24):
        damping = 0.5 * (low + high)
        low, high = (damping, high) if -_spring(damping, exponent)[2] > restitution else (low, damping)
    return _spring(0.5 * (low + high), exponent)[:2]


def _spring(damping: float, exponent: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Time over duration, force, and the speed at the end (semi-implicit, in steps of SPRING_STEP)."""
    x, v = 0.0, 1.0
    force = [0.0]
    while len(force) < SPRING_STEPS:
        now = x + damping * v if exponent == 1.0 else x**exponent * (1.0 + damping * v)
        if x > 0.0 and now <= 0.0:
            break
        force.append(max(0.0, now))
        v -= now * SPRING_STEP
        x = max(0.0, x + v * SPRING_STEP)
        if x == 0.0:
            break
    return np.linspace(0.0, 1.0, len(force)), np.array(force), v
