"""Model of the servo's velocity register, estimated from every swing: filter, lag, renewal phase.

The vendor does not publish the filter, and the register is renewed every millisecond at an unknown phase;
together they delay its value by 1-5 ms. In the run-up and the retraction the speed changes by hundreds of
rad/s2; comparing position and velocity reads there gives the delay to 0.1 ms, without a model of the servo
(any smooth motion is allowed).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.striker.sample import TICK_RAD, VELOCITY_UNIT_RAD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from acquire.striker.sample import Sample

POSITION_SD = 0.4 * TICK_RAD
"""standard deviation of one position reading [rad]"""
VELOCITY_SD = 0.5 * VELOCITY_UNIT_RAD_S
"""standard deviation of one velocity reading [rad/s]"""
RESPONSE_STEP_S = 1e-4
"""time step of computed responses [s]"""
TAU_GRID_S = np.array([0.5, 1.0, 1.5, 2.0, 2.25, 2.5, 2.75, 3.0, 3.5, 4.0, 5.0, 6.0]) * 1e-3
"""time constants of the filter that are tried [s]"""
LAG_GRID_S = np.arange(7) * 5e-4
"""lags after the filter that are tried [s]"""
LAG_PRIOR_S, LAG_PRIOR_SD_S = 7e-4, 5e-4
"""prior of the lag: mean and standard deviation [s]"""
PERIOD_NS = 1_000_000
"""renewal period of the register [ns]"""
PHASES_NS: tuple[int | None, ...] = (None, 0, 200_000, 400_000, 600_000, 800_000)
"""phases of the register's renewal that are tried [ns]; None for an irregular renewal, at an age of 0-1 ms"""
PHASE_STEP_S = 2e-4
"""spacing of the phases that are tried [s]"""
UNKNOWN_AGE_SD_S = 1e-3 / math.sqrt(12)
"""standard deviation of an age distributed uniformly over 0-1 ms [s]"""
RUN_UP_S, BEFORE_RUN_UP_S = 0.06, 0.01
"""fitted part of the run-up: length after the arm has begun to move, and before that [s]"""
RETRACTION_DELAY_NS = 2_000_000
"""start of the fitted smooth motion after the jerk with which the retraction begins [ns]"""
KNOT_SPACING_S = 0.004
"""distance between the knots of the cubic spline that describes the motion [s]"""
ROUGHNESS = 3.0
"""weight of the third differences of the spline's coefficients; it only bounds coefficients that no read
determines"""
READ_FRACTION, READ_FRACTION_SD = 0.35, 0.2
"""time of the sample as a fraction of the read's duration, and its standard deviation: the request (14 bytes)
is sent before the sample, the answer (27 bytes, and the adapter's delay) after it"""
READ_FRACTIONS = READ_FRACTION + np.array([-0.3, -0.15, 0.0, 0.15, 0.3])
"""times of the sample, as fractions of the read's duration, over which the age of the register's value is
averaged"""
MIN_WEIGHT = 0.01
"""smallest probability of a hypothesis that is kept"""
MIN_READS = 16
"""fewest reads in run-up or retraction with which that part is fitted"""


@dataclass(frozen=True)
class RegisterModel:
    """Hypothesis about the servo's velocity register, with its probability: filter, lag, renewal phase.

    The velocity passes a first-order filter, then a lag; the register shows it as it was at the last renewal,
    once a millisecond at a fixed phase.
    """

    tau: float
    """time constant of the filter [s]"""
    lag: float
    """lag after the filter [s]"""
    lag_sd: float
    """standard deviation of the lag [s]"""
    phase_ns: int | None
    """time of the renewals (host monotonic, modulo 1 ms) [ns]; None if they are irregular"""
    weight: float
    """probability of this hypothesis"""


