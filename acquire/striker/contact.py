"""Time and strength of the arm's impact on the object, estimated from the servo's samples.

The time is that of first contact, which can be compared with the images. A contact lasts a few milliseconds
and the object is light, so that the arm loses 5-30 % of its speed: the reads do not show the beginning
itself, only the course of the loss in the servo's position and velocity registers. It is fitted with contacts
of two force laws (a damped linear spring; a sphere on a plane), whose damping follows from the restitution,
and whose duration is known to half a millisecond. With 1000 reads per second the standard deviation of the
time of first contact is 0.2 ms, mostly due to that duration, the force law and the time of the sample within
a read.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from acquire.striker.velocity_register import (
    READ_FRACTION_SD,
    RESPONSE_STEP_S,
    VELOCITY_SD,
    Reads,
    RegisterModel,
    estimate_register,
    low_pass,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from acquire.striker.sample import Sample

CONTACT_POSITION_SD_M = 0.001
"""standard deviation of the tip's position at contact against angle 0 [m] (the stand is set by hand)"""
CONTACT_DURATION_S, CONTACT_DURATION_SD_S = 0.003, 0.0005
"""duration of the contact of a hard tip with a package, and its standard deviation [s]"""
DURATION_GRID = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
"""contact durations tried, in standard deviations from the mean"""
FORCE_EXPONENTS = (1.0, 1.5)
"""force laws tried, as the exponent of the depth: a linear spring (1); a sphere on a plane (1.5)"""
FORCE_LAW_SD_S = 1e-4
"""standard deviation of the contact time due to other force laws [s]"""
SIMULATION_STEP, MAX_SIMULATION_STEPS = 0.02, 1000
"""integration of the contact force: time step, in the dimensionless time of `_contact_force`, and largest
number of steps"""
FIT_BEFORE_S = 0.04
"""length of the fitted constant speed before the contact [s]"""
SEARCH_BEFORE_S = 0.02
"""start of the search for a contact [s], before the last sample of the swing"""
RECOVERY_PER_S, RECOVERY_SD_PER_S = 150.0, 40.0
"""rate at which the servo recovers a loss of speed (acceleration over loss), and its sd [1/s]; an XM430 with
0.0025 kg m2 has 149 by its data sheet"""
TYPICAL_DROP, DROP_SD = 0.2, 0.5
"""mean and standard deviation of the prior of the loss, as fractions of the speed: wide, because an arm that
bounces back from a wall loses 1.5; with the prior, even few reads give no absurd loss"""
CONTACT_TIME_STEP_S = 1e-4
"""spacing of the contact times tried [s]"""
MIN_NOISE = 0.4
"""lower limit of the residuals' variance relative to the expected one (the registers' rounding, doubled for a
servo that differs); smaller values occur by chance"""
SIGNIFICANT_CHI2 = 9.0
"""smallest reduction of chi-square, against a constant speed, at which a loss of speed is significant"""
MIN_READS = 8
"""fewest reads near the contact for a fit; with fewer, the time at angle 0 is interpolated"""


@dataclass(frozen=True)
class ImpactMeasurement:
    """Impact of the arm: time of first contact [ns], angular velocity before it and its loss [rad/s].

    The time is host monotonic; each value has a standard deviation. The loss is None if not significant.
    """

    time_ns: int
    """host monotonic time of first contact [ns]"""
    time_sd_ns: float
    """standard deviation of the time [ns]"""
    velocity: float
    """angular velocity of the arm just before first contact [rad/s]"""
    velocity_sd: float
    """standard deviation of the velocity [rad/s]"""
    drop: float | None
    """loss of angular velocity at contact [rad/s]; None if it is not significant"""
    drop_sd: float
    """standard deviation of the loss [rad/s]; 0 if the loss is None"""


