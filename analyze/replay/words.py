"""Texts of a replay's pages as Markdown: the answer or why there is none, and each strike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import TipMotion
    from schemas.quantity import Quantity
    from schemas.result import Result


def answer_text(name: str, result: Result) -> str:
    """Markdown text of the page with the answer: centre of mass, quantities, verdict and warnings.

    Args:
        name: name of the object, the heading.
        result: Result document of the estimate.
    """
    used = sum(strike.used for strike in result.strikes)
    lines = [
        f"# {name}",
        "",
        _headline(result.centre_of_mass),
        *(f"\n**{sentence}**" for sentence in (result.verdict or [])[:1]),
    ]
    lines += ["", "| quantity | value | 95 % |", "|:--|--:|--:|"]
    lines.append(_row("mass (given)" if result.mass.source == "given" else "mass", result.mass, 1e3, "g", 1))
    lines += _centre(result.centre_of_mass)
    lines += [
        _row(f"moment about c, axis {moment.axis_id}", moment.i_com, 1e7, "g cm²", 0)
        for moment in result.moments
    ]
    if result.regions is not None:
        lines += [_row(f"mass: {region.name}", region.mass, 1e3, "g", 1) for region in result.regions.regions]
    lines += ["", f"{used} of {counted(len(result.strikes), 'strike')} used.", ""]
    lines += [f"- {sentence}" for sentence in (result.verdict or [])[1:]]
    lines += [f"- *{warning.text}*" for warning in result.warnings]
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
    return f"# {name}\n\n**No answer yet.** {far}"


def no_answer_text(name: str, problems: Sequence[str]) -> str:
    """Markdown text of the replay's page "answer" if the recording gives no answer.

    Args:
        name: name of the recording, the heading.
        problems: reasons, one line each.
    """
    return "\n".join([f"# {name}", "", "**No answer.**", "", *(f"- {problem}" for problem in problems)])


def strike_text(motion: TipMotion) -> str:
    """Text of a strike's page: verdict, fits with 95 % intervals, residual and energy ratio.

    Fits, residual and energy ratio (kinetic energy over the energy needed to tip) are left out where there
    is no fit.
    """
    lines = [f"**{motion.strike_id}: {motion.verdict.value.replace('_', ' ')}.** {motion.reason}", ""]
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
    return "\n".join(lines)


def unread_text(strike_id: str, verdict: str, why: str) -> str:
    """Markdown text for a strike whose motion was not measured, shown on its page (tab) of the replay.

    Args:
        strike_id: id of the strike.
        verdict: verdict on the strike reached during the session; "" if there is none.
        why: reason why the motion was not measured.
    """
    session_verdict = f" Verdict of the session: {verdict}." if verdict else ""
    return f"**{strike_id}.**{session_verdict} {why}".strip()


def _headline(centre: Quantity) -> str:
    if not isinstance(centre.value, list) or not isinstance(centre.sd, list):
        return "## Centre of mass: not observable"
    values = ", ".join(f"{1e3 * value:.1f}" for value in centre.value if isinstance(value, float))
    widest = max((SIGMAS_95 * 1e3 * sd for sd in centre.sd if isinstance(sd, float)), default=0.0)
    return f"## Centre of mass ({values}) mm, each within ± {widest:.1f} mm"


def _centre(centre: Quantity) -> list[str]:
    if not isinstance(centre.value, list):
        return []
    spread = centre.sd if isinstance(centre.sd, list) else [None] * 3
    return [
        f"| centre of mass {axis} | {1e3 * value:.2f} mm | {_half(sd, 1e3, 2)} |"
        for axis, value, sd in zip("xyz", centre.value, spread, strict=False)
        if isinstance(value, float)
    ]


def _row(name: str, quantity: Quantity, factor: float, unit: str, digits: int) -> str:
    value = quantity.value
    shown = (
        f"{factor * value:.{digits}f} {unit}"
        if isinstance(value, float) and quantity.observed
        else "not observable"
    )
    return f"| {name} | {shown} | {_interval(quantity, factor, digits)} |"


def _interval(quantity: Quantity, factor: float, digits: int) -> str:
    ends = quantity.interval95
    if isinstance(ends, list) and len(ends) == 2 and all(isinstance(end, float) for end in ends):
        low, high = (factor * end for end in ends if isinstance(end, float))
        return f"{low:.{digits}f} to {high:.{digits}f}"
    return _half(quantity.sd, factor, digits)


def _half(sd: object, factor: float, digits: int) -> str:
    return f"± {SIGMAS_95 * factor * sd:.{digits}f}" if isinstance(sd, float) else "–"