@dataclass(frozen=True)
class Reads:
    """Samples of the servo as arrays (n,): time [s], arm angle [rad], velocity [rad/s], read duration [s].

    Methods give the standard deviations of angle and velocity, and the age of the velocity register's values.
    """

    origin_ns: int
    """host monotonic time of time 0 [ns]"""
    time: NDArray[np.float64]
    """(n,) time at which the sample was taken [s], from `origin_ns`"""
    position: NDArray[np.float64]
    """(n,) arm angle [rad]"""
    velocity: NDArray[np.float64]
    """(n,) angular velocity that the velocity register shows [rad/s]"""
    width: NDArray[np.float64]
    """(n,) duration of the read [s]"""

    @classmethod
    def from_samples(cls, samples: Sequence[Sample], origin_ns: int) -> Reads:
        """Reads of the servo as arrays (n,), from n samples in order of time.

        The arrays are time [s], arm angle [rad], its velocity [rad/s] and duration of the read [s]. A
        sample's time is that at which the servo probably took it, 0.35 of the read's duration after the
        read's begin. Time 0 is `origin_ns`, a host monotonic time [ns].
        """
        return cls(
            origin_ns,
            np.array(
                [
                    (s.host_before_ns - origin_ns + READ_FRACTION * (s.host_after_ns - s.host_before_ns))
                    * 1e-9
                    for s in samples
                ]
            ),
            np.array([s.position_rad for s in samples]),
            np.array([s.velocity_rad_s for s in samples]),
            np.array([(s.host_after_ns - s.host_before_ns) * 1e-9 for s in samples]),
        )

    @property
    def position_sd(self) -> NDArray[np.float64]:
        """Standard deviation of each arm angle (n,) [rad], with that due to the unknown sampling time."""
        return np.hypot(POSITION_SD, self.width / math.sqrt(12) * np.abs(self.velocity))

    def age(self, phase_ns: int | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Age of each value in the velocity register when it was read (n,) [s], and the age's sd (n,) [s].

        The age is the time since the register's last renewal. Mean and standard deviation (sd) are taken over
        the possible sampling times within each read.

        Args:
            phase_ns: time of the renewals (host monotonic, modulo 1 ms) [ns]; None if they are irregular. The
                age is then given as 0, because its mean is part of the register's lag, and its standard
                deviation is that of a uniform distribution over 0-1 ms and of the sampling time.
        """
        if phase_ns is None:
            return np.zeros_like(self.time), np.hypot(UNKNOWN_AGE_SD_S, self.width / math.sqrt(12))
        taken = self.time[:, None] + (READ_FRACTIONS - READ_FRACTION) * (
            self.width[:, None] + 0.5 * PHASE_STEP_S
        )
        since = (taken - ((phase_ns - self.origin_ns) % PERIOD_NS) * 1e-9) % (PERIOD_NS * 1e-9)
        # The age is linear in the sampling time unless a renewal falls into the read.
        renewed = taken - since
        age = self.time - renewed.mean(axis=1)
        return age, renewed.std(axis=1)

    def velocity_sd(self, age_sd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviation of each velocity (n,) [rad/s], with that due to the unknown age of its value.

        With fewer than two reads the part due to the age is left out.

        Args:
            age_sd: (n,) standard deviation of the age, the time since the register's last renewal [s].
        """
        if len(self.time) < 2:
            return np.full_like(self.time, VELOCITY_SD)
        slope = np.gradient(self.velocity, self.time)
        return np.hypot(VELOCITY_SD, age_sd * slope)


def low_pass(signal: NDArray[np.float64], tau: float) -> NDArray[np.float64]:
    """Signal (n, ...) after a first-order low-pass filter along axis 0.

    The rows are RESPONSE_STEP_S apart; before the first row the signal counts as constant. The filter's sum
    of decaying terms is computed by doubling: the sum of 1, 2, 4, ... terms, each from the one before.
    scipy.signal has this filter as `lfilter`, but importing that takes longer than everything else at the
    start of a daemon.

    Args:
        signal: (n, ...) values.
        tau: time constant [s].
    """
    kept = math.exp(-RESPONSE_STEP_S / tau)
    total = signal - signal[:1]
    weight, terms = kept, 1
    while terms < len(signal):
        total[terms:] += weight * total[:-terms]  # the right side is computed before anything is added
        weight, terms = weight * weight, 2 * terms
    return signal[:1] + (1.0 - kept) * total


def cubic_splines(
    time: NDArray[np.float64], start: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (n, count) of cubic B-splines at given times, and their derivatives (n, count) [1/s].

    The knots are KNOT_SPACING_S apart. Source: de Boor 1978, ch. IX.

    Args:
        time: (n,) times [s].
        start: knot [s] at which the interval that the splines cover begins; spline i (from 0) extends from
            KNOT_SPACING_S * (i - 3) to KNOT_SPACING_S * (i + 1) after it.
        count: number of splines.
    """
    u = (time[:, None] - start) / KNOT_SPACING_S - np.arange(count) + 1.0
    far = np.minimum(np.abs(u), 2.0)
    value = np.where(far < 1, 2 / 3 - far**2 + far**3 / 2, (2 - far) ** 3 / 6)
    slope = np.where(far < 1, 1.5 * far**2 - 2 * far, -((2 - far) ** 2) / 2) * np.sign(u)
    return value, slope / KNOT_SPACING_S


def estimate_register(samples: Sequence[Sample], turned_ns: int) -> tuple[RegisterModel, ...]:
    """Hypotheses about the servo's velocity register, with their probabilities given one swing's samples.

    A hypothesis has a filter time constant, a phase of the register's renewals, and a lag. Time constant and
    phase are scanned; the lag is fitted to each pair of them, with a prior. Hypotheses with a probability of
    0.01 or less are left out. With fewer than 16 reads both in the run-up and in the retraction, all are
    kept, equally probable.

    Args:
        samples: samples of swing and retraction, in order.
        turned_ns: host monotonic time at which the retraction was commanded [ns].

    Returns:
        The hypotheses, the most probable first.
    """
    score = (
        np.zeros((len(PHASES_NS), len(TAU_GRID_S), len(LAG_GRID_S)))
        + ((LAG_GRID_S - LAG_PRIOR_S) / LAG_PRIOR_SD_S) ** 2
    )
    total = 0
    retraction = [s for s in samples if s.time_ns > turned_ns + RETRACTION_DELAY_NS]
    for part in (_run_up(samples, turned_ns), retraction):
        if len(part) >= MIN_READS:
            score += _scores(Reads.from_samples(part, part[0].time_ns))
            total += 2 * len(part)
    scale = max(1.0, float(score.min()) / max(total, 1))
    best = np.clip(score.argmin(axis=2), 1, len(LAG_GRID_S) - 2)
    left, middle, right = (np.take_along_axis(score, (best + k)[..., None], 2)[..., 0] for k in (-1, 0, 1))
    bend = np.maximum(left + right - 2 * middle, 1e-3)
    shift = np.clip(0.5 * (left - right) / bend, -1.0, 1.0)
    lag = np.maximum(0.0, LAG_GRID_S[best] + shift * LAG_GRID_S[1])
    log_weight = -0.5 * (middle - 0.25 * (left - right) * shift) / scale - 0.5 * np.log(bend)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    kept = [
        RegisterModel(
            tau=float(tau),
            lag=float(lag[i, j]),
            lag_sd=float(LAG_GRID_S[1] * np.sqrt(2 * scale / bend[i, j])),
            phase_ns=phase,
            weight=float(weight[i, j]),
        )
        for i, phase in enumerate(PHASES_NS)
        for j, tau in enumerate(TAU_GRID_S)
        if weight[i, j] > MIN_WEIGHT
    ]
    return tuple(sorted(kept, key=lambda model: -model.weight))


def _run_up(samples: Sequence[Sample], turned_ns: int) -> list[Sample]:
    """Samples of a swing's run-up, in which the arm gains speed.

    It goes from 10 ms before to 60 ms after the arm first exceeds a tenth of its highest velocity, and ends
    20 ms before the retraction at the latest.

    Args:
        samples: samples of swing and retraction, in order.
        turned_ns: host monotonic time at which the retraction was commanded [ns].

    Returns:
        The samples; empty if there are none in that time.
    """
    highest = max((s.velocity_rad_s for s in samples), default=0.0)
    moving = next((s.time_ns for s in samples if s.velocity_rad_s > 0.1 * highest), turned_ns)
    begin, end = moving - int(BEFORE_RUN_UP_S * 1e9), moving + int(RUN_UP_S * 1e9)
    return [s for s in samples if begin <= s.time_ns < min(end, turned_ns - 20_000_000)]


def _scores(reads: Reads) -> NDArray[np.float64]:
    """Minus twice the log-likelihood of the reads, for each hypothesis about the velocity register.

    The servo renews the register once a millisecond with a filtered, delayed velocity. A hypothesis states
    the phase of these renewals within the millisecond, the filter's time constant, and the lag after it. The
    motion is the smooth one (cubic spline) that fits the values of position and velocity registers best.

    Args:
        reads: reads of the run-up or of the retraction, in order; the time of the first must be near 0.

    Returns:
        Array (phases, time constants, lags) in the order of PHASES_NS, TAU_GRID_S and LAG_GRID_S, up to a
        common constant.
    """
    margin = KNOT_SPACING_S + LAG_GRID_S[-1] + PERIOD_NS * 1e-9
    inner = np.arange(-margin, reads.time[-1] + 2 * KNOT_SPACING_S, KNOT_SPACING_S)
    count = len(inner) + 2
    fine = np.arange(-margin, reads.time[-1] + 2 * RESPONSE_STEP_S, RESPONSE_STEP_S)
    speed = cubic_splines(fine, -margin, count)[1]
    from_position = cubic_splines(reads.time, -margin, count)[0] / reads.position_sd[:, None]
    smooth = ROUGHNESS * np.diff(np.eye(count), 3, axis=0)
    normal = from_position.T @ from_position + smooth.T @ smooth
    y_position = reads.position / reads.position_sd
    result = np.empty((len(PHASES_NS), len(TAU_GRID_S), len(LAG_GRID_S)))
    ages = [reads.age(phase) for phase in PHASES_NS]
    for j, tau in enumerate(TAU_GRID_S):
        shown = low_pass(speed, float(tau))
        for i, (age, age_sd) in enumerate(ages):
            sd = reads.velocity_sd(age_sd)
            at = (reads.time - age - LAG_GRID_S[:, None] - fine[0]) / RESPONSE_STEP_S
            k = at.astype(int)
            part = (at - k)[..., None]
            V = (shown[k] * (1 - part) + shown[k + 1] * part) / sd[:, None]
            y = reads.velocity / sd
            N = normal + np.swapaxes(V, 1, 2) @ V
            b = from_position.T @ y_position + np.einsum("lnk,n->lk", V, y)
            solution = np.linalg.solve(N, b[..., None])[..., 0]
            chi2 = y_position @ y_position + y @ y - np.einsum("lk,lk->l", solution, b)
            result[i, j] = chi2 + 2.0 * float(np.log(sd / VELOCITY_SD).sum())
    return result
