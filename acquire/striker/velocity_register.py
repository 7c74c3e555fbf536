"""What the velocity register shows of the arm's motion, learned anew from every swing: a filter, a lag, and when it is renewed.

The vendor does not publish the filter, and the register is renewed every millisecond at a phase that nobody knows; together they delay what
it shows by 1-5 ms. The run-up and the retraction, in which the speed changes by hundreds of rad/s2, hold position reads against it: the
delay comes out to 0.1 ms, without a model of the servo (the motion there is any smooth one).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.striker.servo import TICK_RAD, VELOCITY_UNIT_RAD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from acquire.striker.servo import Sample

POSITION_SD = 0.4 * TICK_RAD
VELOCITY_SD = 0.5 * VELOCITY_UNIT_RAD_S
FINE_S = 1e-4
"""step in which responses are computed"""
TAU_S = np.array([0.5, 1.0, 1.5, 2.0, 2.25, 2.5, 2.75, 3.0, 3.5, 4.0, 5.0, 6.0]) * 1e-3
LAG_S = np.arange(7) * 5e-4
LAG_PRIOR_S, LAG_PRIOR_SD_S = 7e-4, 5e-4
PERIOD_NS = 1_000_000
PHASES_NS: tuple[int | None, ...] = (None, 0, 200_000, 400_000, 600_000, 800_000)
"""tried for when the register is renewed; None: as it likes, at an age of 0-1 ms"""
PHASE_STEP_S = 2e-4
UNKNOWN_AGE_SD_S = 1e-3 / math.sqrt(12)
RUN_UP_S, BEFORE_RUN_UP_S = 0.06, 0.01
AFTER_TURN_NS = 2_000_000
"""the smooth motion that is fitted begins here, after the blow that the retraction begins with"""
KNOT_S = 0.004
ROUGHNESS = 3.0
"""weight of third differences between knots: only holds what no read holds"""
TAKEN, TAKEN_SD = 0.35, 0.2
"""where in a read the sample is taken, as a share of it: the request (14 bytes) comes before, the answer (27 bytes, and what the adapter
holds it back) after"""
WITHIN_READ = TAKEN + np.array([-0.3, -0.15, 0.0, 0.15, 0.3])
NEGLIGIBLE = 0.01
FEWEST_READS = 16


@dataclass(frozen=True)
class RegisterModel:
    """One hypothesis: first-order filter of time constant `tau`, then a lag; renewed at `phase_ns` (host monotonic, modulo 1 ms)."""

    tau: float
    """s"""
    lag: float
    """s"""
    lag_sd: float
    """s"""
    phase_ns: int | None
    weight: float
    """probability"""


@dataclass(frozen=True)
class Reads:
    """Reads as arrays (n,), times of the samples in s since `origin_ns`."""

    origin_ns: int
    time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    width: NDArray[np.float64]
    """s, from before to after"""

    @classmethod
    def of(cls, samples: Sequence[Sample], origin_ns: int) -> Reads:
        """From samples, in order."""
        return cls(
            origin_ns,
            np.array([(s.host_before_ns - origin_ns + TAKEN * (s.host_after_ns - s.host_before_ns)) * 1e-9 for s in samples]),
            np.array([s.position_rad for s in samples]),
            np.array([s.velocity_rad_s for s in samples]),
            np.array([(s.host_after_ns - s.host_before_ns) * 1e-9 for s in samples]),
        )

    @property
    def position_sd(self) -> NDArray[np.float64]:
        """(n,) rad: of the reading, and of the instant at which it was taken."""
        return np.hypot(POSITION_SD, self.width / math.sqrt(12) * np.abs(self.velocity))

    def age(self, phase_ns: int | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How old the velocity shown is [s] (n,), and its sd: since the last renewal. None: 0 (the lag holds its mean), as uncertain."""
        if phase_ns is None:
            return np.zeros_like(self.time), np.hypot(UNKNOWN_AGE_SD_S, self.width / math.sqrt(12))
        taken = self.time[:, None] + (WITHIN_READ - TAKEN) * (self.width[:, None] + 0.5 * PHASE_STEP_S)
        since = (taken - ((phase_ns - self.origin_ns) % PERIOD_NS) * 1e-9) % (PERIOD_NS * 1e-9)
        # The age is linear in the instant but where a renewal falls into the read.
        renewed = taken - since
        age = self.time - renewed.mean(axis=1)
        return age, renewed.std(axis=1)

    def velocity_sd(self, age_sd: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) rad/s: of the register's unit, and of an uncertain age while the speed changes."""
        if len(self.time) < 2:
            return np.full_like(self.time, VELOCITY_SD)
        slope = np.gradient(self.velocity, self.time)
        return np.hypot(VELOCITY_SD, age_sd * slope)


