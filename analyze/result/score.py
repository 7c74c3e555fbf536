"""Errors of an estimate against the ground truth (topics under /truth/) of a virtual recording.

The estimate and its Result document never use the ground truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.errors import RecordingError
from analyze.estimation.equiplane import standing_angle
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from analyze.result.digits import decimals, number, signed
from analyze.types import Array
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.quantity import Quantity
from schemas.strike_plan import PlannedStrike

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from analyze.result.answer import Answer


@dataclass(frozen=True)
class TipTruth:
    """True balance angle [rad], moment of inertia [kg m²] and lever arm [m] of one strike's tip.

    The moment is about the line of contact at balance. The lever arm is the distance of the centre of mass
    from the centre line of the edge's rounding.
    """

    phi: float
    """balance angle [rad]: the centre of mass c stands above the centre line of the edge's rounding"""
    i_edge: float
    """moment of inertia about the contact line at balance [kg m²], m*g*R/k = I_c,l + m*(R + rho)²; I_c,l is
    the moment about the parallel line through c, rho the edge's radius"""
    distance: float
    """distance R of c from that centre line [m]"""


def tip_truth(planned: PlannedStrike, body: pb.TruthBody) -> TipTruth:
    """True values for one strike's pivot, from the ground truth of a virtual recording.

    The formulas are those of method.md, section 3.

    Args:
        planned: rest pose and pivot of the strike; the pivot lies on the centre line of the edge's rounding.
        body: ground truth: mass, centre of mass and inertia about it, in the object frame O.

    Returns:
        Balance angle [rad], moment of inertia about the contact line at balance [kg m²], and distance of the
        centre of mass from the centre line [m].
    """
    direction = np.array(planned.pivot.direction)
    direction = direction / np.linalg.norm(direction)
    up = np.array(planned.R_world_object)[2]
    com, point = np.array(body.com_object), np.array(planned.pivot.point)
    arm = com - point
    distance = float(np.linalg.norm(arm - direction * (arm @ direction)))
    about_c = float(direction @ np.array(body.inertia_com).reshape(3, 3) @ direction)
    i_edge = about_c + body.mass_kg * (distance + planned.pivot.radius_m) ** 2
    return TipTruth(float(standing_angle(com, direction, up, point)), i_edge, distance)


def score_answer(path: Path, answer: Answer) -> dict[str, Any]:
    """Errors of an answer against the ground truth of a virtual recording, as a table ready for JSON.

    Lists of phi and I_edge (moment about the edge) run over the strikes used (`strike_ids`), those of the
    centre of mass over x, y, z, those of regions over `region_names`; an entry of `i_edge_relative_error` is
    None where the strike has no I_edge.

    Region masses are those of the shell, the upper and the lower part of the interior. Their errors are the
    paper's metric, the mean over regions of abs(dm) / M, and the mass in the wrong region, sum abs(dm) / 2M,
    with dm the error of a region's mass and M the object's mass; both are None if the truth has no three
    regions. "Upper" is by the true plane that divides the interior. If the estimated plane's normal points to
    the other side, the estimate's two interior masses are swapped.

    Args:
        path: recording that holds the ground truth.
        answer: answer from that recording, or from several of the same object.

    Returns:
        Errors, true values and sd by name. The unit ends the name (m, rad, kg_m2, kg); other numbers are
        unitless: relative errors, by axis id for `i_com_relative_error` (moment about the parallel of the
        axis through the centre of mass), and `mass_in_wrong_region`.

    Raises:
        RecordingError: the recording holds no ground truth, or is damaged.
    """
    body = read_truth(path).body
    estimate, result = answer.estimate, answer.result
    motions = {motion.strike_id: motion for motion in estimate.evidence.motions}
    used = [strike for strike in result.strikes if strike.used and strike.phi is not None]
    truths = [tip_truth(estimate.evidence.planned(motions[strike.id]), body) for strike in used]
    com_true, inertia_true = _object_alone(estimate, body)
    error = np.array(result.centre_of_mass.value) - com_true
    sd = np.sqrt(np.diag(estimate.com.covariance))
    table: dict[str, Any] = {
        "centre_of_mass_error_m": float(np.linalg.norm(error)),
        "centre_of_mass_error_vector_m": error.tolist(),
        "centre_of_mass_sd_m": sd.tolist(),
        **_interval_scores(result.centre_of_mass, com_true),
        "centre_of_mass_true_m": com_true.tolist(),
        "strike_ids": [strike.id for strike in used],
        "phi_true_rad": [truth.phi for truth in truths],
        "phi_error_rad": [
            _scalar(strike.phi) - truth.phi for strike, truth in zip(used, truths, strict=True)
        ],
        "i_edge_true_kg_m2": [truth.i_edge for truth in truths],
        "i_edge_relative_error": [
            None if strike.i_edge is None else _scalar(strike.i_edge) / truth.i_edge - 1
            for strike, truth in zip(used, truths, strict=True)
        ],
        "i_com_relative_error": {
            axis.axis_id: (axis.i_com / float(axis.direction @ inertia_true @ axis.direction) - 1)
            for axis in estimate.inertial.axes
        },
    }
    if estimate.paper is not None:
        off = estimate.paper.com.position - com_true
        table["centre_of_mass_paper_error_m"] = float(np.linalg.norm(off))
    table.update(_region_scores(estimate, body))
    return table


