"""Names of an object's sides that a person can point at: by the tag on a side, else by an axis of O."""

from __future__ import annotations

import numpy as np

from analyze.types import Array
from schemas.object_spec import ObjectSpec

MAX_TAG_ANGLE = np.radians(15.0)
"""Largest angle [rad] between a side's direction and the normal of a tag that names the side."""


def side_name(spec: ObjectSpec, direction: Array) -> str:
    """Name of one side of the object: that of the tag on it, as "tag 3", else an axis, as "the +x side".

    A tag counts as on the side if its normal is within `MAX_TAG_ANGLE` of the direction; of several the
    nearest is taken.

    Args:
        spec: Object file, with the tags.
        direction: (3,) outward unit normal of the side, in the object frame.
    """
    best, least = None, MAX_TAG_ANGLE
    for marker in spec.marker:
        if marker.T_object_marker is None:
            continue
        angle = float(np.arccos(np.clip(np.array(marker.T_object_marker)[:3, 2] @ direction, -1, 1)))
        if angle < least - 1e-9:
            best, least = marker.name, angle
    return axis_name(direction) if best is None else f"tag {best}"


def axis_name(direction: Array) -> str:
    """Name of the side nearest to the unit `direction` (3,) in the object frame, such as "the +x side".

    All axes with a component above 0.5 are named, in the order x, y, z: "the +x/+y side".
    """
    order = np.argsort(-np.abs(direction))
    names = [f"{'+' if direction[i] > 0 else '−'}{'xyz'[i]}" for i in order if abs(direction[i]) > 0.5]
    return f"the {'/'.join(sorted(names, key=lambda name: name[1]))} side"
