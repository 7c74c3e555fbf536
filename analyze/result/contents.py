"""Contents that move, in the Result document and as lines of text: is the struck body rigid?"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.rigidity import Answer
from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.digits import value_text
from analyze.result.quantities import intervals95
from analyze.result.warning_text import names_text
from schemas.contents_result import (
    ContentsAnswer,
    ContentsResult,
    ContentsTest,
    EdgeScatterResult,
    PoseCentreResult,
)
from schemas.quantity import Quantity

if TYPE_CHECKING:
    from analyze.estimation.fill_level import Marginal
    from analyze.estimation.pose_test import PoseCentre
    from analyze.estimation.rigidity import Rigidity
    from analyze.pipeline.loose_contents import LooseContents
    from schemas.result import Result

OPEN_SHARE = 0.15
"""largest 1 sigma of a pose's centre of mass, over half the extent of the body, that counts as observed"""
NEEDED = (
    "needs strikes over one edge at three energies, or two strikes on each of two faces: `analyze plan"
    " --contents` plans both"
)
"""what a body needs whose strikes compare neither energies nor poses"""
JOLTED = (
    "jumped, as by a second impact or by contents that hit a wall, and the other strikes do not show which:"
    " `analyze plan --contents` plans strikes that do"
)
"""what strikes whose speed jumped leave open"""
UNEXPLAINED = (
    "strikes over one edge differ by more than their errors, but not as their energies do, as if the pose at"
    " rest had differed: clean the table and the object's underside, and strike again"
)
"""what to do about strikes that differ without a sign of contents that move"""


def contents_text(contents: LooseContents, half_extent: float | None = None) -> str:
    """Answer in words to the question whether the struck body is rigid, with the evidence.

    Args:
        contents: tests of the struck body.
        half_extent: half the largest extent of the body [m]; with it the text states how far contents too
            light to show may shift the centre of mass: from one end to the other.
    """
    rigidity = contents.rigidity
    match rigidity.answer:
        case Answer.NOT_RIGID:
            return f"not rigid: {'; '.join(_evidence(rigidity))}"
        case Answer.NOTHING_MOVES:
            unseen = f"liquid below {_percent(rigidity.share)} of the mass"
            if half_extent is not None:
                shift = 2e3 * rigidity.share * half_extent
                text = f"{shift:.0f}" if shift > 1 else f"{shift:.1g}"
                unseen += f", which may shift the centre of mass by up to {text} mm from pose to pose"
            return f"nothing moves that would show ({unseen})"
        case Answer.NOT_TESTED if rigidity.energies.unexplained:
            return f"not tested: {UNEXPLAINED}"
        case Answer.NOT_TESTED if contents.suspected:
            return f"not tested: the speed of {names_text(contents.jolted)} {JOLTED}"
        case Answer.NOT_TESTED:
            return f"not tested: {NEEDED}"


def _evidence(rigidity: Rigidity) -> list[str]:
    """Clauses on the tests that show that something moves."""
    found: list[str] = []
    if rigidity.energies.moves:
        edge = min(rigidity.energies.edges, key=lambda each: each.probability)
        found.append(
            f"over {edge.axis_id} φ changes by {np.degrees(edge.phi_change):+.2f}° and k by"
            f" {100 * math.expm1(edge.k_change):+.1f} % from energy ratio {edge.energy_ratios[0]:.2f} to"
            f" {edge.energy_ratios[-1]:.2f}"
        )
    if rigidity.poses.moves:
        shift = 1e3 * rigidity.poses.largest_shift
        found.append(f"the centre of mass moves by {shift:.1f} mm from pose to pose")
    return found


def _percent(share: float) -> str:
    """A share as a whole percentage, rounded up, so that no more is promised than was tested."""
    return f"{math.ceil(100 * share - 1e-9)} %"