def fit_contact(
    samples: Sequence[Sample], turned_ns: int, arm_length: float, restitution: float
) -> ImpactMeasurement | None:
    """Estimate the arm's impact on the object (time, velocity, loss of velocity) by a fit to the samples.

    The fit models the arm's constant speed, the contact, and the servo's recovery of speed. The arm angle x
    [rad] follows x'(t) = b - d lost(t - tc) - d_r lost_r(t - tc): tc is the time of first contact, b the
    angular velocity before it, d the drop (loss of angular velocity), `lost` the fraction of the drop that is
    lost and not yet recovered by the servo at the rate r [1/s], lost_r its derivative by r, and d_r = d times
    the error of r. The velocity register shows x' after the filter and lag that `estimate_register` found.
    tc, the duration of the contact, the force law and the register model are scanned. The other parameters
    (x(tc), b, d, d_r) are linear and integrated out, d and d_r with priors. The prior of tc is the time at
    angle 0 (the impact point) with the tails of a Cauchy distribution, so that a clear drop elsewhere
    prevails.

    Without a significant drop, or with fewer than 8 reads in the last 50 ms of the swing, the time is that at
    angle 0, and the drop is None.

    Args:
        samples: samples of the swing and of the retraction, in order.
        turned_ns: host monotonic time [ns] at which the retraction was commanded; later samples only serve
            the register model.
        arm_length: length of the arm [m].
        restitution: restitution of the contact, 0-1; determines the shape of its force.

    Returns:
        Host monotonic time of first contact [ns], angular velocity before it and its drop [rad/s], with
        standard deviations. None if there are fewer than two samples up to `turned_ns`. If no significant
        drop is found, None also if the tip ended more than 3 mm before the impact point, or if the arm did
        not move forward.
    """
    swing = [s for s in samples if s.time_ns <= turned_ns]
    if len(swing) < 2:
        return None
    arrived = swing[-1].position_rad > -3 * CONTACT_POSITION_SD_M / arm_length
    origin_ns = swing[-1].time_ns
    near = [s for s in swing if origin_ns - s.time_ns < (FIT_BEFORE_S + 0.01) * 1e9]
    if len(near) < MIN_READS:
        return _zero_crossing(swing, arm_length) if arrived else None
    reads = Reads.from_samples(near, origin_ns)
    models = estimate_register(samples, turned_ns)
    fits = _fit_impacts(reads, models, restitution)
    line = _fit_constant_speed(reads)
    noise = max(MIN_NOISE, float(fits.chi2.min()) / max(1, 2 * len(near) - 4))
    scale = max(1.0, noise)
    log_weight = fits.log_prior - 0.5 * fits.chi2 / scale + 0.5 * np.linalg.slogdet(fits.covariance)[1]
    log_weight = log_weight - np.log1p((fits.solution[:, 0] * arm_length / CONTACT_POSITION_SD_M) ** 2)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ fits.solution
    spread = np.einsum("g,gij->ij", weight, fits.covariance * scale)
    spread = spread + (fits.solution - mean).T @ ((fits.solution - mean) * weight[:, None])
    read_sd = READ_FRACTION_SD * float(np.median(reads.width))
    lag_sd = sum(model.weight * model.lag_sd for model in models)
    best = int(np.argmax(log_weight))
    if (line.chi2 - fits.chi2[best]) / scale > SIGNIFICANT_CHI2 and mean[2] > 0:
        time = float(weight @ fits.time)
        variance = min(1.0, noise) * (weight @ (fits.time - time) ** 2)
        time_sd = float(
            np.sqrt(variance + CONTACT_TIME_STEP_S**2 / 12 + read_sd**2 + FORCE_LAW_SD_S**2 + lag_sd**2)
        )
        velocity_sd, drop_sd = np.sqrt(np.diag(spread)[1:3])
        return ImpactMeasurement(
            time_ns=origin_ns + round(time * 1e9),
            time_sd_ns=time_sd * 1e9,
            velocity=float(mean[1]),
            velocity_sd=float(velocity_sd),
            drop=float(mean[2]),
            drop_sd=float(drop_sd),
        )
    if line.velocity <= 0 or not arrived:
        return None
    time = -line.position / line.velocity
    time_sd = float(np.hypot(CONTACT_POSITION_SD_M / arm_length / line.velocity, read_sd))
    time_ns = origin_ns + round(time * 1e9)
    return ImpactMeasurement(time_ns, time_sd * 1e9, line.velocity, line.velocity_sd, None, 0.0)


def _zero_crossing(samples: Sequence[Sample], arm_length: float) -> ImpactMeasurement | None:
    """Impact estimated as the arm's passage of angle 0 (the impact point), without a loss of speed.

    The time is interpolated between the reads on either side of angle 0; if no read reached angle 0, it is
    at most that of the last read. Used if the host paused during the swing, so that few reads exist.

    Args:
        samples: samples of the swing in order, at least two.
        arm_length: length of the arm [m].

    Returns:
        The impact; None if the median velocity of the (at most 8) reads before angle 0 is not positive.
    """
    after = next((k for k, s in enumerate(samples) if k and s.position_rad >= 0), len(samples) - 1)
    first, last = samples[after - 1], samples[after]
    recent = [s.velocity_rad_s for s in samples[max(0, after - 8) : after]]
    velocity = float(np.median(recent))
    if velocity <= 0:
        return None
    gap_ns = last.time_ns - first.time_ns
    late_ns = min(max(0.0, -first.position_rad / velocity * 1e9), gap_ns)
    sd_ns = float(np.hypot(CONTACT_POSITION_SD_M / arm_length / velocity * 1e9, gap_ns / np.sqrt(12)))
    velocity_sd = float(np.hypot(np.std(recent), VELOCITY_SD))
    return ImpactMeasurement(first.time_ns + round(late_ns), sd_ns, velocity, velocity_sd, None, 0.0)