def filtered(signal: NDArray[np.float64], tau: float) -> NDArray[np.float64]:
    """First-order filter along axis 0, in steps of FINE_S, at rest with the first row before it.

    The sum of 1, 2, 4, ... decaying terms, each from the one before. scipy.signal has it as `lfilter`, but to load that takes longer than
    all else that starts a daemon.
    """
    kept = math.exp(-FINE_S / tau)
    total = signal - signal[:1]
    weight, terms = kept, 1
    while terms < len(signal):
        total[terms:] += weight * total[:-terms]  # the right side is computed before anything is added
        weight, terms = weight * weight, 2 * terms
    return signal[:1] + (1.0 - kept) * total


def cubic_splines(time: NDArray[np.float64], start: float, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cubic B-splines on even knots (de Boor 1978, ch. IX) and their derivatives (n, count); the i-th ends KNOT_S (i + 1) after `start`."""
    u = (time[:, None] - start) / KNOT_S - np.arange(count) + 1.0
    far = np.minimum(np.abs(u), 2.0)
    value = np.where(far < 1, 2 / 3 - far**2 + far**3 / 2, (2 - far) ** 3 / 6)
    slope = np.where(far < 1, 1.5 * far**2 - 2 * far, -((2 - far) ** 2) / 2) * np.sign(u)
    return value, slope / KNOT_S


def learn_register(samples: Sequence[Sample], turned_ns: int) -> tuple[RegisterModel, ...]:
    """Hypotheses that run-up and retraction leave, the likeliest first; all of them where there are too few reads.

    Args:
        samples: of swing and retraction, in order.
        turned_ns: when the retraction was commanded (host monotonic).
    """
    score = np.zeros((len(PHASES_NS), len(TAU_S), len(LAG_S))) + ((LAG_S - LAG_PRIOR_S) / LAG_PRIOR_SD_S) ** 2
    total = 0
    for part in (_run_up(samples, turned_ns), [s for s in samples if s.time_ns > turned_ns + AFTER_TURN_NS]):
        if len(part) >= FEWEST_READS:
            score += _scores(Reads.of(part, part[0].time_ns))
            total += 2 * len(part)
    scale = max(1.0, float(score.min()) / max(total, 1))
    best = np.clip(score.argmin(axis=2), 1, len(LAG_S) - 2)
    left, middle, right = (np.take_along_axis(score, (best + k)[..., None], 2)[..., 0] for k in (-1, 0, 1))
    bend = np.maximum(left + right - 2 * middle, 1e-3)
    shift = np.clip(0.5 * (left - right) / bend, -1.0, 1.0)
    lag = np.maximum(0.0, LAG_S[best] + shift * LAG_S[1])
    log_weight = -0.5 * (middle - 0.25 * (left - right) * shift) / scale - 0.5 * np.log(bend)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    kept = [
        RegisterModel(float(tau), float(lag[i, j]), float(LAG_S[1] * np.sqrt(2 * scale / bend[i, j])), phase, float(weight[i, j]))
        for i, phase in enumerate(PHASES_NS)
        for j, tau in enumerate(TAU_S)
        if weight[i, j] > NEGLIGIBLE
    ]
    return tuple(sorted(kept, key=lambda model: -model.weight))


def _run_up(samples: Sequence[Sample], turned_ns: int) -> list[Sample]:
    highest = max((s.velocity_rad_s for s in samples), default=0.0)
    moving = next((s.time_ns for s in samples if s.velocity_rad_s > 0.1 * highest), turned_ns)
    begin, end = moving - int(BEFORE_RUN_UP_S * 1e9), moving + int(RUN_UP_S * 1e9)
    return [s for s in samples if begin <= s.time_ns < min(end, turned_ns - 20_000_000)]


def _scores(reads: Reads) -> NDArray[np.float64]:
    """(phase, tau, lag): minus twice the log-likelihood of a smooth motion (cubic spline) that both registers show."""
    margin = KNOT_S + LAG_S[-1] + PERIOD_NS * 1e-9
    inner = np.arange(-margin, reads.time[-1] + 2 * KNOT_S, KNOT_S)
    count = len(inner) + 2
    fine = np.arange(-margin, reads.time[-1] + 2 * FINE_S, FINE_S)
    speed = cubic_splines(fine, -margin, count)[1]
    from_position = cubic_splines(reads.time, -margin, count)[0] / reads.position_sd[:, None]
    smooth = ROUGHNESS * np.diff(np.eye(count), 3, axis=0)
    normal = from_position.T @ from_position + smooth.T @ smooth
    y_position = reads.position / reads.position_sd
    result = np.empty((len(PHASES_NS), len(TAU_S), len(LAG_S)))
    ages = [reads.age(phase) for phase in PHASES_NS]
    for j, tau in enumerate(TAU_S):
        shown = filtered(speed, float(tau))
        for i, (age, age_sd) in enumerate(ages):
            sd = reads.velocity_sd(age_sd)
            at = (reads.time - age - LAG_S[:, None] - fine[0]) / FINE_S
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
