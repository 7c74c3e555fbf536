"""What it tells of a marker's place that it lies on the body's surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.types import Array

CARD_SD, CARD_TILT_SD = 1e-4, math.radians(0.2)
"""m, rad: how far off a flat surface a tag may be, beyond its stated thickness: glue, paper that does not lie flat"""
FLAT_HEIGHT, FLAT_TURN = 1e-4, math.radians(1.0)
"""m, rad: by which the surface under a tag's corners may differ from its middle to be called flat"""
LIES_ON = math.radians(15.0)
"""between a marker's normal and the surface's, up to which it is taken to lie on it"""
NEAR_SURFACE = 0.02
"""m, for the same: along its normal a start is known no better than a hand places"""


@dataclass(frozen=True)
class Lying:
    """How well it is known that a marker lies on the surface."""

    thickness: float
    """m, its centre's height over the surface"""
    height_sd: float
    """m"""
    tilt_sd: float
    """rad, of its normal against the surface's; inf where the surface is not flat under it"""


@dataclass(frozen=True)
class Surface:
    """The body's exterior, and which markers lie on it."""

    height: Callable[[Array], tuple[float, Array]]
    """of a point in O: height over the surface [m], and the outward normal (3,)"""
    lying: Mapping[int | str, Lying]
    """one that is missing is not held to the surface"""


def height_over(model: ObjectModel, point: Array) -> tuple[float, Array]:
    """Height over the surface [m], and the outward normal."""
    depth = model.depth_and_gradient(point)
    return -float(depth.value[0]), -depth.gradient[0]


def surface_under(
    model: ObjectModel, start: Mapping[int | str, Array], sizes: Mapping[int | str, float], thickness: Mapping[int | str, float]
) -> Surface:
    """Which markers lie on the surface, as far as `start` can tell."""
    unsure = model.surface_sd if model.cloud is None else math.hypot(model.surface_sd, model.cloud.smooth_sd)
    lying: dict[int | str, Lying] = {}
    for name, T in start.items():
        height, normal = height_over(model, T[:3, 3])
        if float(normal @ T[:3, 2]) > math.cos(LIES_ON) and abs(height) < NEAR_SURFACE:
            flat = _flat_under(model, T, sizes[name], height, normal)
            lying[name] = Lying(thickness.get(name, 0.0), math.hypot(CARD_SD, unsure), CARD_TILT_SD if flat else math.inf)
    return Surface(lambda point: height_over(model, point), lying)


def _flat_under(model: ObjectModel, T: Array, size: float, height: float, normal: Array) -> bool:
    """Whether the surface under the whole tag is one plane."""
    corners = T[:3, 3] + 0.5 * size * np.array([sx * T[:3, 0] + sy * T[:3, 1] for sx in (-1, 1) for sy in (-1, 1)])
    for corner in corners:
        # Beside the tag's own tilt, which is what is asked.
        on_plane = corner - normal * float(normal @ (corner - T[:3, 3]))
        above, other = height_over(model, on_plane)
        if abs(above - height) > FLAT_HEIGHT or float(other @ normal) < math.cos(FLAT_TURN):
            return False
    return True
