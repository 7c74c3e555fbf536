"""Comparison document of repeated sessions: answers, precision by ISO 5725, agreement, verdict.

A session is one recording of the object; sessions of one set-up share rig, level reading and calibration.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import chdtri

from analyze.estimation.precision import MIN_GROUPS, mandel_h, mandel_h_limit, precision
from analyze.report.report_document import report_recording
from analyze.result.comparison import chi_squared_p_value
from analyze.result.rounding import rounded
from schemas.comparison import Comparison, QuantityPrecision, SessionAnswer, SessionsAgreement, SessionValue
from schemas.quantity import Quantity
from schemas.result import RegionResult
from schemas.strike_result import Verdict
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.estimation.agreement import Agreement
    from analyze.result.answer import Answer
    from analyze.result.comparison import SessionComparison

OPPOSITE_REGION = {"upper": "lower", "lower": "upper"}
MIN_FREEDOM = 5
"""least degrees of freedom of a standard deviation that the comparison's verdict does not doubt"""
Kind = Literal["centre_of_mass", "moment", "region", "phi"]


def comparison_document(compared: SessionComparison) -> Comparison:
    """Comparison document (JSON values), which holds all numbers that the comparison page shows.

    Args:
        compared: two or more sessions, each estimated by itself and all together.
    """
    first = compared.sessions[0].answer
    precisions = [*_answers(compared), *_angles(compared)]
    evidence = compared.joint.estimate.evidence
    return rounded(
        Comparison(
            object=evidence.spec.name,
            object_sha256=evidence.object_sha256,
            software=evidence.software,
            verdict=list(_verdict(compared, precisions)),
            agreement=_agreement(compared.together, compared.degrees_of_freedom),
            may_join=compared.may_merge,
            sessions=[
                SessionAnswer(
                    recording=report_recording(number, session.head),
                    setup=session.setup + 1,
                    strikes=len(session.answer.result.strikes),
                    strikes_used=len(session.answer.estimate.planes),
                    centre_of_mass=session.answer.result.centre_of_mass,
                    moments=session.answer.result.moments,
                    regions=regions_named_as(session.answer, first),
                    against_others=_agreement(session.against_others, 3),
                    stands_out=compared.outlier == number - 1,
                )
                for number, session in enumerate(compared.sessions, 1)
            ],
            joint=compared.joint.result.centre_of_mass,
            precision=precisions,
            mandel_h_limit=(
                mandel_h_limit(len(compared.sessions)) if len(compared.sessions) >= MIN_GROUPS else None
            ),
        )
    )


def regions_named_as(answer: Answer, first: Answer) -> list[RegionResult]:
    """Regions of an answer with their masses, named as in the answer of the first session.

    The regions are the shell and the interior above (upper) and below (lower) a dividing plane; upper and
    lower are swapped if the normals of the two answers' planes point to opposite sides. Empty if `answer` has
    no regions.
    """
    found = answer.result.regions
    regions = {} if found is None else {region.name: region for region in found.regions}
    normal, first_normal = (each.estimate.distribution.dividing_plane_normal for each in (answer, first))
    if float(normal @ first_normal) >= 0:
        return list(regions.values())
    return [regions[OPPOSITE_REGION.get(name, name)].model_copy(update={"name": name}) for name in regions]


def _agreement(found: Agreement, freedom: int) -> SessionsAgreement:
    squared = max(found.chi_squared, 0.0)
    return SessionsAgreement(
        chi_squared=squared,
        freedom=freedom,
        chance=chi_squared_p_value(squared, freedom),
        apart_m=found.largest_shift,
    )


