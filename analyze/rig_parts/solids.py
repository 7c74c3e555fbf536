"""Simple solids [mm] from which the parts of a rig are built, and the part with its dimensions."""

# manifold3d is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass

import manifold3d

from analyze.fixture.solid import Mesh, printed_surface

SEGMENTS = 96
"""Corners of a circle."""
BEYOND = 1.0
"""Length by which a cut reaches beyond the part [mm]."""

Solid = manifold3d.Manifold


@dataclass(frozen=True)
class Dimension:
    """Length that a drawing shows, from one point to another in a view of the part [mm]."""

    view: str
    """View: top (x right, y up) or front (x right, z up)."""
    start: tuple[float, float]
    """Point at which the length begins, in the view's coordinates [mm]."""
    end: tuple[float, float]
    """Point at which it ends [mm]."""
    offset: float
    """Distance of the dimension line from the points, to the left of the way from start to end [mm]."""
    text: str = ""
    """Text in place of the length."""


@dataclass(frozen=True)
class RigPart:
    """Printable part as it lies on the printer's bed, with what its drawing shows."""

    name: str
    """Name, also that of its files."""
    purpose: str
    """Use of the part, in a noun phrase."""
    mesh: Mesh
    """Surface [mm]; the bottom is at z = 0."""
    dimensions: tuple[Dimension, ...]
    """Lengths that the drawing shows."""
    fasteners: str
    """Screws, nuts and other bought parts that it takes."""
    count: int = 1
    """Number of copies to print."""


def slab(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Solid:
    """Cuboid between the corners (x0, y0, z0) and (x1, y1, z1) [mm]."""
    return Solid.cube((x1 - x0, y1 - y0, z1 - z0)).translate((x0, y0, z0))


def disc(diameter: float, z0: float, z1: float, x: float = 0.0, y: float = 0.0) -> Solid:
    """Cylinder along z between two heights, with its axis through (x, y) [mm]."""
    return Solid.cylinder(z1 - z0, diameter / 2, -1.0, SEGMENTS).translate((x, y, z0))


def cone(low: float, high: float, z0: float, z1: float, x: float = 0.0, y: float = 0.0) -> Solid:
    """Frustum along z: diameter `low` at the height z0, `high` at z1, axis through (x, y) [mm]."""
    return Solid.cylinder(z1 - z0, low / 2, high / 2, SEGMENTS).translate((x, y, z0))


def bore_y(diameter: float, x: float, z: float, y0: float, y1: float) -> Solid:
    """Cylinder along y from y0 to y1, with its axis through (x, z) [mm]."""
    return (
        Solid.cylinder(y1 - y0, diameter / 2, -1.0, SEGMENTS).rotate((-90.0, 0.0, 0.0)).translate((x, y0, z))
    )


def bore_x(diameter: float, y: float, z: float, x0: float, x1: float) -> Solid:
    """Cylinder along x from x0 to x1, with its axis through (y, z) [mm]."""
    return (
        Solid.cylinder(x1 - x0, diameter / 2, -1.0, SEGMENTS).rotate((0.0, 90.0, 0.0)).translate((x0, y, z))
    )


def hexagon(across_flats: float, z0: float, z1: float, x: float = 0.0, y: float = 0.0) -> Solid:
    """Hexagonal prism along z, of the given width across flats, with its axis through (x, y) [mm]."""
    radius = across_flats / math.sqrt(3)
    return Solid.cylinder(z1 - z0, radius, -1.0, 6).translate((x, y, z0))


def slot(width: float, length: float, z0: float, z1: float, x: float, y: float) -> Solid:
    """Slot along x with round ends, through the heights z0 to z1, its middle at (x, y) [mm].

    Args:
        width: Width, which is the diameter of the ends.
        length: Distance of the ends' middles.
        z0: Lower height.
        z1: Upper height.
        x: Middle along x.
        y: Middle along y.
    """
    left, right = (disc(width, z0, z1, x + side * length / 2, y) for side in (-1, 1))
    return Solid.batch_hull([left, right])


def rounded(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float, radius: float) -> Solid:
    """Cuboid between two corners whose edges along z are rounded with a radius [mm]."""
    corners = [
        disc(2 * radius, z0, z1, x, y) for x in (x0 + radius, x1 - radius) for y in (y0 + radius, y1 - radius)
    ]
    return Solid.batch_hull(corners)


def circle_of(count: int, diameter: float, first_deg: float = 45.0) -> list[tuple[float, float]]:
    """Points (x, y) [mm] at equal angles on a circle about the origin.

    Args:
        count: Number of points.
        diameter: Diameter of the circle [mm].
        first_deg: Angle of the first point [deg].
    """
    angles = [math.radians(first_deg + 360 * i / count) for i in range(count)]
    return [(diameter / 2 * math.cos(angle), diameter / 2 * math.sin(angle)) for angle in angles]


def cut(body: Solid, *holes: Solid) -> Mesh:
    """Surface [mm] of a body without the holes, as it is written to files."""
    return printed_surface(body - Solid.batch_boolean(list(holes), manifold3d.OpType.Add))
