"""Tosses in the Result document: the rows of all, what they determine, and the warnings about them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.second_moments import symmetric_entries, unit_inertia, with_size
from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.quantities import intervals95, quantity
from analyze.result.warning_text import names_text, warning
from analyze.tracking.printed_view import VIEW_PREFIX
from schemas.quantity import Quantity
from schemas.result import ResultWarning, WarningCode
from schemas.toss_result import FlightResult, TossResult, TossVerdict
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.tosses import FlightAnswer
    from analyze.types import Array, FlightEstimate

IMPROVED = 0.7
"""sd of an entry with tosses over that without, below which the tosses count as a source of it"""
_STEP = 1e-6
"""step of the numerical derivatives of the ratios"""


def flight_document(estimate: Estimate) -> FlightResult | None:
    """Entry of the Result document on the tosses; None where nothing was tossed."""
    tosses, answer = estimate.evidence.tosses, estimate.flight
    if not tosses:
        return None
    used = answer is not None and answer.agrees
    rows = [
        TossResult(
            id=toss.toss_id,
            plan_toss_id=toss.plan_toss_id,
            verdict=TossVerdict.EXCLUDED if toss.toss_id in estimate.options.exclude else toss.verdict,
            reason=toss.reason,
            used=used and answer is not None and toss.toss_id in answer.estimate.tosses,
            flight_s=toss.flight_s,
            turns_per_s=toss.turns_per_s,
            principal_axis_angle_rad=toss.axis_angle,
            residual_px=None if toss.flight is None else toss.flight.residual_px,
            followed_by=toss.followed_by,
        )
        for toss in tosses
    ]
    if answer is None:
        return FlightResult(tosses=rows, used=False)
    sd = np.sqrt(np.diag(answer.estimate.covariance)[:3])
    com = answer.estimate.mean[:3]
    return FlightResult(
        tosses=rows,
        used=used,
        centre_of_mass=Quantity(
            value=com.tolist(),
            unit="m",
            sd=sd.tolist(),
            covariance=answer.estimate.covariance[:3, :3].tolist(),
            interval95=intervals95(com, sd),
            frame="O",
            observed=True,
        ),
        inertia_ratios=_ratio_quantities(answer.estimate),
        disagreement=answer.disagreement,
        inertia_from=_sources(estimate, answer) if used else None,
    )


def tosses_used(estimate: Estimate) -> tuple[str, ...]:
    """Ids of the tosses that are part of the answer."""
    answer = estimate.flight
    return answer.estimate.tosses if answer is not None and answer.agrees else ()


def size_text(estimate: Estimate) -> str:
    """Clause on the size of the tensor, which tosses do not tell, after few strikes, with remedy."""
    used = len(estimate.fitted_planes)
    if used:
        return (
            f"the size of the tensor rests on {counted(used, 'strike')}, which nothing checks: make three or"
            " more, about two edges"
        )
    moments = np.diag(estimate.inertial.inertia)
    sd = float(np.mean(np.diag(estimate.inertial.inertia_sd) / moments))
    return (
        f"the size of the tensor comes from the shape, to {100 * SIGMAS_95 * sd:.0f} %, and only the ratios"
        " of its entries from tosses: one strike over an edge measures the size"
    )


def inertia_ratios(flight: FlightEstimate) -> tuple[Array, Array]:
    """Entries (6,) of the tensor over the mean of its diagonal, by flights, and their covariance (6, 6)."""

    def ratios(shape: Array) -> Array:
        inertia = unit_inertia(with_size(shape, 0.0))[0]
        return symmetric_entries(inertia) / (np.trace(inertia) / 3.0)

    shape = flight.mean[3:]
    value = ratios(shape)
    by = np.array([(ratios(shape + step) - value) / _STEP for step in _STEP * np.eye(5)]).T
    return value, by @ flight.covariance[3:, 3:] @ by.T


def flight_warnings(estimate: Estimate) -> list[ResultWarning]:
    """Warnings about tosses that are not used, and markers that are not where the object file says."""
    answer = estimate.flight
    if answer is not None and not answer.agrees:
        text = (
            f"tosses and strikes contradict each other (chi squared {answer.disagreement:.0f} of 8): the"
            " answer is that of the strikes; check the markers' places on the object, the camera and"
            " whether something moves inside"
        )
        return [warning(WarningCode.TOSSES_NOT_USED, text)]
    found: list[ResultWarning] = []
    if answer is not None and answer.misplaced:
        places = names_text([f"{name} by {1e3 * off:.1f} mm" for name, off in answer.misplaced.items()])
        if any(str(name).startswith(VIEW_PREFIX) for name in answer.misplaced):
            text = f"tosses find the print elsewhere than strikes showed it: {places}"
            remedy = "was the object put down as its cards show?"
            found.append(warning(WarningCode.MARKER_MOVED, f"{text}; {remedy}"))
        else:
            text = f"tosses find markers off their places in the object file: {places}; correct them"
            found.append(warning(WarningCode.MARKER_MOVED, f"{text} (`analyze register`)"))
    bad = [toss for toss in estimate.evidence.tosses if toss.verdict is not TossVerdict.GOOD]
    if not bad:
        return found
    names = names_text([f"{toss.toss_id} ({toss.verdict.value}: {toss.reason})" for toss in bad])
    return [*found, warning(WarningCode.TOSSES_NOT_USED, f"not used: {names}")]


def _ratio_quantities(flight: FlightEstimate) -> list[Quantity]:
    value, covariance = inertia_ratios(flight)
    sds = np.sqrt(np.diag(covariance))
    return [quantity(float(each), float(sd), "1") for each, sd in zip(value, sds, strict=True)]


def _sources(estimate: Estimate, answer: FlightAnswer) -> list[list[str]]:
    """What determines each entry of the tensor, in words."""
    inertial = estimate.inertial
    found: list[list[str]] = []
    for i in range(3):
        row: list[str] = []
        for j in range(3):
            if not inertial.measured[i, j]:
                row.append("shape")
            elif answer.sd_without is None or answer.measured_without is None:
                row.append("tosses")
            elif not answer.measured_without[i, j]:
                size = "strikes" if estimate.fitted_planes else "the shape"
                row.append(f"tosses with the size by {size}")
            elif inertial.inertia_sd[i, j] < IMPROVED * answer.sd_without[i, j]:
                row.append("strikes and tosses")
            else:
                row.append("strikes")
        found.append(row)
    return found