def _object_alone(estimate: Estimate, body: pb.TruthBody) -> tuple[Array, Array]:
    """True centre of mass (3,) [m] and inertia (3, 3) [kg m²] about it of the object without its fixture.

    The truth of the recording is that of the body that was struck. The fixture's own is what the object file
    states: the virtual rig takes it as true.
    """
    com, inertia = np.array(body.com_object), np.array(body.inertia_com).reshape(3, 3)
    held = estimate.evidence.model.held
    if held is None:
        return com, inertia
    alone = held.com_alone(com)
    return alone, inertia - body.mass_kg * held.unit_inertia_struck(alone, np.zeros((3, 3)))


def _interval_scores(com: Quantity, com_true: Array) -> dict[str, Any]:
    """Intervals of a centre of mass [m], whether they hold the truth, and the direction not measured.

    Args:
        com: centre of mass in O, the object's frame [m].
        com_true: (3,) true centre of mass in O [m].
    """
    ends = None if com.interval95 is None else np.array(com.interval95, dtype=np.float64)
    held = None if ends is None else ((ends[:, 0] <= com_true) & (com_true <= ends[:, 1])).tolist()
    return {
        "centre_of_mass_interval95_m": com.interval95,
        "centre_of_mass_in_interval95": held,
        "centre_of_mass_unobserved_direction": com.unobserved_direction,
    }


def score_if_virtual(paths: Sequence[Path], answer: Answer) -> dict[str, Any] | None:
    """Errors of an answer against the ground truth that virtual recordings hold.

    Args:
        paths: recordings that the answer was estimated from, at least one.
        answer: the answer.

    Returns:
        Errors, true values and standard deviations by name, ready for JSON; the unit ends the name (m, rad,
        kg_m2, kg), the others are unitless. None if a recording holds no ground truth.

    Raises:
        RecordingError: the recordings hold different ground truths, or one cannot be read.
    """
    if not all(_holds_truth(path) for path in paths):
        return None
    refuse_without_truth(paths)
    return score_answer(paths[0], answer)


