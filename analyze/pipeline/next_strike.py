"""Sequential design: stop when the answer is as certain as asked, else choose the strike that tells most.

The next strike has the greatest expected decrease of the error that is still too large, over the work of
placing the object for it (Chaloner and Verdinelli 1995, Bayesian experimental design). Everything is
linearised at the present answer (strike_forecast.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from analyze.estimation.agreement import estimator_disagreements
from analyze.estimation.checks import SIGMAS
from analyze.estimation.what_ifs import Alternative
from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.solved import SolvedStrikes
from analyze.pipeline.strike_forecast import Precision, StrikeForecast
from analyze.pipeline.what_ifs import estimate_alternatives
from analyze.planning.forecast import REMEDIES
from analyze.types import Array
from schemas.strike_plan import PlannedStrike
from schemas.wording import counted

MIN_CHECKED = 3
"""least number of strikes that the others must predict before a session may stop"""
STANDS, SAME_CARD, OTHER_CARD, OTHER_HEADING = 0.3, 1.0, 1.4, 3.0
"""work of placing: the object still stands as it is, is put down as before, is put down on another face or
edge, or object and striker are turned to another heading; one is a placement as before"""
MANY = 1e6
"""number of strikes over each edge that stands for any number"""
MIN_STRIKES, OUT_OF_REACH = 6, 1.25
"""least number of strikes, and least ratio of half width after any number of strikes to target, from which on
a target counts as out of reach: the first strikes predict it only roughly"""


OPEN_M = 5e-3
"""half width [m] of the centre of mass after any number of strikes from which on a direction of it is open"""


@dataclass(frozen=True)
class Target:
    """Precision at which a session stops; None for a quantity that does not matter."""

    com: float | None = None
    """half width [m] of the 95 % interval of the centre of mass in its least certain direction"""
    inertia: float | None = None
    """relative half width of the 95 % intervals of Ixx, Iyy and Izz about the centre of mass, the largest"""


@dataclass(frozen=True)
class Reached:
    """Half widths of the 95 % intervals that a target limits."""

    com: float
    """that of the centre of mass in its least certain direction [m]"""
    inertia: float
    """the largest relative one of Ixx, Iyy and Izz"""

    def meets(self, target: Target) -> bool:
        """True if no half width is larger than its target."""
        return (target.com is None or self.com <= target.com) and (
            target.inertia is None or self.inertia <= target.inertia
        )


@dataclass(frozen=True)
class Check:
    """Check that must pass before a session may stop."""

    name: str
    """name of the check"""
    passed: bool
    """True if it passed"""
    text: str
    """finding in words"""


@dataclass(frozen=True)
class Choice:
    """Next strike with the reason for it, and the number of strikes that the target is expected to take."""

    strike: PlannedStrike | None
    """the next strike; None if no edge is left"""
    reason: str
    """reason for the choice, in words"""
    needed: int | None
    """expected number of further good strikes until the target is met; None if those left are too few"""
    obstacle: str = ""
    """reason why no number of strikes meets the target, with a remedy; "" if some number may"""


@dataclass(frozen=True)
class Progress:
    """State of the session that the choice depends on."""

    left: int
    """number of strikes that may still be made"""
    used: int = 0
    """number of strikes in the answer so far"""
    last: PlannedStrike | None = None
    """strike made last; None before the first"""
    stands: bool = False
    """True if the object still stands as it was placed for the last strike"""
    excluded: frozenset[str] = frozenset()
    """ids of planned strikes that cannot be made"""
    failures: Mapping[str, int] = field(default_factory=dict[str, int])
    """number of strikes without a usable verdict, by id of the planned strike"""

    def success(self, planned_id: str) -> float:
        """Expected share of usable strikes over an edge: 1 before any failed, 2/3 after one that failed."""
        return 2.0 / (2.0 + self.failures.get(planned_id, 0))


def reached(solved: SolvedStrikes) -> Reached:
    """Half widths of the 95 % intervals of centre of mass and diagonal moments in a solution."""
    inertial = solved.inertial
    diagonal = np.maximum(np.abs(np.diag(inertial.inertia)), 1e-12)
    measured = np.where(np.diag(inertial.measured), np.diag(inertial.inertia_sd), np.inf)
    widest = float(np.linalg.eigvalsh(inertial.com.covariance)[-1])
    if inertial.com.unobserved_direction is not None:
        widest = math.inf
    return Reached(SIGMAS_95 * math.sqrt(widest), float(np.max(SIGMAS_95 * measured / diagonal)))


def stopping_checks(solved: SolvedStrikes) -> list[Check]:
    """Checks of a solution that must pass before a session may stop, those of the estimate itself.

    The alternatives of the robustness table are among them only if all others pass.
    """
    checks, evidence = solved.checks, solved.evidence
    checked = [each for each in checks.left_out if each.checkable]
    off = [each.strike_id for each in checked if not each.agrees]
    disputed = sorted({each.strike_id for each in estimator_disagreements(solved.used)})
    found = [
        Check(
            "predictions",
            len(checked) >= MIN_CHECKED and not off,
            f"{', '.join(off)} not as the others predict"
            if off
            else f"{len(checked)} of {counted(len(checks.left_out), 'strike')} predicted by the others; "
            f"{MIN_CHECKED} are needed",
        ),
        Check(
            "gravity",
            checks.gravity.agrees,
            f"gravity by the strikes {100 * checks.gravity.relative:+.1f} ± "
            f"{100 * SIGMAS_95 * checks.gravity.sd:.1f} % off the stated one",
        ),
        Check(
            "moments",
            not checks.impossible_axes,
            f"impossible about {', '.join(checks.impossible_axes)}" if checks.impossible_axes else "possible",
        ),
        Check(
            "place",
            checks.sigmas_outside_hull <= SIGMAS,
            "centre of mass inside the shape"
            if checks.sigmas_outside_hull <= SIGMAS
            else "centre of mass outside the shape",
        ),
        Check(
            "estimators",
            not disputed,
            f"two estimators disagree on {', '.join(disputed)}" if disputed else "all agree",
        ),
    ]
    if all(each.passed for each in found):
        priors = (solved.systematic, solved.prior, solved.moments)
        others = estimate_alternatives(
            evidence, list(solved.used), solved.planes, priors, solved.solution, solved.struck
        )
        found.append(_robustness(others))
    return found


def _robustness(others: Sequence[Alternative]) -> Check:
    """Check that the centre of mass stays in its interval under every alternative assumption."""
    broken = [each for each in others if not each.com_holds]
    text = "the centre of mass holds under every alternative"
    if broken:
        text = f"with {broken[0].what_if.value} the centre of mass leaves its interval"
    return Check("robustness", not broken, text)


def choose_strike(
    forecast: StrikeForecast, target: Target, progress: Progress, names: dict[str, str]
) -> Choice:
    """Choose the strike that lowers the error above the target most, over the work of placing for it.

    Args:
        forecast: linear model of the strikes made and of further ones.
        target: precision at which the session stops.
        progress: strikes left, the last one, and those that cannot be made.
        names: names of the edges in words, by axis id.
    """
    usable = [i for i, each in enumerate(forecast.strikes) if each.id not in progress.excluded]
    if not usable:
        return Choice(None, "", None, "no edge of the plan is left to strike: make a plan with others")
    counts = np.zeros(len(forecast.strikes))
    first: int | None = None
    last, stands, needed = progress.last, progress.stands, None
    now = forecast.precision(counts)
    for number in range(progress.left):
        gains = {i: _loss(now, target) - _loss(_after(forecast, counts, i), target) for i in usable}
        worth = {
            i: gain
            * progress.success(forecast.strikes[i].id)
            / _work(forecast.strikes[i], last, stands=stands)
            for i, gain in gains.items()
        }
        best = max(usable, key=lambda i: worth[i])
        first = best if first is None else first
        counts[best] += 1
        last, stands = forecast.strikes[best], False
        now = forecast.precision(counts)
        if _reached(now).meets(target):
            needed = number + 1
            break
    if first is None:
        return Choice(None, "", None, "as many strikes were made as are allowed (--max-strikes)")
    strike = forecast.strikes[first]
    before, after = _reached(forecast.precision(np.zeros(len(counts)))), _reached(_after_one(forecast, first))
    reason = _reason(before, after, target, names.get(strike.axis_id, strike.axis_id))
    obstacle = ""
    if needed is None and progress.used >= MIN_STRIKES:
        obstacle = _obstacle(forecast, usable, target)
    return Choice(strike, reason, needed, obstacle)


def _after(forecast: StrikeForecast, counts: Array, index: int) -> Precision:
    """Precision after one strike more over the edge with number `index`."""
    more = counts.copy()
    more[index] += 1
    return forecast.precision(more)


def _after_one(forecast: StrikeForecast, index: int) -> Precision:
    return _after(forecast, np.zeros(len(forecast.strikes)), index)


def _reached(precision: Precision) -> Reached:
    widest = float(np.linalg.eigvalsh(precision.com)[-1])
    return Reached(SIGMAS_95 * math.sqrt(max(widest, 0.0)), SIGMAS_95 * float(np.max(precision.moments)))


def _loss(precision: Precision, target: Target) -> float:
    """Sum of the logarithms of the variances above the target, which count no further below it."""
    loss = 0.0
    if target.com is not None:
        values = np.linalg.eigvalsh(precision.com)
        loss += float(np.sum(np.log(np.maximum(values, 0.0) + (target.com / SIGMAS_95) ** 2)))
    if target.inertia is not None:
        loss += float(np.sum(np.log(precision.moments**2 + (target.inertia / SIGMAS_95) ** 2)))
    return loss


def _work(strike: PlannedStrike, last: PlannedStrike | None, *, stands: bool) -> float:
    """Work of placing the object for a strike after the last one."""
    if last is None or (strike.axis_id, strike.heading_rad) == (last.axis_id, last.heading_rad):
        return STANDS if stands and last is not None else SAME_CARD
    return OTHER_CARD if strike.heading_rad == last.heading_rad else OTHER_HEADING


def _reason(before: Reached, after: Reached, target: Target, edge: str) -> str:
    parts: list[str] = []
    if target.com is not None:
        parts.append(f"centre of mass ± {_mm(before.com)} mm now, ± {_mm(after.com)} mm after it")
    if target.inertia is not None:
        parts.append(f"moments ± {_percent(before.inertia)} % now, ± {_percent(after.inertia)} % after it")
    return f"{edge}: {', '.join(parts)}"


def _obstacle(forecast: StrikeForecast, usable: Sequence[int], target: Target) -> str:
    """Reason why no number of strikes over usable edges meets the target, with a remedy; "" if one may."""
    counts = np.zeros(len(forecast.strikes))
    counts[list(usable)] = MANY
    precision = forecast.precision(counts)
    floor = _reached(precision)
    if target.com is not None and floor.com > max(OPEN_M, OUT_OF_REACH * target.com):
        x, y, z = np.linalg.eigh(precision.com)[1][:, -1]
        return (
            f"the edges that can be struck leave the centre of mass open along ({x:.2f}, {y:.2f}, {z:.2f}): "
            "plan strikes over other edges"
        )
    if target.com is not None and floor.com > OUT_OF_REACH * target.com:
        sources = forecast.sources(counts)
        worst = max(sources, key=lambda name: sources[name])
        return (
            f"any number of strikes over these edges leaves the centre of mass at ± {_mm(floor.com)} mm, "
            f"mostly by the {worst}: {REMEDIES[worst]}"
        )
    if target.inertia is not None and floor.inertia > OUT_OF_REACH * target.inertia:
        return (
            f"any number of strikes over these edges leaves the moments at ± {_percent(floor.inertia)} %: "
            "plan strikes over other edges, or weigh the object more closely"
        )
    return ""


def _mm(value: float) -> str:
    return _short(1e3 * value) if value < 1.0 else "unknown"


def _percent(value: float) -> str:
    return _short(100 * value) if value < 10.0 else "unknown"


def _short(value: float) -> str:
    """Text of a number with two digits, without an exponent."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
