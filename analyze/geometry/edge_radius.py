"""Radius of the rounding of an object's edges before any strike: stated, seen on a scan, or not given."""

from __future__ import annotations

import math

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.types import Array, RadiusPrior, RadiusSource
from schemas.object_spec import ObjectSpec

MAX_ASSUMED_RADIUS = 1.5e-3
"""Largest radius [m] of an edge where none is given: up to it all radii count as equally likely."""
FACE_OVER_OWN = 2.0
"""1 sigma of the deviation that the edges of one resting face share, over each edge's own.

A mould, a cut or a fold makes the edges round one face alike, and those of another face unlike them. Strikes
over many edges average out each one's own deviation, but not that of a face.
"""
ASSUMED = RadiusPrior(
    MAX_ASSUMED_RADIUS / 2,
    MAX_ASSUMED_RADIUS / math.sqrt(24),
    MAX_ASSUMED_RADIUS / math.sqrt(24),
    RadiusSource.ASSUMED,
    FACE_OVER_OWN * MAX_ASSUMED_RADIUS / math.sqrt(24),
)
"""Radius where none is given: mean of the uniform distribution, and three deviations.

The part that all edges share and each edge's own have the distribution's variance together. The part of a
face has the variance of the difference of two such radii, so that two faces may have edges of 0.3 and 2 mm.
"""
MAX_SCANNED_SD = MAX_ASSUMED_RADIUS / math.sqrt(12)
"""1 sigma of a radius seen on a scan [m] above which it is not used."""
OWN_FRACTION = 0.32
"""Least 1 sigma of one edge's radius about the mean of its face, and of that mean about all edges', over the
stated 1 sigma."""
STATED_SD, STATED_SD_FRACTION = 1e-4, 0.2
"""1 sigma [m] of a stated radius without one: the first, plus this fraction of the radius. A gauge in steps
of 0.25 mm, or a photograph beside a ruler, is no better."""
PARALLEL_COSINE = 0.99
"""Cosine of the angle between two edges above which they are one."""
CONTRADICTION_SDS = 3.0
"""Radius on the scan above the stated one, in 1 sigma of the difference, from which only the scan counts."""
LARGER_SDS = 1.0
"""Stated radius above that on the scan, in 1 sigma of the difference, from which the statement stands."""


def stated_radius(spec: ObjectSpec) -> RadiusPrior:
    """Radius of all edges for which the object file has no entry: the stated one, or else `ASSUMED`.

    It comes as mean [m], origin, and sds [m] of three errors: one that all edges share, one that the edges of
    a face share, and each edge's own. A radius of 0 with an sd of 0
    counts as not given: recordings made before a radius could be left open hold these figures where the
    object file had none.
    """
    radius, sd = spec.edge_radius_m, spec.edge_radius_sd_m
    if radius is None or (radius == 0 and sd == 0):
        return ASSUMED
    common = sd or default_radius_sd(radius)
    own, face = _deviation_sds(radius, common)
    return RadiusPrior(radius, common, own, RadiusSource.STATED, face)


def _deviation_sds(radius: float, sd: float) -> tuple[float, float]:
    """1 sigma [m] of an edge's radius about the mean of its face, and of that mean about all edges'.

    `radius` ± `sd` [m] is stated. A single radius can be measured to `default_radius_sd`. What a stated sd
    has beyond that comes from edges that differ, as those of an object with edges of 0.3 and of 2 mm: half of
    its variance is each edge's own, and a face's deviation is `FACE_OVER_OWN` times as large. Without such an
    excess the edges are alike. Both results are at least `OWN_FRACTION` of `sd`.
    """
    spread = math.sqrt(max(sd**2 - default_radius_sd(radius) ** 2, 0.0) / 2)
    return max(OWN_FRACTION * sd, spread), max(OWN_FRACTION * sd, FACE_OVER_OWN * spread)