def contents_document(contents: LooseContents, half_extent: float) -> ContentsResult:
    """Entry `contents` of the Result document: the answer, both tests, and the poses' centres of mass.

    Args:
        contents: tests of the struck body.
        half_extent: half the largest extent of the body [m], against which a pose's centre of mass counts as
            observed.
    """
    rigidity, settled = contents.rigidity, contents.settled
    energies, poses = rigidity.energies, rigidity.poses
    return ContentsResult(
        answer=ContentsAnswer(rigidity.answer.value),
        text=contents_text(contents, half_extent),
        detectable_share=rigidity.share if math.isfinite(rigidity.share) else None,
        energies=_test_document(energies.chi_squared, energies.freedom, energies.limit, moves=energies.moves),
        edges=[
            EdgeScatterResult(
                axis_id=edge.axis_id,
                strikes=list(edge.strike_ids),
                energy_ratios=list(edge.energy_ratios),
                phi_change_rad=edge.phi_change,
                k_change_relative=math.expm1(edge.k_change),
                chi_squared=edge.chi_squared,
                freedom=edge.freedom,
            )
            for edge in energies.edges
        ],
        poses_agree=_test_document(poses.chi_squared, poses.freedom, poses.limit, moves=poses.moves),
        pose_shift_m=poses.largest_shift,
        poses=[_pose_document(each, half_extent) for each in poses.centres],
        filled_share=None if settled is None else _quantity(settled.filled, "1"),
        mass=None if settled is None else _quantity(settled.mass, "kg"),
    )


def _test_document(chi_squared: float, freedom: int, limit: float, *, moves: bool) -> ContentsTest | None:
    """Entry of one test; None if the strikes allow none."""
    if freedom == 0:
        return None
    return ContentsTest(chi_squared=chi_squared, freedom=freedom, limit=limit, moves=moves)


def _pose_document(centre: PoseCentre, half_extent: float) -> PoseCentreResult:
    """Entry of one pose; its centre of mass is not observed if the strikes leave a direction of it open."""
    values, vectors = np.linalg.eigh(centre.covariance)
    observed = bool(values[-1] < (OPEN_SHARE * half_extent) ** 2)
    sd = np.sqrt(np.diag(centre.covariance))
    return PoseCentreResult(
        face=centre.face,
        up=centre.up.tolist(),
        centre_of_mass=Quantity(
            value=centre.position.tolist(),
            unit="m",
            sd=sd.tolist(),
            covariance=centre.covariance.tolist(),
            interval95=intervals95(centre.position, sd),
            frame="O",
            observed=observed,
            unobserved_direction=None if observed else vectors[:, -1].tolist(),
        ),
        residual_m=centre.residual,
    )


def _quantity(found: Marginal, unit: str) -> Quantity:
    """Posterior of one quantity in the Result's form: value, sd, 95 % interval, unit."""
    return Quantity(
        value=found.value,
        sd=found.sd,
        unit=unit,
        interval95=list(found.interval),
        observed=found.observed,
    )


def contents_lines(result: Result) -> list[str]:
    """Lines of text on contents that move; empty in results of an older version.

    A body that is not rigid is named in the verdict; here it has a line on the filled share of its container,
    if one is stated.
    """
    contents = result.contents
    if contents is None:
        return []
    if contents.answer is not ContentsAnswer.NOT_RIGID:
        return [f"Is it rigid? {contents.text}"]
    if contents.filled_share is None or contents.mass is None:
        return []
    share, mass = contents.filled_share, contents.mass
    level = f"{_interval_text(share, 100)} %, with {_interval_text(mass, 1e3)} g (95 %)"
    return [f"By the poses its container is filled to {level}"]


def _interval_text(found: Quantity, factor: float) -> str:
    low, high = found.interval_ends()
    return value_text(factor * found.as_scalar(), (factor * low, factor * high))


def pose_rows(result: Result) -> list[tuple[str, ...]]:
    """Rows of the table of poses of a body that is not rigid: face, x, y, z [mm] with 95 %, residual [mm].

    Empty if nothing was seen to move. A coordinate whose interval is wider than the body is "–".
    """
    contents = result.contents
    if contents is None or contents.answer is not ContentsAnswer.NOT_RIGID:
        return []
    rows: list[tuple[str, ...]] = []
    for pose in contents.poses:
        values = np.array(pose.centre_of_mass.value, dtype=np.float64)
        sds = np.array(pose.centre_of_mass.sd, dtype=np.float64)
        shown = [
            value_text(1e3 * value, (1e3 * (value - SIGMAS_95 * sd), 1e3 * (value + SIGMAS_95 * sd)))
            for value, sd in zip(values, sds, strict=True)
        ]
        rows.append((pose.face, *shown, f"{1e3 * pose.residual_m:.1f}"))
    return rows