def _answers(compared: SessionComparison) -> Iterator[QuantityPrecision]:
    """Yield a row for each coordinate of the centre of mass, each moment and each region mass.

    A row holds the sessions' values, and how well they repeat within a set-up and across set-ups (ISO 5725);
    a set-up is a rig with its calibration and its reading of a level (the instrument). Moments and masses are
    left out if fewer than two sessions have them.
    """
    first, setups = compared.sessions[0].answer, [session.setup for session in compared.sessions]
    alone = [session.answer.result for session in compared.sessions]
    together = compared.joint.result
    for i, axis in enumerate("xyz"):
        answers = [_component(result.centre_of_mass, i) for result in alone]
        yield _compared(
            f"centre of mass {axis}",
            "centre_of_mass",
            answers,
            setups,
            _component(together.centre_of_mass, i),
        )
    joint_moments = {moment.axis_id: moment.i_com for moment in together.moments}
    for name, whole in joint_moments.items():
        by_session = [
            next((moment.i_com for moment in result.moments if moment.axis_id == name), None)
            for result in alone
        ]
        yield from _if_compared(f"I {name}", "moment", by_session, setups, whole)
    joint_regions = {region.name: region.mass for region in regions_named_as(compared.joint, first)}
    masses = [
        {region.name: region.mass for region in regions_named_as(session.answer, first)}
        for session in compared.sessions
    ]
    for name, whole in joint_regions.items():
        yield from _if_compared(name, "region", [each.get(name) for each in masses], setups, whole)


def _if_compared(
    name: str, kind: Kind, answers: Sequence[Quantity | None], setups: Sequence[int], together: Quantity
) -> Iterator[QuantityPrecision]:
    if sum(answer is not None for answer in answers) > 1:
        yield _compared(name, kind, answers, setups, together)


def _compared(
    name: str, kind: Kind, answers: Sequence[Quantity | None], setups: Sequence[int], together: Quantity
) -> QuantityPrecision:
    rows: list[SessionValue] = []
    groups: dict[int, list[float]] = defaultdict(list)
    for number, (answer, setup) in enumerate(zip(answers, setups, strict=True), 1):
        if answer is not None and isinstance(answer.value, float):
            rows.append(
                SessionValue(
                    session=number, value=answer.value, interval95=_ends(answer), results=[answer.value]
                )
            )
            groups[setup].append(answer.value)
    return _row(name, kind, together.unit, "set-up", rows, list(groups.values()), together)


