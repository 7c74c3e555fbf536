"""Errors with a noisy scan in place of the shape, from the same strikes and angles (Fig. 10)."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import AnalyzeError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.pipeline.estimate import estimate_evidence
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.reproduce.paper.chain import paper_answers
from analyze.reproduce.paper.record import Sensitivity
from analyze.reproduce.paper.sensitivity import masses_error
from analyze.types import Array
from schemas.object_spec import Shape
from schemas.strike_plan import Pivot

if TYPE_CHECKING:
    from analyze.pipeline.evidence import Evidence
    from schemas.proto import percuss_pb2 as pb
    from schemas.strike_plan import PlannedStrike

LEVELS_M = (1e-4, 1e-3, 2e-3, 5e-3, 1e-2, 1.5e-2)
"""Largest shifts of a scanned point [m]."""
POINTS = 20_000
"""Number of points of a scan."""
SAME_EDGE_COSINE = np.cos(np.radians(15.0))
"""Least cosine, of both direction and face normal, for a scanned edge to count as the struck one."""


def errors_over_scan_noise(
    evidence: Evidence, body: pb.TruthBody, levels: Sequence[float], rng: np.random.Generator
) -> tuple[list[Sensitivity], list[Sensitivity]]:
    """Errors of c and of the region masses over the noise of a scan that replaces the shape.

    c is the centre of mass, the regions are shell, upper and lower interior part. Both errors are given for
    our method, and for the paper's method with our edges.

    Args:
        evidence: strikes of the session.
        body: ground truth.
        levels: largest shifts [m]; each point is moved by up to this distance in a random direction.
        rng: generator that draws points and shifts.

    Returns:
        Two lists with an entry per level: distance of c from the true one [m], and mean error of a region's
        mass over the total mass. A value is None if the scan cannot be used, or if it has the pivot edges of
        too few strikes. The paper's are None too if no strike has verdict "good" (tipped over without
        sliding, twisting or rolling), or its method finds no masses.
    """
    true = np.array(body.com_object)
    com, masses = [], []
    for level in levels:
        our_com = our_masses = paper_com = paper_masses = estimate = None
        with suppress(AnalyzeError):
            estimate = estimate_evidence(_scanned(evidence, level, rng))
        if estimate is not None:
            our_com = float(np.linalg.norm(estimate.com.position - true))
            our_masses = masses_error(estimate.distribution, body)
            for first in paper_answers(estimate)[:1]:
                paper_com = float(np.linalg.norm(first.com - true))
                paper_masses = None if first.regions is None else masses_error(first.regions, body)
        com.append(Sensitivity(level=level, ours=[our_com], paper=[paper_com]))
        masses.append(Sensitivity(level=level, ours=[our_masses], paper=[paper_masses]))
    return com, masses


def _scanned(evidence: Evidence, noise: float, rng: np.random.Generator) -> Evidence:
    """Evidence with a noisy scan as shape, and only the strikes whose edge the scan has.

    Evidence is the fitted motions of the strikes, with object and plan.

    Args:
        evidence: strikes of the session.
        noise: largest shift of a scanned point [m].
        rng: generator that draws points and shifts.

    Raises:
        AnalyzeError: the scan cannot be used.
    """
    points = noisy_cloud(evidence.model, noise, rng)
    text = "\n".join(" ".join(f"{value:.7f}" for value in point) for point in points)
    spec = evidence.spec.model_copy(update={"shape": Shape.model_validate({"file": "scan.xyz", "unit": "m"})})
    model = load_object_model(spec, text.encode(), "scan.xyz")
    axes = pivot_axes(model, spec, resting_planes(model), hypothesis(model))
    found = {strike.id: _on_scanned_edge(axes, strike) for strike in evidence.plan.strikes}
    kept = [strike for strike in found.values() if strike is not None]
    names = {strike.id for strike in kept}
    motions = tuple(motion for motion in evidence.motions if motion.plan_strike_id in names)
    return replace(
        evidence,
        spec=spec,
        model=model,
        plan=evidence.plan.model_copy(update={"strikes": kept}),
        motions=motions,
    )


def noisy_cloud(model: ObjectModel, noise: float, rng: np.random.Generator) -> Array:
    """Points (n, 3) [m] in O, drawn uniformly over the surface and moved at random; n is `POINTS`.

    O is the object frame. Each is moved by up to `noise` [m] in a random direction.
    """
    corners = model.vertices[model.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[rng.choice(len(corners), POINTS, p=area / area.sum())]
    u, v = np.sqrt(rng.uniform(size=POINTS))[:, None], rng.uniform(size=POINTS)[:, None]
    on_surface = chosen[:, 0] * (1 - u) + chosen[:, 1] * (u * (1 - v)) + chosen[:, 2] * (u * v)
    direction = rng.standard_normal((POINTS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return on_surface + direction * rng.uniform(0, noise, (POINTS, 1))


def _on_scanned_edge(axes: Sequence[PivotAxis], strike: PlannedStrike) -> PlannedStrike | None:
    """Planned strike with its pivot edge replaced by the corresponding edge of the scan.

    An edge corresponds if its direction and the normal of its resting face are within 15 degrees of the
    strike's; of several, the nearest is taken. None if the scan has no such edge.
    """
    R = np.array(strike.R_world_object)
    point = np.array(strike.pivot.point)
    alike = [axis for axis in axes if min(axis.direction @ R[1], axis.plane.up @ R[2]) > SAME_EDGE_COSINE]
    if not alike:
        return None

    def across(axis: PivotAxis) -> float:
        gap = axis.point - point
        return float(np.linalg.norm(gap - axis.direction * (gap @ axis.direction)))

    axis = min(alike, key=across)
    pivot = Pivot(
        point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
    )
    return strike.model_copy(
        update={
            "R_world_object": axis.R_world_object.tolist(),
            "p_world_object": axis.p_world_object.tolist(),
            "pivot": pivot,
        }
    )
