"""Tags of a user's object on the virtual rig: entries for a file without any, and places left out."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.tag_places import CARD_OVER_TAG, tag_places

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.tag_places import TagPlace
    from schemas.object_spec import MarkerSpec, ObjectSpec

_GLUED_SHIFT_M, _GLUED_TURN_RAD = 0.002, 0.1
"""largest shift and turn of a glued tag whose place the object file leaves open"""


def tag_entries(places: list[TagPlace]) -> str:
    """Entries [[marker]] of an object file (TOML text), one per place.

    If there is no place, it is one entry of a tag without a place.
    """
    if not places:
        return "\n[[marker]]\nid = 0\nsize_m = 0.03\n"
    lines = ["", "# Tags that the virtual rig glued on, because the file listed none."]
    for number, place in enumerate(places):
        rows = np.round(place.T_object_marker, 6) + 0.0
        lines += [
            "[[marker]]",
            f"id = {number}",
            f"size_m = {place.size_m:g}",
            f"T_object_marker = {json.dumps(rows.tolist())}",
        ]
    return "\n".join(lines) + "\n"


def with_places(
    spec: ObjectSpec, triangles: NDArray[np.float64], rng: np.random.Generator
) -> tuple[ObjectSpec, list[str]]:
    """Object file with a place for every tag: those without one are glued to free sides of the object.

    They are shifted by up to 2 mm and turned by up to 6 degrees, as by hand. A tag for which there is no room
    is left out; if no tag has a place in the end, all stay without one.

    Args:
        spec: content of the object file.
        triangles: (n, 3, 3) corners of the surface's triangles [m, in O, the object's frame].
        rng: generator of shift and turn.

    Returns:
        Content of the object file with places, and notes for the user.
    """
    placed = [marker for marker in spec.marker if marker.T_object_marker is not None]
    open_ones = [marker for marker in spec.marker if marker.T_object_marker is None]
    if not open_ones:
        return spec, []
    free = tag_places(triangles, max(marker.size_m for marker in open_ones))
    glued: list[MarkerSpec] = []
    for marker in sorted(open_ones, key=lambda one: -one.size_m):
        for place in free:
            if _is_free(place, marker, [*placed, *glued]):
                pose = _glued_by_hand(place.T_object_marker, rng)
                glued.append(marker.model_copy(update={"T_object_marker": pose.tolist()}))
                break
    notes: list[str] = []
    if glued:
        names = ", ".join(str(marker.name) for marker in sorted(glued, key=lambda one: one.id))
        notes.append(f"tags without a place in the file are glued on where the file does not know: {names}")
    if missing := {marker.name for marker in open_ones} - {marker.name for marker in glued}:
        notes.append(f"no flat place is left for tags {', '.join(sorted(map(str, missing)))}: left out")
    return spec.model_copy(update={"marker": [*placed, *glued] or spec.marker}), notes


def _is_free(place: TagPlace, marker: MarkerSpec, others: list[MarkerSpec]) -> bool:
    """True if a tag fits a place, and no other tag lies there."""
    gaps = [
        float(np.linalg.norm(place.T_object_marker[:3, 3] - np.array(other.T_object_marker)[:3, 3]))
        - CARD_OVER_TAG * (marker.size_m + other.size_m) / 2
        for other in others
    ]
    return marker.size_m <= place.size_m * 1.001 and min(gaps, default=1.0) > 0


def _glued_by_hand(T_object_marker: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Pose (4, 4) of a tag glued near `T_object_marker` (4, 4), shifted and turned within its plane."""
    slip = np.eye(4)
    slip[:3, :3] = Rotation.from_rotvec([0, 0, rng.uniform(-1, 1) * _GLUED_TURN_RAD]).as_matrix()
    slip[:2, 3] = rng.uniform(-1, 1, 2) * _GLUED_SHIFT_M
    return T_object_marker @ slip
