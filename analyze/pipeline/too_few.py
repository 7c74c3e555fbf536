"""Text of the refusal (EstimationError) when fewer strikes can be used than an estimate needs.

The warning that few strikes were used is in result/warnings.py.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from analyze.flight.toss import TossMotion
from analyze.motion.verdict import ROLLED_REMEDY
from analyze.reading.planned_strikes import planned_strikes
from analyze.types import TipMotion
from schemas.strike_plan import StrikePlan
from schemas.strike_result import Verdict
from schemas.wording import counted


def too_few_text(
    needed: int,
    motions: Sequence[TipMotion],
    usable: Collection[str],
    excluded: Collection[str],
    plan: StrikePlan,
    tosses: Sequence[TossMotion] = (),
) -> str:
    """Message of one line that too few strikes can be used: their number, the reasons and the remedy.

    Args:
        needed: least number of usable strikes for an estimate.
        motions: all motions of the recordings.
        usable: ids of strikes that were fitted and tipped over or rocked back, excluded or not.
        excluded: ids left out on request, whatever their verdict.
        plan: the plan, to name the strikes that were never made.
        tosses: all tosses of the recordings, of which none can be used.
    """
    if not motions and tosses:
        left = [toss for toss in tosses if toss.toss_id not in excluded]
        if not left:
            return f"every toss is excluded on request ({len(tosses)}), and no strike was made: exclude fewer"
        seen = ", ".join(f"{toss.toss_id} {toss.verdict.value.replace('_', ' ')}" for toss in left)
        return f"no good toss of {len(left)} ({seen}), and no strike: {left[0].reason}"
    left_out = [motion for motion in motions if motion.strike_id in excluded]
    bad = [motion for motion in motions if motion.strike_id not in usable and motion not in left_out]
    reasons: list[str] = []
    if left_out:
        reasons.append(f"excluded on request: {', '.join(motion.strike_id for motion in left_out)}")
    if bad:
        verdicts = (f"{motion.strike_id} {motion.verdict.value.replace('_', ' ')}" for motion in bad)
        reasons.append(f"not usable: {', '.join(verdicts)}")
    done = planned_strikes(plan, (motion.plan_strike_id for motion in motions))
    reasons += [done.text()] if done.missing else []
    slow = [motion for motion in bad if motion.frame_rate_ratio is not None]
    if not slow:
        reasons += [motion.reason for motion in bad if motion.verdict is Verdict.UNREADABLE][:1]
    left = len(set(usable) - set(excluded))
    rolled = sum(motion.verdict is Verdict.ROLLED for motion in bad)
    remedy = (
        "exclude fewer"
        if len(usable) >= needed
        else f"strike {slow[0].strike_id}: {slow[0].reason}"
        if slow
        else f"most rolled aside on the rim: {ROLLED_REMEDY}"
        if 2 * rolled > len(bad)
        else "strike again"
    )
    why = f" ({'; '.join(reasons)})" if reasons else ""
    return f"{counted(left, 'good strike')} of {len(motions)}, {needed} are needed{why}: {remedy}"


def contradiction_text(disagreement: float | None, strikes: int) -> str:
    """Message of one line that tosses contradict strikes too few to stand alone, with remedy.

    Args:
        disagreement: chi^2 of the eight numbers that tosses determine.
        strikes: number of strikes used, one or two.
    """
    return (
        f"the tosses contradict the {counted(strikes, 'strike')} (chi squared {disagreement or 0.0:.0f} of"
        " 8): exclude the strike that rolled, slipped or was put down otherwise (--exclude), or make three"
    )
