"""A replay's words, as Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import TipMotion
    from schemas.result import Quantity, Result


def answer_text(name: str, result: Result) -> str:
    """The answer in a few lines: what it is, how sure, what to doubt."""
    used = sum(strike.used for strike in result.strikes)
    lines = [f"# {name}", "", _headline(result.centre_of_mass), *(f"\n**{sentence}**" for sentence in (result.verdict or [])[:1])]
    lines += ["", "| what | value | 95 % |", "|:--|--:|--:|"]
    lines.append(_row("mass (given)" if result.mass.source == "given" else "mass", result.mass, 1e3, "g", 1))
    lines += _centre(result.centre_of_mass)
    lines += [_row(f"inertia about c, axis {moment.axis_id}", moment.i_com, 1e7, "g cm²", 0) for moment in result.moments]
    if result.regions is not None:
        lines += [_row(f"mass: {region.name}", region.mass, 1e3, "g", 1) for region in result.regions.regions]
    lines += ["", f"{used} of {len(result.strikes)} strikes used.", ""]
    lines += [f"- {sentence}" for sentence in (result.verdict or [])[1:]]
    lines += [f"- *{warning.text}*" for warning in result.warnings]
    return "\n".join(lines)


def waiting_text(name: str, done: int, total: int | None) -> str:
    """While there is no answer yet."""
    far = f"{done} of {total} strikes are read." if total is not None else f"{done} strikes so far: the session still runs."
    return f"# {name}\n\n**No answer yet.** {far}"


def no_answer_text(name: str, problems: Sequence[str]) -> str:
    """Where there will be none."""
    return "\n".join([f"# {name}", "", "**No answer.**", "", *(f"- {problem}" for problem in problems)])


def strike_text(motion: TipMotion) -> str:
    """One strike in a few lines."""
    lines = [f"**{motion.strike_id}: {motion.verdict.value.replace('_', ' ')}.** {motion.reason}", ""]
    for fit, used in ((motion.fit, "used"), *((other, "beside it") for other in motion.alternatives)):
        if fit is not None:
            sd = np.degrees(np.sqrt(fit.covariance[0, 0]))
            k = "" if fit.k is None else f", k = {fit.k:.2f} ± {1.96 * np.sqrt(fit.covariance[1, 1]):.2f} s⁻²"
            lines.append(f"- `{fit.estimator}` ({used}): φ = {np.degrees(fit.phi):.3f}° ± {1.96 * sd:.3f}°{k}")
    if motion.fit is not None and len(motion.fit.residual) and motion.energy_ratio is not None:
        rms = np.degrees(np.sqrt(np.mean(motion.fit.residual**2)))
        lines.append(f"- residual {rms:.3f}° rms; energy over what the tip needs {motion.energy_ratio:.2f}")
    return "\n".join(lines)


def unread_text(strike_id: str, verdict: str, why: str) -> str:
    """A strike whose motion was not read; `verdict` is what the session said of it, if anything."""
    said = f" The session said: {verdict}." if verdict else ""
    return f"**{strike_id}.**{said} {why}".strip()


def _headline(centre: Quantity) -> str:
    if not isinstance(centre.value, list) or not isinstance(centre.sd, list):
        return "## Centre of mass: not known"
    values = ", ".join(f"{1e3 * value:.1f}" for value in centre.value if isinstance(value, float))
    widest = max((1.96e3 * sd for sd in centre.sd if isinstance(sd, float)), default=0.0)
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
    shown = f"{factor * value:.{digits}f} {unit}" if isinstance(value, float) and quantity.observed else "not observed"
    return f"| {name} | {shown} | {_interval(quantity, factor, digits)} |"


def _interval(quantity: Quantity, factor: float, digits: int) -> str:
    ends = quantity.interval95
    if isinstance(ends, list) and len(ends) == 2 and all(isinstance(end, float) for end in ends):
        low, high = (factor * end for end in ends if isinstance(end, float))
        return f"{low:.{digits}f} to {high:.{digits}f}"
    return _half(quantity.sd, factor, digits)


def _half(sd: object, factor: float, digits: int) -> str:
    return f"± {1.96 * factor * sd:.{digits}f}" if isinstance(sd, float) else "–"