@dataclass(frozen=True)
class _ConstantSpeedFit:
    """Straight line x = position + velocity * t of arm angle x [rad] over time t [s], fitted to the reads."""

    position: float
    """arm angle at t = 0 [rad]"""
    velocity: float
    """angular velocity of the arm [rad/s]"""
    velocity_sd: float
    """standard deviation of the velocity [rad/s]"""
    chi2: float
    """sum of squared residuals over their variances"""


def _fit_constant_speed(reads: Reads) -> _ConstantSpeedFit:
    """Least-squares fit of a constant angular velocity of the arm to all position and velocity reads.

    Returns:
        Arm angle [rad] at time 0 of the reads, angular velocity [rad/s] with its standard deviation, and
        chi squared (sum of squared residuals over their variances).
    """
    one, zero = np.ones_like(reads.time), np.zeros_like(reads.time)
    x_sd, v_sd = reads.position_sd, np.full_like(one, VELOCITY_SD)
    A = np.concatenate(
        [np.stack([one, reads.time], -1) / x_sd[:, None], np.stack([zero, one], -1) / v_sd[:, None]]
    )
    y = np.concatenate([reads.position / x_sd, reads.velocity / v_sd])
    inverse = np.linalg.inv(A.T @ A)
    position, velocity = inverse @ (A.T @ y)
    residual = y - A @ np.array([position, velocity])
    chi2 = float(residual @ residual)
    velocity_sd = float(np.sqrt(inverse[1, 1] * max(1.0, chi2 / (len(y) - 2))))
    return _ConstantSpeedFit(float(position), float(velocity), velocity_sd, chi2)


@dataclass(frozen=True)
class _ImpactFits:
    """Fits of the arm's motion for g hypotheses on contact time, duration, force law and register model.

    The register model states how the servo's velocity register filters, delays and renews its value. Each
    fit has parameters, their covariance, chi squared (misfit) and prior probability.
    """

    time: NDArray[np.float64]
    """(g,) time of first contact tc [s], from the origin of the reads' times"""
    solution: NDArray[np.float64]
    """(g, 4) arm angle at contact x(tc) [rad], angular velocity before it b [rad/s], its loss d [rad/s], and
    d_r [rad/s2], the loss times the error of the rate at which the servo recovers it"""
    covariance: NDArray[np.float64]
    """(g, 4, 4) covariance of the solution"""
    chi2: NDArray[np.float64]
    """(g,) sum of squared residuals, plus twice the sum of the logs of the velocity reads' standard
    deviations (relative to VELOCITY_SD)"""
    log_prior: NDArray[np.float64]
    """(g,) logarithm of each hypothesis's prior probability"""


