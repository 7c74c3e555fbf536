"""Radii of the edges in the Result document, and the sentence on a stated radius that strikes contradict."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.estimation.edge_radii import STATED
from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.quantities import quantity
from analyze.types import RadiusSource
from schemas.result import EdgeRadiusResult, Result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.edge_radii import EdgeRadius, RadiusCheck

MEASURED_FRACTION = 0.5
"""fraction of its prior sd below which the sd of an edge's radius counts as measured by the strikes"""


def radius_documents(radii: Sequence[EdgeRadius]) -> list[EdgeRadiusResult]:
    """Radii [m] of the rounded pivot edges with 95 % intervals, cut at 0, for the Result document.

    The source is "measured" if the strikes reduced the radius's sd below `MEASURED_FRACTION` of that before
    them; otherwise "given" if the object file, a point cloud or the shape states the radius, else "prior".
    """
    found: list[EdgeRadiusResult] = []
    for each in radii:
        by_strikes = each.sd < MEASURED_FRACTION * each.prior.sd
        known = each.prior.source not in (RadiusSource.ASSUMED, RadiusSource.BLURRED)
        source = "measured" if by_strikes else "given" if known else "prior"
        radius = quantity(max(each.value, 0.0), each.sd, "m", lowest=0.0).model_copy(
            update={"source": source, "observed": by_strikes or known}
        )
        found.append(
            EdgeRadiusResult(
                axis_id=each.axis_id,
                radius=radius,
                expected_m=each.prior.mean,
                expected_sd_m=each.prior.sd,
                expected_from=each.prior.source.value,
            )
        )
    return found


def radius_lines(result: Result) -> list[str]:
    """Lines of text on the radii of the pivot edges [mm], with 95 % intervals.

    Edges with the same origin of what was known before the strikes (stated, scanned, not given) share a line.
    """
    found: list[str] = []
    for source in RadiusSource:
        rows = [row for row in result.edge_radii or [] if row.expected_from == source.value]
        values = [1e3 * row.radius.value for row in rows if isinstance(row.radius.value, float)]
        halves = [1e3 * SIGMAS_95 * row.radius.sd for row in rows if isinstance(row.radius.sd, float)]
        if not values:
            continue
        low, high = f"{min(values):.2f}", f"{max(values):.2f}"
        span = low if low == high else f"{low} to {high}"
        known = f"{source.value}"
        if source in STATED:
            known += (
                f" as {1e3 * rows[0].expected_m:.2f} mm" if len({r.expected_m for r in rows}) == 1 else ""
            )
        found.append(
            f"edge radius ({', '.join(row.axis_id for row in rows)}): {span} mm, ± {max(halves):.2f} mm or"
            f" better (95 % interval), {known}"
        )
    return found


def refuted_radius_text(check: RadiusCheck | None) -> str | None:
    """Sentence that begins with doubt, on stated edge radii that the strikes contradict; None without them.

    It gives the stated and the measured radius [mm] with their 95 % ranges, and the remedy.
    """
    if check is None or not check.refuted:
        return None
    stated, measured = (
        f"{1e3 * value:.2f} ± {1e3 * SIGMAS_95 * sd:.2f} mm"
        for value, sd in ((check.stated, check.stated_sd), (check.measured, check.measured_sd))
    )
    return (
        f"doubt the stated edge radius ({', '.join(check.axis_ids)}): {stated} is stated, the strikes show"
        f" {measured}; this answer takes the radius as not given: measure the rounding and correct"
        " edge_radius_m, or the [[edge]] entry"
    )
