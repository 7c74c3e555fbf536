"""Restitution and friction of a real object on a real table, from the impacts of a dropped ellipse.

Data: Fazeli, Donlon, Drumwright and Rodriguez 2017 ("Empirical evaluation of common contact models for planar
impact", ICRA). With v the velocity of the middle, w the angular velocity, a the x of the point of contact
seen from the middle and h the middle's height over it, a rigid body that touches at one point obeys

    m dv = (T, N),    m k^2 dw = a N + h T,    |T| <= mu N

and T = -mu N, against the sliding, where the point slides in one direction all through the impact. Newton's
restitution is the speed u_n = v_y + a w of the point along the normal, after over before.

The file does not state which impacts were measured together. Errors are taken as shared within blocks of
successive impacts (wear of the surfaces, recalibrations), and intervals come from leaving out each block.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.grouped_errors import jackknife_covariance
from analyze.least_squares.intervals import student_sigmas_95

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from analyze.reproduce.planar_impacts_file import PlanarImpacts
    from analyze.types import Array, IntArray

MASS_KG: Final = 0.0364
"""Mass of the ellipse [kg]."""
GYRATION_M: Final = 0.0192
"""Radius of gyration k [m], as stated with the data; 21.5 mm if it were uniform."""
BLOCKS: Final = 40
"""Number of blocks of successive impacts that are left out in turn."""
MIN_IMPACTS: Final = 5 * BLOCKS
"""Least number of impacts."""
MIN_APPROACH_M_S: Final = 0.1
"""Least speed [m/s] of the point of contact towards the table before an impact."""
SLID_SD: Final = 2.0
"""Least speed of sliding, in its standard deviations, before and after an impact that slid throughout."""
MIN_SLID: Final = 20
"""Least number of impacts that slid from which friction has a value."""
PERCENTILES: Final = (5, 25, 50, 75, 95)
"""Percentiles of distributions that are reported."""
_MAD_TO_SD: Final = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""


@dataclass(frozen=True)
class Clustered:
    """A quantity of all impacts, with an interval from leaving out blocks of them."""

    value: float
    """value"""
    sd: float
    """standard deviation"""
    interval: tuple[float, float]
    """95 % interval, by Student's t"""


@dataclass(frozen=True)
class RigidTest:
    """Comparison of the measured impacts with those of a rigid body that touches at one point."""

    mirrored: bool
    """True if x and the rotation in the file are of opposite handedness"""
    explained: float
    """share of the variance of dw that the moment of the measured impulse explains"""
    explained_as_stated: float
    """the same with the signs as the file states them; below 0 if dw is farther off than without a moment"""
    residual_rad_s: float
    """robust sd of dw less that of a rigid body [rad/s]"""
    gyration: tuple[Clustered, Clustered]
    """radius of gyration [m] by regression of the moment on dw, and of dw on the moment: errors of each make
    the first too small and the second too large"""
    pulls: int
    """number of impacts with an impulse away from the body"""
    gains: int
    """number of impacts after which the body has more kinetic energy than before"""

    @property
    def times_off_as_stated(self) -> float:
        """Rms error of dw by the moment with the signs as stated, over that of dw = 0."""
        return float(np.sqrt(1.0 - self.explained_as_stated))


@dataclass(frozen=True)
class SlidingFriction:
    """Ratio |T|/N of the impulses: mu where the point of contact slid, at most mu where it did not."""

    slid: int
    """number of impacts that slid in one direction throughout"""
    value: Clustered | None
    """median of T/N against the sliding in those; None if fewer than `MIN_SLID` slid"""
    percentiles: Array
    """(5,) of T/N against the sliding in those; NaN if none slid"""
    ratio_sd: float
    """median sd of a single impact's T/N, as the residual moments imply"""
    opposing: float
    """share of those whose impulse acts against the sliding; NaN if none slid"""
    held_percentiles: Array
    """(5,) of |T|/N in all other impacts; NaN if all slid"""
    beyond: float
    """share of all impacts with |T|/N above mu by more than two sd; NaN without a value"""


@dataclass(frozen=True)
class PlanarAnswer:
    """Restitution and friction from planar impacts, and whether the impacts are those of a rigid body."""

    impacts: int
    """number of impacts used"""
    left_out: int
    """number of impacts left out, as their point of contact hardly approached the table"""
    approach: tuple[float, float]
    """5 and 95 % quantiles of the speed of approach [m/s]"""
    rigid: RigidTest
    """comparison with a rigid body"""
    restitution: Clustered
    """mean restitution"""
    restitution_scatter: float
    """sd from impact to impact beyond the errors that the spin's residuals imply"""
    restitution_percentiles: Array
    """(5,) percentiles of single impacts' restitution, their errors included"""
    restitution_by_speed: Clustered
    """change of restitution with the speed of approach [s/m]"""
    friction: SlidingFriction
    """friction"""