def refuse_without_truth(paths: Sequence[Path]) -> None:
    """Raise RecordingError unless all recordings hold the same ground truth of their object.

    Call it before the estimate, which takes minutes. Only the truth of the object itself is compared, not
    that of rig and session (friction, table tilt, camera).

    Raises:
        RecordingError: a recording holds no ground truth, or another than the first, or cannot be read.
    """
    for path in paths:
        if not _holds_truth(path):
            raise RecordingError(
                f"{path}: holds no ground truth: only recordings of the virtual rig (`acquire demo`) can be"
                " scored"
            )
    first = read_truth(paths[0]).body
    for path in paths[1:]:
        if _object_truth(read_truth(path).body) != _object_truth(first):
            raise RecordingError(
                f"{paths[0]} and {path}: hold different ground truths: the objects differ inside:"
                " score each by itself"
            )


def _object_truth(body: pb.TruthBody) -> list[float]:
    """Ground truth of the object itself as a list of numbers, to compare two recordings.

    They are, in this order, mass [kg], edge radius [m], centre of mass [m], inertia about it [kg m²], masses
    [kg] of the regions, and the plane that divides the interior, all in the object frame O. The truth of rig
    and session is left out.
    """
    own = (body.com_object, body.inertia_com, body.region_mass_kg, body.region_plane)
    return [body.mass_kg, body.edge_radius_m, *(value for part in own for value in part)]


def _holds_truth(path: Path) -> bool:
    """True if the recording at `path` holds a ground truth of its object.

    Raises:
        RecordingError: the recording cannot be read.
    """
    with open_recording(path) as recording:
        return any(topic.name == topics.TRUTH_BODY.name and topic.count > 0 for topic in recording.topics())


def _region_scores(estimate: Estimate, body: pb.TruthBody) -> dict[str, Any]:
    """Relative errors of the masses of shell, upper and lower interior, as a dict of JSON values by name.

    The shell is the outer wall; a plane divides the interior. The error is the mean absolute error of the
    three masses over the total mass; with it come the fraction of mass in a wrong region, the regions' names,
    true and estimated masses [kg], the error of the plane's normal [rad], and the error of each naive answer
    and of the paper's method (VISAPP 2013), if that found masses. If the truth has no three region masses,
    the only two entries, `region_mass_error_relative` and `mass_in_wrong_region`, are None.
    """
    if len(body.region_mass_kg) != 3:
        return {"region_mass_error_relative": None, "mass_in_wrong_region": None}
    truth = np.array(body.region_mass_kg)
    normal = np.array(body.region_plane[:3])

    def aligned(masses: Array, normal_found: Array) -> Array:
        """Masses (3,) of shell, upper and lower part, the last two swapped if the dividing plane is reversed.

        `masses` (3,), in any unit, are those before. The plane is reversed if its normal `normal_found` (3,)
        points away from that of the true plane.
        """
        return masses if normal_found @ normal >= 0 else masses[[0, 2, 1]]

    distribution = estimate.distribution
    masses = aligned(distribution.masses, distribution.dividing_plane_normal)
    found: dict[str, Any] = {
        "region_names": list(distribution.names),
        "region_mass_true_kg": truth.tolist(),
        "region_mass_kg": masses.tolist(),
        "region_mass_error_relative": _mean_region_error(masses, truth),
        "mass_in_wrong_region": float(np.abs(masses - truth).sum() / 2 / truth.sum()),
        "dividing_plane_error_rad": float(
            np.arccos(np.clip(abs(distribution.dividing_plane_normal @ normal), -1, 1))
        ),
        "region_mass_error_relative_baselines": {
            name: _mean_region_error(aligned(naive, distribution.dividing_plane_normal), truth)
            for name, naive in sorted(distribution.baselines.items())
        },
    }
    by_paper = None if estimate.paper is None else estimate.paper.regions
    if by_paper is not None:
        paper = aligned(by_paper.masses, by_paper.dividing_plane_normal)
        found["region_mass_error_relative_paper"] = _mean_region_error(paper, truth)
    return found


def _mean_region_error(masses: Array, truth: Array) -> float:
    """Mean absolute error of the masses of shell (outer wall) and two interior parts, over the true mass."""
    return float(np.abs(masses - truth).mean() / truth.sum())


