"""Constraint on a marker's pose by the body's surface on which the marker lies."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.types import Array

CARD_HEIGHT_SD, CARD_TILT_SD = 1e-4, math.radians(0.2)
"""standard deviations of a tag's height [m], beyond its stated thickness, and of its tilt [rad] on a flat
surface: glue, uneven paper"""
MAX_FLAT_HEIGHT, MAX_FLAT_TURN = 1e-4, math.radians(1.0)
"""largest differences [m, rad] between the surface under a tag's corners and under its middle, if it is
flat"""
MAX_TILT_ON_SURFACE = math.radians(15.0)
"""largest angle [rad] between the normals of a marker that lies on the surface and of the surface"""
MAX_HEIGHT_ON_SURFACE = 0.02
"""largest first estimate of the distance from the surface [m] of a marker that lies on it; along the normal
it is as inaccurate as a placement by hand"""


@dataclass(frozen=True)
class SurfaceFit:
    """Prior that ties a marker to the body's surface: height of its centre over it, with sds.

    The height [m] is the one stated; its sd [m] and that of the marker's tilt against the surface [rad] say
    how firmly the marker is tied.
    """

    thickness: float
    """height of its centre over the surface [m]"""
    height_sd: float
    """standard deviation of that height [m]"""
    tilt_sd: float
    """standard deviation of its normal against the surface's [rad]; infinite where the surface is not flat
    under it"""


@dataclass(frozen=True)
class Surface:
    """The body's surface, and the markers that are constrained to lie on it.

    The surface is a function that gives a point's height over it [m] and the outward normal there, in the
    object frame O.
    """

    height: Callable[[Array], tuple[float, Array]]
    """height over the surface [m] and outward normal (3,), of a point in O (3,) [m]"""
    fits: Mapping[int | str, SurfaceFit]
    """by marker id, for the markers that are constrained to the surface"""


def height_over(model: ObjectModel, point: Array) -> tuple[float, Array]:
    """Height [m] of a point over the body's surface, and the outward normal (3,) of the surface there.

    The height is negative inside the body.

    Args:
        model: the object's exterior.
        point: (3,) point in the object frame O [m].
    """
    depth = model.depth_and_gradient(point)
    return -float(depth.value[0]), -depth.gradient[0]


def surface_under(
    model: ObjectModel,
    start: Mapping[int | str, Array],
    sizes: Mapping[int | str, float],
    thickness: Mapping[int | str, float],
    standing_off: Collection[int | str] = (),
) -> Surface:
    """Surface of the body, and the markers that a fit of marker poses holds to it.

    A marker is held to it if, by its first pose, its middle is within 20 mm of the surface and its normal
    within 15 deg of the surface's.

    Args:
        model: the object's exterior.
        start: first pose T_object_marker (4, 4) in the object frame per marker.
        sizes: edge of each marker's black square [m].
        thickness: thickness of each marker's card [m]; 0 for a marker that it does not name.
        standing_off: markers that are not held to it, as they were seen at another height.

    Returns:
        Height over the surface as a function of the point; and, for each marker held to the surface, its
        stated height with the standard deviations of height and tilt.
    """
    surface_sd = (
        model.surface_sd if model.cloud is None else math.hypot(model.surface_sd, model.cloud.smooth_sd)
    )
    fits: dict[int | str, SurfaceFit] = {}
    for name, T in start.items():
        height, normal = height_over(model, T[:3, 3])
        if name in standing_off:
            continue
        if float(normal @ T[:3, 2]) > math.cos(MAX_TILT_ON_SURFACE) and abs(height) < MAX_HEIGHT_ON_SURFACE:
            flat = _flat_under(model, T, sizes[name], height, normal)
            fits[name] = SurfaceFit(
                thickness.get(name, 0.0),
                math.hypot(CARD_HEIGHT_SD, surface_sd),
                CARD_TILT_SD if flat else math.inf,
            )
    return Surface(lambda point: height_over(model, point), fits)


def _flat_under(model: ObjectModel, T: Array, size: float, height: float, normal: Array) -> bool:
    """True if the surface under the whole tag is one plane, to within 0.1 mm and 1 deg.

    Args:
        model: the object's exterior.
        T: (4, 4) pose of the tag in the object frame O.
        size: edge of the tag's black square [m].
        height: height of the tag's middle over the surface [m].
        normal: (3,) outward normal of the surface there, in O.
    """
    corners = T[:3, 3] + 0.5 * size * np.array(
        [sx * T[:3, 0] + sy * T[:3, 1] for sx in (-1, 1) for sy in (-1, 1)]
    )
    for corner in corners:
        # The corner is moved onto the tangent plane: the tag's own tilt is unknown.
        on_plane = corner - normal * float(normal @ (corner - T[:3, 3]))
        above, other = height_over(model, on_plane)
        if abs(above - height) > MAX_FLAT_HEIGHT or float(other @ normal) < math.cos(MAX_FLAT_TURN):
            return False
    return True
