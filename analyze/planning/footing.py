"""Faces to plan on: where the object surely stands; where those give no set of strikes, also where it stands if c is as expected."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.object_model import ObjectModel
from analyze.planning.hypothesis import Region
from analyze.planning.stable_planes import RestingPlane

SHARES = (1.0, 0.5, 0.0)
"""parts of Q, about its centre, that a face must hold; tried in this order, until the faces give a set that determines c"""
STRIP = 0.02
"""part of the hull's area below which a face that does not surely hold c is a strip of a round or bevelled flank"""
FLANK_TURN = np.radians(25.0)
"""between neighbouring facets of something round: of 16 sides or more"""
OPPOSITE = -np.cos(np.radians(20.0))
"""cosine between the sides on which a facet of something round has its two neighbours, or less"""


WHERE_IT_FALLS = (
    "If it tips over by itself there, leave these strikes out: make the others, and plan on with --given RECORDING, which knows better "
    "where it stands"
)


def footing(model: ObjectModel, planes: Sequence[RestingPlane], region: Region, share: float) -> tuple[RestingPlane, ...]:
    """Those of `planes` over whose support lies at least this part of Q, in their order.

    A share of 1 is what `stable_planes` gives. With less, facets of something round are left out: they hold c on the drawing board only.
    """
    sure = [plane.firmness(region) > 1 for plane in planes]
    if share >= 1:
        return tuple(plane for plane, stands in zip(planes, sure, strict=True) if stands)
    least = STRIP * float(ConvexHull(model.hull_vertices).area)
    return tuple(
        plane
        for plane, stands in zip(planes, sure, strict=True)
        if stands or (plane.firmness(region) > share and plane.area >= least and not _round(plane, planes))
    )


def unsure_note(used: Sequence[RestingPlane], unsure: frozenset[str], region: Region) -> str:
    """What a plan on faces that may not hold c rests on, and what to do where it is wrong; empty: it stands surely on all of them."""
    faces = sorted({plane.id: plane for plane in used if plane.id in unsure}.items())
    if not faces:
        return ""
    told = ", ".join(
        f"{name} ({1000 * plane.margin(region.centre[None]):.1f} mm inside an edge, up to {-1000 * plane.margin_of(region):.1f} mm outside)"
        for name, plane in faces
    )
    return (
        "edges of faces on which the object surely stands do not determine the centre of mass: the plan also uses faces that hold it where "
        f"it is expected: {told}. {WHERE_IT_FALLS}"
    )


def _round(plane: RestingPlane, planes: Sequence[RestingPlane]) -> bool:
    """Whether it has neighbours on two opposite sides that turn by little, as facets of a round flank do."""
    ups = np.array([other.up for other in planes if other is not plane])
    along = ups @ plane.up
    near = ups[along > np.cos(FLANK_TURN)]
    aside = near - np.outer(near @ plane.up, plane.up)
    length = np.linalg.norm(aside, axis=1, keepdims=True)
    aside = aside[length[:, 0] > 0] / length[length[:, 0] > 0]
    return len(aside) > 1 and float(np.min(aside @ aside.T)) < OPPOSITE