def default_radius_sd(radius: float) -> float:
    """Standard deviation [m] of a radius [m] stated without one: 0.1 mm plus a fifth of the radius."""
    return STATED_SD + STATED_SD_FRACTION * radius


def edge_radius(
    spec: ObjectSpec, model: ObjectModel, axis_id: str, point: Array, direction: Array
) -> RadiusPrior:
    """Radius of one edge's rounding before any strike: mean [m], sds of its errors [m], and origin.

    It is the first of these that exists: the entry for this edge in the object file; the rounding that a
    point cloud shows there, if its sd is at most `MAX_SCANNED_SD`; the object file's radius for all edges;
    what a scanned mesh leaves open (`scanned_radius`); `ASSUMED`. The object file's radius for all edges
    replaces the cloud's if it is surer, and the cloud's is not larger by `CONTRADICTION_SDS` sd of the
    difference; or if it is larger than the cloud's by more than `LARGER_SDS` sd, as clouds made from a
    drawing show sharp edges.

    Args:
        spec: object file.
        model: shape of the object.
        axis_id: name of the edge in the plan; in merged plans the recording's number may precede it.
        point: (3,) point [m] of the sharp edge in which the faces would meet, in the object frame.
        direction: (3,) unit direction of the edge, of either sign, in the object frame.
    """
    own_id = axis_id.rpartition(":")[2]
    for entry in spec.edge or []:
        if entry.id == own_id:
            sd = entry.radius_sd_m or default_radius_sd(entry.radius_m)
            return RadiusPrior(entry.radius_m, 0.0, sd, RadiusSource.EDGE)
    stated, seen = stated_radius(spec), scanned_radius(model, point, direction)
    if seen is None:
        return stated
    if stated.source is RadiusSource.ASSUMED:
        return seen
    if seen.source is RadiusSource.BLURRED:
        return stated
    apart = (seen.mean - stated.mean) / math.hypot(seen.sd, stated.sd)
    surer = stated.sd < seen.sd and apart < CONTRADICTION_SDS
    return stated if surer or apart < -LARGER_SDS else seen


def scanned_radius(model: ObjectModel, point: Array, direction: Array) -> RadiusPrior | None:
    """Radius of an edge's rounding by a scan: mean and sd [m]; None if it shows none.

    A mesh made of a scan is smoother than the object: its edge may have any radius from 0 to the one seen. An
    edge where no rounding was seen, as beside a curved face, has the median one of the mesh.

    Args:
        model: shape of the object; only one made from a point cloud or a scanned mesh shows a rounding.
        point: (3,) point [m] of the sharp edge in which the faces would meet, in the object frame.
        direction: (3,) unit direction of the edge, of either sign, in the object frame.
    """
    if model.cloud is None:
        return None
    near = [
        (each.distance(point), number)
        for number, each in enumerate(model.cloud.roundings)
        if each.distance(point) < each.reach and abs(float(each.direction @ direction)) > PARALLEL_COSINE
    ]
    best = model.cloud.roundings[min(near)[1]] if near else None
    if model.cloud.meshed and model.cloud.roundings:
        # The meshing that rounded the edges between flat faces rounded the others too.
        typical = float(np.median([each.radius for each in model.cloud.roundings]))
        return blurred_radius(typical if best is None else best.radius)
    if best is None or best.sd > MAX_SCANNED_SD:
        return None
    return RadiusPrior(best.radius, 0.0, best.sd, RadiusSource.SCAN)


def blurred_radius(seen: float) -> RadiusPrior:
    """Radius of an edge that a scan shows with the radius `seen` [m], of which the meshing made a part.

    All radii from 0 to `seen` count as equally likely; a smaller one than `MAX_ASSUMED_RADIUS` shows nothing.
    Half of the variance is common to all edges, as the meshing rounds all alike.
    """
    largest = max(seen, MAX_ASSUMED_RADIUS)
    half = largest / math.sqrt(24)
    return RadiusPrior(largest / 2, half, half, RadiusSource.BLURRED, ASSUMED.face_sd)
