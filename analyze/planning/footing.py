"""Faces to plan on: first those on which the object surely stands, then others on which it may.

On the others the object stands if its centre of mass is where it is expected; part of the region that is
believed to hold the centre of mass lies outside their support polygon (the convex outline of the contacts
with the table).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.object_model import ObjectModel
from analyze.planning.hypothesis import Region
from analyze.planning.stable_planes import RestingPlane

Q_SCALES = (1.0, 0.5, 0.0)
"""Scales of Q about its centre at which it must lie over a face; tried in order until a set of axes
determines c."""
STRIP_AREA_FRACTION = 0.02
"""Fraction of the hull's area below which an unsure face counts as a strip of a round or bevelled flank."""
FLANK_TURN = np.radians(25.0)
"""Largest angle [rad] between neighbouring facets of a round flank: of 16 sides or more."""
MAX_FACET_SHARE = 1 / 16
"""Fraction of the hull's area above which a face is no facet of a round flank."""
LEAST_NEIGHBOUR = 0.25
"""Area of a neighbour over that of a face below which it is a bevel or rounding of its edge, no facet.

The facets of a circle have equal areas, and neighbours on an oval of 16 sides, 0.4 times as
thick as wide, differ by a factor of 3 at most."""
OPPOSITE_COSINE = -np.cos(np.radians(20.0))
"""Largest cosine between the directions to the two neighbours of a facet of a round flank."""

IF_IT_FALLS = (
    "If it tips over by itself there, leave these strikes out: make the others, then plan again with --given "
    "RECORDING, from which the centre of mass is known better"
)
"""Remedy for an object that does not stay on a face where that was expected but not certain."""


def footing(
    model: ObjectModel, planes: Sequence[RestingPlane], region: Region, share: float
) -> tuple[RestingPlane, ...]:
    """Resting planes on which the object stands for a given share of the places of its centre of mass.

    Q is the region that is believed to hold the centre of mass. A plane is returned if its support polygon
    holds the projection of Q scaled by `share` about Q's centre; a share of 1 stands for all of Q (method
    1.2). For a smaller share, planes that hold only part of Q are left out if they are facets (flat sides of
    the mesh) of round flanks, on which the object rolls, or have less than `STRIP_AREA_FRACTION` of the
    hull's area. The order is that of `planes`.

    Args:
        model: Shape of the object.
        planes: Resting planes of the object.
        region: Region Q of the centre of mass.
        share: Scale of Q about its centre.
    """
    area = float(ConvexHull(model.hull_vertices).area)
    return tuple(
        plane
        for plane in planes
        if plane.firmness(region) > 1
        or (
            plane.firmness(region) > share
            and plane.area >= STRIP_AREA_FRACTION * area
            and (plane.area > MAX_FACET_SHARE * area or not _is_round_flank(plane, planes))
        )
    )


def unsure_note(used: Sequence[RestingPlane], unsure: frozenset[str], region: Region) -> str:
    """Warning with remedy that a plan uses faces on which the object may not stay; empty if none.

    Such a face holds the expected centre of mass over it, but not the whole region Q that is believed to hold
    the centre of mass. The text names each with the distances [mm] of the two from its edges.

    Args:
        used: Resting planes of the plan's strikes.
        unsure: Ids of the faces that hold the expected centre of mass, but not all of Q.
        region: Region Q of the centre of mass.
    """
    faces = sorted({plane.id: plane for plane in used if plane.id in unsure}.items())
    if not faces:
        return ""
    listed = ", ".join(
        f"{name} ({1000 * plane.margin(region.centre[None])[0]:.1f} mm inside an edge, up to "
        f"{-1000 * plane.margin_of(region):.1f} mm outside)"
        for name, plane in faces
    )
    return (
        "the faces on which the object surely stands do not suffice to determine the centre of mass: the "
        "plan also uses faces on which it stands if its centre of mass is where it is expected: "
        f"{listed}. {IF_IT_FALLS}"
    )


def _is_round_flank(plane: RestingPlane, planes: Sequence[RestingPlane]) -> bool:
    """True if a face is one of the many flat sides (facets) by which a mesh has a round flank.

    It then has neighbours of some size (`LEAST_NEIGHBOUR`) at angles below `FLANK_TURN` on two opposite
    sides.

    Args:
        plane: Face to judge.
        planes: All resting planes of the object.
    """
    large = [other.up for other in planes if other is not plane and other.area > LEAST_NEIGHBOUR * plane.area]
    ups = np.array(large).reshape(-1, 3)
    along = ups @ plane.up
    near = ups[along > np.cos(FLANK_TURN)]
    aside = near - np.outer(near @ plane.up, plane.up)
    length = np.linalg.norm(aside, axis=1, keepdims=True)
    aside = aside[length[:, 0] > 0] / length[length[:, 0] > 0]
    return len(aside) > 1 and float(np.min(aside @ aside.T)) < OPPOSITE_COSINE