def _scalar(quantity: Any) -> float:
    """Value of a scalar Quantity (value with unit and sd) as a float."""
    return float(quantity.value)


def render_score(score: dict[str, Any]) -> None:
    """Print the errors of an answer on the terminal: a table of the strikes, then one or two sentences.

    The first gives the error of the centre of mass; the second, only if the truth has region masses, the
    errors of the masses of shell and interior parts.

    Args:
        score: the table that `score_answer` returns.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Column, Table

    from schemas.terminal import Terminal, styled

    console = Terminal()
    strikes = Table(
        "strike",
        Column("true φ (°)", justify="right"),
        Column("error (°)", justify="right"),
        Column("error of I_edge (%)", justify="right"),
        title="Strikes compared with ground truth",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    columns = ("strike_ids", "phi_true_rad", "phi_error_rad", "i_edge_relative_error")
    for name, phi, wrong, moment in zip(*(score[key] for key in columns), strict=True):
        strikes.add_row(
            name,
            number(np.degrees(phi), 3),
            signed(np.degrees(wrong), 3),
            "–" if moment is None else signed(100 * moment, 2),
        )
    if score["strike_ids"]:
        console.print(strikes)
    true, off = (
        1e3 * np.array(score[key]) for key in ("centre_of_mass_true_m", "centre_of_mass_error_vector_m")
    )
    known, found = (", ".join(number(v, 3) for v in place) for place in (true, true + off))
    paper = score.get("centre_of_mass_paper_error_m")
    by_paper = "" if paper is None else f"; the paper's estimator: {1e3 * paper:.3f} mm"
    console.print(
        styled(
            f"true centre of mass ({known}) mm, estimated ({found}) mm: off by ",
            (f"{1e3 * score['centre_of_mass_error_m']:.3f} mm", "bold"),
            f" ({', '.join(signed(v, 3) for v in off)}){by_paper}",
        )
    )
    for line in _interval_lines(score):
        console.print(styled(line))
    if score["region_mass_error_relative"] is not None:
        naive = min(score["region_mass_error_relative_baselines"].items(), key=lambda item: item[1])
        masses = ", ".join(
            f"{n} {1e3 * m:.1f} g"
            for n, m in zip(score["region_names"], score["region_mass_true_kg"], strict=True)
        )
        console.print(
            styled(
                f"true region masses {masses}; estimates off by ",
                (f"{score['region_mass_error_relative']:.1%}", "bold"),
                f" of the total ({score['mass_in_wrong_region']:.1%} in the wrong region); best naive answer"
                f" ({naive[0].replace('_', ' ')}): {naive[1]:.1%}",
            )
        )


def _interval_lines(score: dict[str, Any]) -> list[str]:
    """Sentences on the centre of mass: whether its intervals hold the truth, and what was not measured.

    Args:
        score: the table that `score_answer` returns.
    """
    lines = []
    if score["centre_of_mass_interval95_m"] is not None:
        widths = 1e3 * np.ptp(score["centre_of_mass_interval95_m"], axis=1)
        places = decimals(float(widths.min()) / 2)
        ends = ", ".join(
            f"{name} {number(1e3 * low, places)} to {number(1e3 * high, places)}"
            for name, (low, high) in zip("xyz", score["centre_of_mass_interval95_m"], strict=True)
        )
        missed = [
            name for name, held in zip("xyz", score["centre_of_mass_in_interval95"], strict=True) if not held
        ]
        verdict = f"miss it along {' and '.join(missed)}" if missed else "hold the truth"
        lines.append(f"its 95 % intervals, {ends} mm, {verdict}")
    if score["centre_of_mass_unobserved_direction"] is not None:
        direction = ", ".join(number(v, 2) for v in score["centre_of_mass_unobserved_direction"])
        lines.append(
            f"the strikes do not determine it along ({direction}): the error there is that of "
            "an assumption, not of a measurement"
        )
    return lines
