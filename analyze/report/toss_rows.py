"""Tosses for people: a row each, and what they determine beside the strikes, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from analyze.result.digits import value_text
from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.strike_result import FollowedBy

if TYPE_CHECKING:
    from schemas.quantity import Quantity
    from schemas.result import Result

TOSS_COLUMNS = ("toss", "verdict", "in the air (s)", "turns/s", "off axis (°)", "residual (px)")
"""headings of `toss_rows`"""


def toss_rows(result: Result) -> list[tuple[str, ...]]:
    """Rows of a table of the tosses: id, verdict, time, spin, angle to a principal axis, residual."""
    if result.flight is None:
        return []

    def number(value: float | None, digits: int) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    return [
        (
            toss.id,
            toss.verdict.value,
            number(toss.flight_s, 2),
            number(toss.turns_per_s, 1),
            number(
                None
                if toss.principal_axis_angle_rad is None
                else math.degrees(toss.principal_axis_angle_rad),
                0,
            ),
            number(toss.residual_px, 3),
        )
        for toss in result.flight.tosses
    ]


def toss_lines(result: Result) -> list[str]:
    """Sentences on what the tosses determine; none without a good toss."""
    flight = result.flight
    if flight is None or flight.centre_of_mass is None:
        return []
    com = flight.centre_of_mass
    if not isinstance(com.value, list) or not isinstance(com.sd, list):
        return []
    places = ", ".join(f"{1e3 * float(each):.2f}" for each in com.value if not isinstance(each, list))
    half = 1.96e3 * max(map(float, com.sd))
    by_print = any(toss.followed_by is FollowedBy.PRINT for toss in flight.tosses)
    alone = "tosses alone, followed by the object's own print" if by_print else "tosses alone"
    lines = [f"{alone}: centre of mass ({places}) mm, to {half:.2f} mm or better (95 %)"]
    if flight.used and flight.disagreement is not None:
        lines.append(
            "tosses and strikes agree on the centre of mass and on the ratios of the moments"
            f" (chi squared {flight.disagreement:.1f} of 8)"
        )
    if flight.inertia_ratios:
        ratios = ", ".join(
            f"{name} {value_text(ratio.value, interval)}"
            for name, ratio in zip(map(tensor_entry_name, TENSOR_ENTRIES), flight.inertia_ratios, strict=True)
            if isinstance(ratio.value, float) and (interval := _ends(ratio)) is not None
        )
        lines.append(f"ratios to the mean of the moments (95 %): {ratios}")
    if flight.inertia_from is not None:
        sources: dict[str, list[str]] = {}
        for i, j in TENSOR_ENTRIES:
            sources.setdefault(flight.inertia_from[i][j], []).append(tensor_entry_name((i, j)))
        lines.append(
            "tensor: " + "; ".join(f"{', '.join(names)} by {source}" for source, names in sources.items())
        )
    return lines


def _ends(ratio: Quantity) -> tuple[float, float] | None:
    """Ends of a scalar's 95 % interval; None without one."""
    match ratio.interval95:
        case [float(low), float(high)]:
            return low, high
        case _:
            return None
