"""One-line summary of rejected axes: counts by reason, with the range of the quantities behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.planning import next_edge, unscanned
from schemas.strike_plan import Rejection

_REASONS = {
    "slips": ("slipping", "friction needed", "", 1.0, 2),
    "lifts": ("lifting off before balance", "", "", 1.0, 0),
    "too_steep": ("too steep", "balance after", " deg", float(np.degrees(1.0)), 0),
    "no_balance": (
        "rolling back",
        "its rounding's centre is above that of mass by",
        " mm",
        1000.0,
        1,
    ),
    next_edge.CODE: (
        "with a neighbour that may land before balance",
        "at",
        " deg",
        float(np.degrees(1.0)),
        0,
    ),
    "impact_unreachable": ("without a place that the striker can meet", "", "", 1.0, 0),
    "speed": ("at another speed than the striker's", "needed", " m/s", 1.0, 2),
    "no_marker": ("without a tag that faces along them", "best is off by", " deg", float(np.degrees(1.0)), 0),
    "tag_small": ("with a tag too small in the image", "", " px", 1.0, 0),
    "out_of_image": ("with the tag out of the image", "by", " px", 1.0, 0),
    "hidden": ("with the tag hidden by the object", "when turned by", " deg", float(np.degrees(1.0)), 0),
    "unstable_plane": ("faces it may fall over on", "", "", 1.0, 0),
    "flank": ("round flank", "narrow faces:", "", 1.0, 0),
    unscanned.CODE: ("not scanned", "missing beside them", " %", 100.0, 0),
}
"""By code: description of the axes, meaning of their number, its unit, factor to that unit, decimals.

A number without meaning and unit is left out."""


def rejection_summary(rejected: Sequence[Rejection]) -> str:
    """One-line summary of rejected pivot axes and resting faces by reason, most frequent reason first.

    For example "7 slipping (friction needed 0.62 to 1.30), 5 lifting off before balance"; empty without
    rejections.
    """
    by_code: dict[str, list[Rejection]] = {}
    for each in rejected:
        by_code.setdefault(each.code, []).append(each)
    ordered = sorted(by_code.items(), key=lambda item: -len(item[1]))
    return ", ".join(f"{len(entries)} {_reason_text(code, entries)}" for code, entries in ordered)


def _reason_text(code: str, entries: Sequence[Rejection]) -> str:
    """Reason for which axes or faces were rejected, in words, with the range of the quantity behind it.

    For example "slipping (friction needed 0.62 to 1.30)". The range is left out if no rejection has a number,
    or if the numbers of this reason have neither meaning nor unit.

    Args:
        code: Reason that all rejections share; an unknown one is returned with blanks for underscores.
        entries: The rejections.
    """
    if code not in _REASONS:
        return code.replace("_", " ")
    words, what, unit, factor, decimals = _REASONS[code]
    numbers = [factor * each.number for each in entries if each.number is not None]
    if not numbers or not (what or unit):
        return words
    low, high = (f"{value:.{decimals}f}" for value in (min(numbers), max(numbers)))
    span = low if low == high else f"{low} to {high}"
    return f"{words} ({what} {span}{unit})".replace("( ", "(")