def _fit_impacts(reads: Reads, models: Sequence[RegisterModel], restitution: float) -> _ImpactFits:
    """Least-squares fits of all hypotheses on contact time, duration, force law and register model.

    The contact times tried end at the last read, because a later contact does not show. They begin 20 ms
    before time 0 of the reads, but not in the first third of the time from the first read to time 0, so that
    the speed before the contact is known.

    Args:
        reads: reads of the swing near the contact; time 0 is near the last of them.
        models: hypotheses about the velocity register (filter, lag, phase of renewal).
        restitution: restitution of the contact, 0-1.

    Returns:
        One fit per hypothesis: contact time, parameters, covariance, chi squared and prior probability.
    """
    tc = np.arange(max(-SEARCH_BEFORE_S, 0.67 * reads.time[0]), reads.time[-1], CONTACT_TIME_STEP_S)
    u = reads.time[None, :] - tc[:, None]
    one, zero = np.ones_like(u), np.zeros_like(u)
    x_sd = reads.position_sd
    speed = max(float(np.median(reads.velocity)), VELOCITY_SD)
    # Priors of d and d_r.
    known = (
        np.diag([1.0 / (DROP_SD * speed), 1.0 / (RECOVERY_SD_PER_S * TYPICAL_DROP * speed)]) @ np.eye(4)[2:]
    )
    known = np.broadcast_to(known, (len(u), 2, 4))
    parts: list[_ImpactFits] = []
    for z, exponent in itertools.product(DURATION_GRID, FORCE_EXPONENTS):
        duration = CONTACT_DURATION_S + float(z) * CONTACT_DURATION_SD_S
        courses = _loss_courses(_contact_force(restitution, exponent), duration, -float(reads.time[0]))
        angle = [_interpolate_course(np.cumsum(course) * RESPONSE_STEP_S, u) for course in courses]
        from_position = np.stack([one, u, -angle[0], -angle[1]], -1) / x_sd[None, :, None]
        for model in models:
            age, age_sd = reads.age(model.phase_ns)
            v_sd = reads.velocity_sd(age_sd)
            seen = u - age - model.lag
            shown = [_interpolate_course(low_pass(course, model.tau), seen) for course in courses]
            from_velocity = np.stack([zero, one, -shown[0], -shown[1]], -1) / v_sd[None, :, None]
            A = np.concatenate([from_position, from_velocity, known], axis=1)
            y = np.concatenate([reads.position / x_sd, reads.velocity / v_sd, [TYPICAL_DROP / DROP_SD, 0.0]])
            covariance: NDArray[np.float64] = np.linalg.inv(np.swapaxes(A, 1, 2) @ A).astype(np.float64)
            solution = np.einsum("gij,gj->gi", covariance, np.einsum("gni,n->gi", A, y))
            residual = y[None, :] - np.einsum("gni,gi->gn", A, solution)
            chi2 = np.einsum("gn,gn->g", residual, residual) + 2 * float(np.log(v_sd / VELOCITY_SD).sum())
            prior = float(np.log(model.weight)) - 0.5 * float(z) ** 2
            parts.append(_ImpactFits(tc, solution, covariance, chi2, np.full_like(tc, prior)))
    names = _ImpactFits.__dataclass_fields__
    return _ImpactFits(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _interpolate_course(course: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at times `u` [s] of any shape, interpolated in a course (n,) of samples over time.

    The samples begin at time 0 and are RESPONSE_STEP_S apart. Before time 0 the value is 0, after the
    course's end that of the last sample.
    """
    return np.interp(u.ravel(), np.arange(len(course)) * RESPONSE_STEP_S, course, left=0.0).reshape(u.shape)


def _loss_courses(
    force_course: tuple[NDArray[np.float64], NDArray[np.float64]], duration: float, length: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fraction of the total loss of speed that is lost and not yet recovered by the servo, over time.

    Args:
        force_course: time over contact duration (m,), and contact force (m,) in arbitrary units.
        duration: duration of the contact [s].
        length: length of the courses [s], from first contact.

    Returns:
        The fraction (n,), and its derivative (n,) [s] by the rate [1/s] of recovery; both from first contact
        in steps of RESPONSE_STEP_S.
    """
    force = np.interp(
        np.arange(0.0, length + RESPONSE_STEP_S, RESPONSE_STEP_S) / duration, *force_course, right=0.0
    )
    taken = (np.cumsum(force) - 0.5 * force) / force.sum()
    slower, lost, faster = (
        taken - low_pass(taken, 1.0 / rate)
        for rate in (RECOVERY_PER_S - RECOVERY_SD_PER_S, RECOVERY_PER_S, RECOVERY_PER_S + RECOVERY_SD_PER_S)
    )
    return lost, (faster - slower) / (2 * RECOVERY_SD_PER_S)


@cache
def _contact_force(restitution: float, exponent: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Course of a contact's force: time (n,) over the contact's duration, force (n,) in arbitrary units.

    With x the dimensionless depth: x'' = -x^k (1 + c x') for a sphere on a plane, k = 1.5 (Hunt and Crossley
    1975); x'' = -x - c x' for a linear spring and damper, k = 1 (Kelvin and Voigt; Nagurka and Huang 2004);
    from x = 0, x' = 1. The damping c is found by bisection so that x' at the end is minus the restitution.
    The force never pulls.

    Args:
        restitution: speed after the contact over speed before it, 0-1.
        exponent: exponent k of the depth in the force, 1 or 1.5.
    """
    low, high = 0.0, 20.0
    for _ in range(24):
        damping = 0.5 * (low + high)
        rebound = -_simulate_contact(damping, exponent)[2]
        low, high = (damping, high) if rebound > restitution else (low, damping)
    return _simulate_contact(0.5 * (low + high), exponent)[:2]


def _simulate_contact(
    damping: float, exponent: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Share of the duration passed (n,), force (n,) and final velocity of a contact from unit speed.

    Semi-implicit Euler integration in dimensionless units, from depth x = 0 and speed v = 1. The velocity is
    positive into the object, so the final one is negative.

    Args:
        damping: damping coefficient c of the force x^k (1 + c v), or x + c v if k = 1.
        exponent: exponent k of the depth in the force; 1 is the linear spring and damper.
    """
    x, v = 0.0, 1.0
    force = [0.0]
    while len(force) < MAX_SIMULATION_STEPS:
        now = x + damping * v if exponent == 1.0 else x**exponent * (1.0 + damping * v)
        if x > 0.0 and now <= 0.0:
            break
        force.append(max(0.0, now))
        v -= now * SIMULATION_STEP
        x = max(0.0, x + v * SIMULATION_STEP)
        if x == 0.0:
            break
    return np.linspace(0.0, 1.0, len(force)), np.array(force), v
