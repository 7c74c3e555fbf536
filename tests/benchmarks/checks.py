"""How often the checks of the answer cry wolf, and whether they name a strike that is bad: `python -m tests.benchmarks.checks` (minutes).

Sessions as in simulated_tips.py. Good ones are judged as they are; then one strike of each is spoilt: a crumb under the object, which
begins to tip from a place `--crumb` degrees off its face, so that it balances that much earlier.
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
from schemas.result import Verdict, WarningCode
from tests.benchmarks.simulated_tips import session

SEEDS = (11, 12, 13)
"""of each shape"""
LOOKED_AT = (WarningCode.STRIKE_NOT_FORETOLD, WarningCode.ESTIMATORS_DISAGREE, WarningCode.GRAVITY_DISAGREES, WarningCode.MOMENT_IMPOSSIBLE)


def judge(evidence: Evidence, crumb: float, found: Counter[str]) -> None:
    """Adds what the checks say of a good session, and of the same with one strike spoilt by `crumb` [rad]."""
    result = estimate_evidence(evidence).result
    used = [strike for strike in result.strikes if strike.used]
    found["good sessions"] += 1
    found["good strikes"] += len(used)
    for code in LOOKED_AT:
        named = [warning for warning in result.warnings if warning.code is code]
        found[f"{code.value}: sessions"] += bool(named)
        found[f"{code.value}: times"] += len(named)
    found["not foretold by phi and k: strikes"] += sum(strike.foretold is not None and strike.foretold.sigmas > 3 for strike in used)
    found["not foretold by theta(t): strikes"] += sum(strike.foretold is not None and strike.foretold.motion_sigmas > 3 for strike in used)
    good = [strike.id for strike in used if strike.verdict is Verdict.GOOD]
    if len(good) < len(used) // 2 or not good:
        return
    bad = good[len(good) // 2]
    spoilt = estimate_evidence(with_crumb(evidence, bad, crumb)).result
    missed = [strike for strike in spoilt.strikes if strike.foretold is not None and not strike.foretold.foretold]
    found["spoilt sessions"] += 1
    found["the spoilt strike is named"] += any(strike.id == bad for strike in missed)
    found["another one is named too"] += any(strike.id != bad for strike in missed)


def with_crumb(evidence: Evidence, strike_id: str, crumb: float) -> Evidence:
    """The same, but that strike began from a place `crumb` [rad] towards its tip."""
    motions = list(evidence.motions)
    at = next(i for i, motion in enumerate(motions) if motion.strike_id == strike_id)
    motion = motions[at]
    assert motion.angle is not None
    assert motion.fit is not None
    angle = replace(motion.angle, theta=motion.angle.theta - crumb * (np.arange(len(motion.angle.theta)) >= motion.fit.window[0]))
    fit = replace(motion.fit, phi=motion.fit.phi - crumb, theta0=motion.fit.theta0 - crumb)
    others = tuple(replace(other, phi=other.phi - crumb) for other in motion.alternatives)
    motions[at] = replace(motion, angle=angle, fit=fit, alternatives=others)
    return replace(evidence, motions=tuple(motions))


def drawn(count: int) -> Iterator[Evidence]:
    """So many sessions."""
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
@click.option("--crumb", default=1.5, show_default=True, help="In degrees.")
def main(sessions: int, crumb: float) -> None:
    """Draw, judge, count."""
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
