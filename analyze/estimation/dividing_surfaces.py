"""Planes and balls that divide a body's interior in two, and the kinds of body that they make.

A surface is a row of five numbers (n, h, k): the points x, relative to the body's middle, with n.x - h -
k |x|^2 / 2 = 0. That is a plane if k = 0, else a sphere of radius 1/k about n/k. The upper part of the
interior is where the expression is positive: on the side of a plane's unit normal n, or inside the ball.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from analyze.types import Array


class Kind(Enum):
    """Kind of body: how its interior is divided into two uniform parts."""

    TWO_PARTS = "two parts"
    """On either side of a plane."""
    LUMP = "lump"
    """Inside and outside of a ball."""
    LONE_LUMP = "lone lump"
    """Inside and outside of a ball, with nothing outside."""


def planes(normals: Array, heights: Array) -> Array:
    """Planes with unit normals (b, 3) and heights (b,) [m] over the body's middle, as surfaces (b, 5).

    A row of the result holds the normal (3), the height, and 0.
    """
    return np.column_stack([normals, heights, np.zeros(len(heights))])


def balls(centres: Array, radii: Array) -> Array:
    """Balls with centres (b, 3) [m] from the body's middle, and radii (b,) [m], as surfaces (b, 5).

    A row of the result holds n = c / r (3), h = (|c|^2 / r - r) / 2 [m] and k = 1 / r [1/m], for centre c and
    radius r: inside the ball n.x - h - k |x|^2 / 2 is positive, x being counted from the body's middle.
    """
    return np.column_stack(
        [centres / radii[:, None], (np.sum(centres**2, axis=1) / radii - radii) / 2, 1 / radii]
    )


def are_balls(surfaces: Array) -> NDArray[np.bool_]:
    """True (b,) for those of b surfaces that bound a ball, False for planes.

    The last number of a row of `surfaces` (b, 5) is the reciprocal radius [1/m], 0 for a plane.
    """
    return surfaces[:, 4] > 0


def oriented(surfaces: Array, towards: Array) -> Array:
    """Copy of `surfaces` (b, 5), with the normals of all planes on the side of `towards` (3,).

    A plane's row holds its unit normal (3), its height [m] and 0. A plane whose normal points to the other
    side has the signs of normal and height reversed, and so stays in place. Balls stay as they are.
    """
    turned = ~are_balls(surfaces) & (surfaces[:, :3] @ towards < 0)
    return np.where(turned[:, None], -surfaces, surfaces)