def _angles(compared: SessionComparison) -> Iterator[QuantityPrecision]:
    """Yield a row on the balance angle phi [rad] for each pivot edge and heading.

    A row holds the values of the sessions and their precision (ISO 5725). The heading is the direction on the
    table in which the object was struck. Repeated strikes within a session are a group. Only strikes that
    were used and tipped over count; an edge and heading with fewer than two of them is left out.
    """
    cells: dict[tuple[str, float], dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for number, session in enumerate(compared.sessions, 1):
        for strike in session.answer.result.strikes:
            if (
                strike.used
                and strike.verdict is Verdict.GOOD
                and strike.phi is not None
                and isinstance(strike.phi.value, float)
            ):
                cells[strike.axis_id, strike.heading_rad][number].append(strike.phi.value)
    for (axis, heading), by_session in sorted(cells.items()):
        if sum(len(values) for values in by_session.values()) < 2:
            continue
        rows = [
            SessionValue(session=number, value=float(np.mean(values)), results=values)
            for number, values in by_session.items()
        ]
        name = f"φ {axis}" if not heading else f"φ {axis} at {math.degrees(heading):.0f}°"
        yield _row(name, "phi", "rad", "session", rows, list(by_session.values()), None)


def _row(
    name: str,
    kind: Kind,
    unit: str,
    grouped_by: Literal["set-up", "session"],
    rows: list[SessionValue],
    groups: list[list[float]],
    together: Quantity | None,
) -> QuantityPrecision:
    h = mandel_h([row.value for row in rows])
    return QuantityPrecision(
        name=name,
        kind=kind,
        unit=unit,
        grouped_by=grouped_by,
        sessions=rows,
        together=together,
        mandel_h=None if h is None else h.tolist(),
        **asdict(precision(groups)),
    )


def _component(vector: Quantity, i: int) -> Quantity:
    """Component `i` (0 to 2) of a vector quantity as a scalar, with its sd and 95 % interval."""
    value, sd, ends = vector.value, vector.sd, vector.interval95
    value, sd, ends = (np.array(each)[i].tolist() for each in (value, sd, ends))
    return Quantity(value=value, sd=sd, interval95=ends, unit=vector.unit, frame=vector.frame)


def _ends(quantity: Quantity) -> list[float] | None:
    return list(quantity.interval_ends()) if quantity.interval95 else None


def _verdict(compared: SessionComparison, precisions: Sequence[QuantityPrecision]) -> Iterator[str]:
    count, odd = len(compared.sessions), compared.outlier
    significance = (
        f"χ² {compared.together.chi_squared:.1f} with {compared.degrees_of_freedom} degrees of freedom,"
        f" {p_value_text(compared.p_value)}"
    )
    if compared.may_merge:
        yield (
            f"trust that all {counted(count, 'session', 'has')} one centre of mass ({significance}): "
            "they may be merged"
        )
    else:
        apart = f"centres of mass lie up to {1e3 * compared.together.largest_shift:.2g} mm apart"
        yield (
            f"doubt that the sessions are of one body: {apart}, more than their errors allow"
            f" ({significance}); do not merge them"
        )
    if odd is not None:
        session = compared.sessions[odd]
        shift = session.against_others.largest_shift
        off = f"{1e3 * shift:.2g} mm from all others' ({p_value_text(session.p_value)})"
        yield (
            f"repeat session {odd + 1}, {session.head.path.name}: it stands out: its centre of mass is"
            f" {off}{_repeatability_without(compared, odd)}"
        )
    open_ones = [
        str(i) for i, session in enumerate(compared.sessions, 1) if not session.answer.estimate.com.observed
    ]
    if open_ones:
        yield f"doubt the centre of mass of session {', '.join(open_ones)}: one direction is not observed"
    of_c = [each for each in precisions if each.kind == "centre_of_mass"]
    yield from _doubt_few("s_r", "sessions of one set-up", [each.freedom_r for each in of_c], of_c[0].s_r)
    yield from _doubt_few("s_R", "set-ups", [each.freedom_R for each in of_c], of_c[0].s_R)


def _repeatability_without(compared: SessionComparison, odd: int) -> str:
    """End of a sentence on how well the other sessions repeat the centre of mass [mm]; "" if not known.

    Repeatability is the sd of repeated sessions within a set-up (s_r) if known, otherwise across set-ups
    (s_R), as ISO 5725 defines them.

    Args:
        compared: the sessions.
        odd: index of the session to leave out.
    """
    groups: dict[int, list[np.ndarray]] = defaultdict(list)
    for number, session in enumerate(compared.sessions):
        if number != odd:
            groups[session.setup].append(session.answer.estimate.com.position)
    found = [precision([[place[i] for place in group] for group in groups.values()]) for i in range(3)]
    for name, parts in (("s_r", [each.s_r for each in found]), ("s_R", [each.s_R for each in found])):
        known = [part for part in parts if part is not None]
        if len(known) == 3:
            return f"; without it the others repeat to {1e3 * float(np.linalg.norm(known)):.2g} mm ({name})"
    return ""


def _doubt_few(name: str, groups: str, freedoms: Sequence[int], value: float | None) -> Iterator[str]:
    freedom = min(freedoms)
    if value is not None and 0 < freedom < MIN_FREEDOM:
        yield (
            f"doubt {name} of the answers: with so few {groups} it may truly be up to"
            f" {upper_factor(freedom):.1f} times as large (95 %)"
        )


def upper_factor(freedom: int) -> float:
    """Upper limit of a true standard deviation over its estimate, with 95 % confidence (one-sided).

    Args:
        freedom: degrees of freedom of the estimate.
    """
    return math.sqrt(freedom / float(chdtri(freedom, 0.95)))


def p_value_text(p_value: float) -> str:
    """Text of a p-value with two significant digits, as "p = 0.02", or "p < 0.0001" below that."""
    return "p < 0.0001" if p_value < 1e-4 else f"p = {p_value:.2g}"
