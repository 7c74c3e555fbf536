"""Tangents of round rims over which an object was tipped in other directions than plans use."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import plane_basis
from analyze.planning.pivots import PivotAxis, rim_tangent
from analyze.planning.stable_planes import RestingPlane
from analyze.types import Array
from schemas.object_spec import ObjectSpec

TANGENT_NAME = re.compile(r"(p\d+)t(\d{1,3})deg")
"""name of such a tangent: its face, and the direction of the tip in the face's plane in whole degrees"""


def tangent_in_degrees(
    model: ObjectModel, spec: ObjectSpec, plane: RestingPlane, tip: Array, beside: Array
) -> PivotAxis:
    """Pivot axis at a rim's tangent whose direction is a whole number of degrees, by which it is named.

    Args:
        model: Shape of the object.
        spec: Object file, with the edges' radii if they are known.
        plane: Face that the object rests on, whose outline has the rim.
        tip: (3,) direction of the tip, in the face's plane, in the object frame.
        beside: (3,) expected centre of mass [m], in the object frame.
    """
    u, v = plane_basis(plane.up)
    degrees = round(math.degrees(math.atan2(float(tip @ v), float(tip @ u)))) % 360
    ahead = math.cos(math.radians(degrees)) * u + math.sin(math.radians(degrees)) * v
    return rim_tangent(f"{plane.id}t{degrees}deg", model, spec, plane, ahead, beside)


def named_tangents(
    names: Iterable[str], model: ObjectModel, spec: ObjectSpec, planes: Sequence[RestingPlane], beside: Array
) -> list[PivotAxis]:
    """Pivot axes at the tangents that are among the names of axes, such as p0t143deg.

    Args:
        names: Names of axes, as of an earlier result.
        model: Shape of the object.
        spec: Object file, with the edges' radii if they are known.
        planes: Resting planes of the object.
        beside: (3,) expected centre of mass [m], in the object frame.
    """
    faces = {plane.id: plane for plane in planes}
    found: list[PivotAxis] = []
    for name in sorted(set(names)):
        parts = TANGENT_NAME.fullmatch(name)
        if parts is not None and parts[1] in faces:
            u, v = plane_basis(faces[parts[1]].up)
            angle = math.radians(int(parts[2]))
            tip = np.asarray(math.cos(angle) * u + math.sin(angle) * v, dtype=np.float64)
            found.append(tangent_in_degrees(model, spec, faces[parts[1]], tip, beside))
    return found
