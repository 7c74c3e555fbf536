"""Texts of a replay's pages as Markdown: the answer or why there is none, and each strike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.replay.markdown import as_written, message
from analyze.result.digits import open_interval, with_interval
from analyze.result.headline import edge_labels, further_warnings, headline
from schemas.toss_result import TossVerdict
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.flight.toss import TossMotion
    from analyze.types import TipMotion
    from schemas.result import Result


def answer_text(name: str, result: Result) -> str:
    """Markdown text of the page with the answer: centre of mass, inertia tensor, verdict, masses, warnings.

    Args:
        name: name of the object, the heading.
        result: Result document of the estimate.
    """
    shown, labels = headline(result), edge_labels(result)
    used = sum(strike.used for strike in result.strikes)
    lines = [
        f"# {as_written(name)}",
        "",
        f"{shown.mass}; {used} of {counted(len(result.strikes), 'strike')} used.",
    ]
    lines += ["", "## Centre of mass [mm]", "", "| x | y | z |", "|--:|--:|--:|"]
    lines += [f"| {' | '.join(entry.text for entry in shown.com)} |", ""]
    lines += [shown.com_note] * bool(shown.com_note)
    lines += [
        "",
        f"## Inertia tensor about it [{shown.unit.label}]",
        "",
        "| | x | y | z |",
        "|:--|--:|--:|--:|",
    ]
    lines += [
        f"| {axis} | {' | '.join(entry.marked for entry in row)} |"
        for axis, row in zip("xyz", shown.tensor, strict=True)
    ]
    lines += ["", "| principal moment | along |", "|--:|--:|"]
    lines += [f"| {each.moment.marked} | {each.direction} |" for each in shown.principal]
    lines += ["", shown.tensor_note] * bool(shown.tensor_note)
    lines += ["", *(f"- {message(sentence)}" for sentence in result.verdict or [])]
    if result.regions is not None:
        lines += ["", "## Region masses [g]", "", "| region | 95 % |", "|:--|--:|"]
        lines += [
            f"| {as_written(each.name)} | {open_interval(each.mass, 1e3)} |"
            for each in result.regions.regions
        ]
    if result.moments:
        lines += ["", f"## Moments by edge [{shown.unit.label}]", ""]
        lines += ["| edge | about the edge | about the centre of mass |", "|:--|--:|--:|"]
    lines += [
        f"| {as_written(labels[each.axis_id])} | {with_interval(each.i_edge, shown.unit.factor)} | "
        f"{with_interval(each.i_com, shown.unit.factor)} |"
        for each in result.moments
    ]
    if shown.urdf is not None:
        lines += ["", "## For URDF, in kg and m", "", "```xml", shown.urdf, "```"]
    lines += ["", *(f"- *{message(warning.text)}*" for warning in further_warnings(result))]
    return "\n".join(lines)


def waiting_text(name: str, done: int, total: int | None) -> str:
    """Markdown text of the replay's page "answer" before there is an answer.

    Args:
        name: name of the recording.
        done: number of strikes measured so far.
        total: number of strikes in all; None while the session is running.
    """
    far = (
        f"{done} of {counted(total, 'strike')} measured."
        if total is not None
        else f"{counted(done, 'strike')} so far; the session is still running."
    )
    return f"# {as_written(name)}\n\n**No answer yet.** {far}"


def no_answer_text(name: str, problems: Sequence[str]) -> str:
    """Markdown text of the replay's page "answer" if the recording gives no answer.

    Args:
        name: name of the recording, the heading.
        problems: reasons, one line each.
    """
    listed = [f"- {message(problem)}" for problem in problems]
    return "\n".join([f"# {as_written(name)}", "", "**No answer.**", "", *listed])


def strike_text(motion: TipMotion, choice: str = "") -> str:
    """Text of a strike's page: verdict, fits with 95 % intervals, residual and energy ratio.

    Fits that do not exist are left out; residual and energy ratio (kinetic energy over the energy needed to
    tip), too, without a fit or a ratio. `choice` is the reason for choosing the strike; "" if the plan did.
    """
    verdict = motion.verdict.value.replace("_", " ")
    lines = [f"**{as_written(motion.strike_id)}: {verdict}.** {message(motion.reason)}", ""]
    for fit, used in ((motion.fit, "used"), *((other, "for comparison") for other in motion.alternatives)):
        if fit is not None:
            sd = np.degrees(np.sqrt(fit.covariance[0, 0]))
            k = (
                ""
                if fit.k is None
                else f", k = {fit.k:.2f} ± {SIGMAS_95 * np.sqrt(fit.covariance[1, 1]):.2f} s⁻²"
            )
            lines.append(
                f"- `{fit.estimator}` ({used}): φ = {np.degrees(fit.phi):.3f}° ± {SIGMAS_95 * sd:.3f}°{k}"
            )
    if motion.fit is not None and motion.energy_ratio is not None:
        rms = np.degrees(np.sqrt(np.mean(motion.fit.residual**2)))
        lines.append(
            f"- residual {rms:.3f}° rms; energy ratio E = {motion.energy_ratio:.2f} (energy given, over the "
            "energy needed to tip)"
        )
    if choice:
        lines.append(f"- chosen: {message(choice)}")
    return "\n".join(lines)


def toss_text(toss: TossMotion) -> str:
    """Text of a toss's page: verdict with its reason, spin, principal axis and residual."""
    verdict = toss.verdict.value.replace("_", " ")
    lines = [f"**{as_written(toss.toss_id)}: {verdict}.** {message(toss.reason)}", ""]
    if toss.flight is not None and toss.turns_per_s is not None:
        if toss.verdict is not TossVerdict.GOOD:  # a good one's reason states them
            lines.append(
                f"- {toss.flight_s:.2f} s in free flight and in view, {toss.turns_per_s:.1f} turns a second"
            )
        if toss.axis_angle is not None:
            lines.append(
                f"- spins {np.degrees(toss.axis_angle):.0f}° off the nearest principal axis of inertia"
            )
        lines.append(
            f"- residual {toss.flight.residual_px:.2f} px rms between the corners and the fitted flight"
        )
    return "\n".join(lines)


def unread_text(strike_id: str, verdict: str, why: str) -> str:
    """Markdown text for a strike whose motion was not measured, shown on its page (tab) of the replay.

    Args:
        strike_id: id of the strike.
        verdict: verdict on the strike reached during the session; "" if there is none.
        why: reason why the motion was not measured.
    """
    session_verdict = f" Verdict of the session: {as_written(verdict)}." if verdict else ""
    return f"**{as_written(strike_id)}.**{session_verdict} {message(why)}".strip()
