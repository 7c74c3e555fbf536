"""One session of `make bench-honesty`, with its whole answer beside the truth."""

from __future__ import annotations

import numpy as np
from rich.console import Console

from tests.benchmarks.honesty.scores import score_session
from tests.benchmarks.honesty.session import Trial, run_session
from tests.benchmarks.honesty.struck import Bank


def print_session(console: Console, cell: str, bank: Bank, images: bool) -> None:
    """Run the session BODY:DISTURBANCE:SEED, with images or not; print strikes, quantities and verdict."""
    body, disturbance, number = cell.split(":")
    seed = int(number)
    trial = run_session(body, disturbance, seed, bank, images)
    if trial is None:
        console.print(f"{disturbance} does not apply to {body}")
        return
    scored = score_session(trial, body, disturbance, seed)
    console.print(f"{scored.cell}: {trial.refusal or 'answered'}")
    _print_strikes(console, trial)
    for score in scored.scores:
        mark = "" if score.holds else f"  OUTSIDE, {score.half_widths_off:.1f} half widths"
        console.print(
            f"  {score.quantity:24} {score.name:8} {score.value:9.3f} ± {score.half:7.3f}  true "
            f"{score.truth:9.3f}  {score.status}{mark}"
        )
    for sentence in scored.verdicts:
        console.print(f"  {sentence}", markup=False)
    for warning in () if trial.result is None else trial.result.warnings:
        console.print(f"  [{warning.code.value}] {warning.text}", markup=False)


def _print_strikes(console: Console, trial: Trial) -> None:
    if trial.evidence is None:
        return
    planned = {strike.id: strike for strike in trial.evidence.plan.strikes}
    for motion in trial.evidence.motions:
        truth, plan = trial.truths[motion.strike_id], planned[motion.plan_strike_id]
        off = np.array(plan.pivot.point) - truth.tip.line
        off = 1e3 * (off - truth.tip.direction * (off @ truth.tip.direction))
        went = "over" if truth.over else "back"
        console.print(
            f"  {motion.strike_id:6} {plan.axis_id:6} {motion.verdict.value:12} went {went}; plan's line "
            f"{np.linalg.norm(off):.2f} mm off, phi {np.degrees(truth.phi):.2f} deg  {motion.reason}"
        )