def analyse_impacts(impacts: PlanarImpacts) -> PlanarAnswer:
    """Estimate restitution and friction from planar impacts, and compare them with a rigid body's.

    Args:
        impacts: measured impacts, in the order in which they were measured.

    Raises:
        EstimationError: there are fewer than `MIN_IMPACTS` (200) impacts.
    """
    approach = -(impacts.before[:, 1] + impacts.arm * impacts.before[:, 2])
    used = np.flatnonzero(approach > MIN_APPROACH_M_S)
    if len(used) < MIN_IMPACTS:
        raise EstimationError(
            f"{len(used)} impacts in which the object approaches the table, {MIN_IMPACTS} are needed:"
            " give the whole file of the data set"
        )
    data = _Impulses.of(impacts, used)
    rigid = _rigid_test(data)
    data = data.turned() if rigid.mirrored else data
    # A moment that is left over stands for errors of dw; half of them are those after the impact.
    spin_sd = rigid.residual_rad_s / np.sqrt(2.0)
    rebound = data.after[:, 1] + data.arm * data.after[:, 2]
    values, speed = rebound / data.approach, data.approach
    # Equal weights: errors are small against the scatter, and none where the contact is below the middle.
    sd = np.abs(data.arm) * spin_sd / speed
    scatter = float(np.sqrt(max(float(np.var(values, ddof=1) - np.mean(sd**2)), 0.0)))
    low, high = np.quantile(speed, [0.05, 0.95]).tolist()
    return PlanarAnswer(
        len(used),
        len(impacts) - len(used),
        (low, high),
        rigid,
        _clustered(len(used), lambda kept: float(np.mean(values[kept]))),
        scatter,
        np.percentile(values, PERCENTILES),
        _clustered(len(used), lambda kept: float(np.polyfit(speed[kept], values[kept], 1)[0])),
        _friction(data, spin_sd),
    )


@dataclass(frozen=True)
class _Impulses:
    """Impacts with their impulses per mass, x and the rotation as in `PlanarImpacts` or mirrored."""

    before: Array
    after: Array
    arm: Array
    height: Array
    approach: Array
    """(n,) speed [m/s] of the point of contact towards the table"""

    @staticmethod
    def of(impacts: PlanarImpacts, used: IntArray) -> _Impulses:
        """Impacts with the given numbers."""
        before, arm = impacts.before[used], impacts.arm[used]
        approach = -(before[:, 1] + arm * before[:, 2])
        return _Impulses(before, impacts.after[used], arm, impacts.height[used], approach)

    def turned(self) -> _Impulses:
        """The same with x mirrored, but for the arms, which follow the rotation."""
        mirror = np.array([-1.0, 1.0, 1.0])
        return _Impulses(self.before * mirror, self.after * mirror, self.arm, self.height, self.approach)

    @property
    def change(self) -> Array:
        """Change (n, 3) of the velocities; the first two are the impulse (T, N) over the mass."""
        return self.after - self.before

    @property
    def moment(self) -> Array:
        """Moment (n,) of the impulse about the middle over the mass [m^2 rad/s]."""
        return self.arm * self.change[:, 1] + self.height * self.change[:, 0]


def _rigid_test(data: _Impulses) -> RigidTest:
    turned = data.turned()
    explained = [_explained(each) for each in (data, turned)]
    mirrored = explained[1] > explained[0]
    best = turned if mirrored else data
    spun, moment = best.change[:, 2], best.moment
    residual = spun - moment / GYRATION_M**2
    weights = np.array([1.0, 1.0, GYRATION_M**2])
    energy = [np.sum(weights * each**2, axis=1) for each in (best.before, best.after)]
    return RigidTest(
        mirrored,
        max(explained),
        explained[0],
        _MAD_TO_SD * float(np.median(np.abs(residual - np.median(residual)))),
        (
            _clustered(len(spun), lambda k: float(np.sqrt(moment[k] @ spun[k] / (spun[k] @ spun[k])))),
            _clustered(len(spun), lambda k: float(np.sqrt(moment[k] @ moment[k] / (moment[k] @ spun[k])))),
        ),
        int(np.sum(best.change[:, 1] <= 0)),
        int(np.sum(energy[1] > energy[0])),
    )


def _explained(data: _Impulses) -> float:
    """Share of the squares of dw that the impulse's moment explains."""
    spun = data.change[:, 2]
    left = spun - data.moment / GYRATION_M**2
    return 1.0 - float(left @ left) / float(spun @ spun)


def _friction(data: _Impulses, spin_sd: float) -> SlidingFriction:
    change = data.change
    ratio = change[:, 0] / np.maximum(change[:, 1], 1e-9)
    slides = [each[:, 0] + data.height * each[:, 2] for each in (data.before, data.after)]
    least = SLID_SD * data.height * spin_sd
    slid = (slides[0] * slides[1] > 0) & (np.abs(slides[0]) > least) & (np.abs(slides[1]) > least)
    against = -np.sign(slides[0]) * ratio
    ratio_sd = GYRATION_M**2 * np.sqrt(2.0) * spin_sd / (data.height * np.maximum(change[:, 1], 1e-9))
    none = np.full(len(PERCENTILES), np.nan)
    value, beyond = None, np.nan
    if int(slid.sum()) >= MIN_SLID:
        value = _clustered(len(ratio), lambda kept: float(np.median(against[kept & slid])))
        beyond = float(np.mean(np.abs(ratio) > value.value + 2.0 * ratio_sd))
    return SlidingFriction(
        int(slid.sum()),
        value,
        np.percentile(against[slid], PERCENTILES) if slid.any() else none,
        float(np.median(ratio_sd)),
        float(np.mean(against[slid] > 0)) if slid.any() else np.nan,
        np.percentile(np.abs(ratio[~slid]), PERCENTILES) if not slid.all() else none,
        beyond,
    )


def _clustered(count: int, quantity: Callable[[NDArray[np.bool_]], float]) -> Clustered:
    """Value of a quantity of `count` impacts, with the interval from leaving out each block.

    Args:
        count: number of impacts.
        quantity: function of a mask (count,) of the impacts to use.
    """
    block = np.arange(count) * BLOCKS // count
    value = quantity(np.ones(count, dtype=bool))
    without = np.array([[quantity(block != each)] for each in range(BLOCKS)])
    sd = float(np.sqrt(jackknife_covariance(without)[0, 0]))
    half = float(student_sigmas_95(np.array([BLOCKS - 1.0]))[0]) * sd
    return Clustered(value, sd, (value - half, value + half))
