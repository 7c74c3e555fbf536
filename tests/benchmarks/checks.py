"""False alarms and detected bad strikes of the answer's checks: `make bench-checks` (ten minutes).

Sessions are those of simulated_tips.py. Each good session is judged; then one of its strikes is spoilt by a
crumb under the object: the tip starts from a pose `--crumb` degrees off its face, so that the object balances
that much earlier.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import click
import numpy as np
from rich.console import Console
from rich.progress import track

from analyze.errors import EstimationError
from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.evidence import Evidence
from analyze.result.document import result_document
from schemas.result import WarningCode
from schemas.strike_result import Verdict
from tests.benchmarks.simulated_tips import session

SEEDS = (11, 12, 13)
"""Seeds for each shape."""
COUNTED_WARNINGS = (
    WarningCode.STRIKE_NOT_PREDICTED,
    WarningCode.ESTIMATORS_DISAGREE,
    WarningCode.GRAVITY_DISAGREES,
    WarningCode.MOMENT_IMPOSSIBLE,
)


def judge(evidence: Evidence, crumb: float, found: Counter[str]) -> None:
    """Count the checks' results for a good session, without and with a strike spoilt by `crumb` [rad]."""
    result = result_document(estimate_evidence(evidence))
    used = [strike for strike in result.strikes if strike.used]
    found["good sessions"] += 1
    found["good strikes"] += len(used)
    for code in COUNTED_WARNINGS:
        named = [warning for warning in result.warnings if warning.code is code]
        found[f"{code.value}: sessions"] += bool(named)
        found[f"{code.value}: times"] += len(named)
    predictions = [strike.prediction for strike in used if strike.prediction is not None]
    found["not predicted by phi and k: strikes"] += sum(each.sigmas > 3 for each in predictions)
    found["not predicted by theta(t): strikes"] += sum(each.motion_sigmas > 3 for each in predictions)
    good = [strike.id for strike in used if strike.verdict is Verdict.GOOD]
    if len(good) < len(used) // 2 or not good:
        return
    bad = good[len(good) // 2]
    spoilt = result_document(estimate_evidence(with_crumb(evidence, bad, crumb)))
    missed = [
        strike
        for strike in spoilt.strikes
        if strike.prediction is not None and not strike.prediction.consistent
    ]
    found["spoilt sessions"] += 1
    found["the spoilt strike is named"] += any(strike.id == bad for strike in missed)
    found["another one is named too"] += any(strike.id != bad for strike in missed)


def with_crumb(evidence: Evidence, strike_id: str, crumb: float) -> Evidence:
    """The evidence with one strike that started `crumb` [rad] towards its tip."""
    motions = list(evidence.motions)
    at = next(i for i, motion in enumerate(motions) if motion.strike_id == strike_id)
    motion = motions[at]
    assert motion.angle is not None
    assert motion.fit is not None
    angle = replace(
        motion.angle,
        theta=motion.angle.theta - crumb * (np.arange(len(motion.angle.theta)) >= motion.fit.window[0]),
    )
    fit = replace(motion.fit, phi=motion.fit.phi - crumb, theta0=motion.fit.theta0 - crumb)
    others = tuple(replace(other, phi=other.phi - crumb) for other in motion.alternatives)
    motions[at] = replace(motion, angle=angle, fit=fit, alternatives=others)
    return replace(evidence, motions=tuple(motions))


def drawn(count: int) -> Iterator[Evidence]:
    """Yield the evidence of `count` simulated sessions."""
    shape = made = 0
    while made < count:
        for seed in SEEDS:
            got = session(shape, seed)
            if got is not None and made < count:
                made += 1
                yield got[0]
        shape += 1


@click.command()
@click.option("--sessions", default=100, show_default=True)
@click.option("--crumb", default=1.5, show_default=True, help="Angle of the crumb [deg].")
def main(sessions: int, crumb: float) -> None:
    """Draw sessions, judge them, and print the counts."""
    console, found = Console(width=100, highlight=False), Counter[str]()
    for evidence in track(drawn(sessions), total=sessions, console=console):
        try:
            judge(evidence, np.radians(crumb), found)
        except EstimationError:
            found["too few strikes"] += 1
    for name, count in found.items():
        console.print(f"{count:6d}  {name}")


if __name__ == "__main__":
    main()
