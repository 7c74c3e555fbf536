"""Building blocks of world shapes: watertight solids in millimetres, z up, from outlines and profiles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, Manifold, Mesh
from numpy.typing import NDArray

Array = NDArray[np.float64]
Points = Sequence[Sequence[float]]
SEGMENTS = 96
"""segments of a full circle of lathed solids, as a CAD program writes them at 0.05 mm"""


def box(x: float, y: float, z: float, at: Sequence[float] = (0, 0, 0)) -> Manifold:
    """Sharp box with edges x, y, z whose base is centred on `at`."""
    return Manifold.cube((x, y, z), True).translate((at[0], at[1], at[2] + z / 2))


def rounded_box(x: float, y: float, z: float, radius: float, at: Sequence[float] = (0, 0, 0)) -> Manifold:
    """Box with edges x, y, z, all rounded alike, whose base is centred on `at`."""
    ball = Manifold.sphere(radius, 24)
    corners = [
        ball.translate((a * (x / 2 - radius), b * (y / 2 - radius), radius + c * (z - 2 * radius)))
        for a in (-1, 1)
        for b in (-1, 1)
        for c in (0, 1)
    ]
    return Manifold.batch_hull(corners).translate(tuple(at))


def cylinder(radius: float, height: float, at: Sequence[float] = (0, 0, 0), top: float = -1.0) -> Manifold:
    """Upright cylinder, or cone with another radius at the top, whose base is centred on `at`."""
    return Manifold.cylinder(height, radius, top, SEGMENTS).translate(tuple(at))


def ball(radius: float, at: Sequence[float], scale: Sequence[float] = (1, 1, 1)) -> Manifold:
    """Sphere, or ellipsoid with `scale`, about `at`."""
    return Manifold.sphere(radius, 64).scale(tuple(scale)).translate(tuple(at))


def lathe(profile: Points, radius: float = 0.0, segments: int = SEGMENTS) -> Manifold:
    """Solid of revolution about z.

    Args:
        profile: corners (r, z) of half the cross-section; its ends are joined along the axis.
        radius: rounding of the corners that are off the axis.
        segments: number of segments of a full circle.
    """
    outline = filleted(profile, radius) if radius else np.array(profile, float)
    section = CrossSection([outline])
    if section.area() < 0 or section.is_empty():
        section = CrossSection([outline[::-1]])
    return section.revolve(segments)


def filleted(corners: Points, radius: float, steps: int = 5) -> Array:
    """Closed polygon (n, 2) with rounded corners; corners on the axis r = 0 stay sharp.

    Args:
        corners: corners of the polygon.
        radius: radius of the roundings; less at corners with short sides.
        steps: segments per rounding.
    """
    points = np.array(corners, float)
    result: list[Array] = []
    for i, corner in enumerate(points):
        before, after = points[i - 1] - corner, points[(i + 1) % len(points)] - corner
        lengths = np.linalg.norm(before), np.linalg.norm(after)
        a, b = before / lengths[0], after / lengths[1]
        half = np.arccos(np.clip(a @ b, -1, 1)) / 2
        if corner[0] < 1e-9 or half > 1.5 or half < 0.02:
            result.append(corner)
            continue
        reach = min(radius / np.tan(half), 0.45 * min(lengths))
        centre = corner + (a + b) / np.linalg.norm(a + b) * reach / np.cos(half)
        start, end = corner + a * reach - centre, corner + b * reach - centre
        turn = np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end)
        for angle in np.linspace(0, turn, steps + 1):
            c, s = np.cos(angle), np.sin(angle)
            result.append(centre + np.array([c * start[0] - s * start[1], s * start[0] + c * start[1]]))
    return np.array(result)


def superellipse(a: float, b: float, power: float = 2.0, count: int = 96) -> Array:
    """Outline (count, 2) with half axes a and b: `power` 2 is an ellipse, 4 a box with soft corners."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack(
        [a * np.sign(c) * np.abs(c) ** (2 / power), b * np.sign(s) * np.abs(s) ** (2 / power)]
    )


def rounded_rectangle(x: float, y: float, radius: float, steps: int = 8) -> Array:
    """Outline (n, 2) of a rectangle with edges x and y and rounded corners, centred on the origin."""
    corners = [(x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2), (-x / 2, -y / 2)]
    signs = [(1, -1), (1, 1), (-1, 1), (-1, -1)]
    result = []
    for (cx, cy), (sx, sy), start in zip(corners, signs, (-np.pi / 2, 0, np.pi / 2, np.pi), strict=True):
        angle = start + np.linspace(0, np.pi / 2, steps + 1)
        centre = (cx - sx * radius, cy - sy * radius)
        result.append(
            np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)])
        )
    return np.vstack(result)


def prism(outline: Points | Array, height: float, radius: float = 0.0) -> Manifold:
    """Upright prism over an outline from z = 0, its corners rounded in plan if a radius is given."""
    section = CrossSection([filleted(outline, radius) if radius else np.array(outline, float)])
    if section.is_empty():
        section = CrossSection([np.array(outline, float)[::-1]])
    return section.extrude(height)


def chamfered(outline: Points | Array, height: float, bevel: float) -> Manifold:
    """Upright convex prism over an outline from z = 0; its edges at base and top are rounded by `bevel`."""
    section = CrossSection([np.array(outline, float)])
    rise = bevel * (1 - np.cos(np.linspace(0, np.pi / 2, 5)))
    inset = bevel * (1 - np.sin(np.linspace(0, np.pi / 2, 5)))
    slices = []
    for up, less in zip(rise, inset, strict=True):
        ring = section.offset(-less, circular_segments=48) if less > 1e-9 else section
        points = np.vstack(ring.to_polygons())
        slices += [np.column_stack([points, np.full(len(points), z)]) for z in (up, height - up)]
    return Manifold.hull_points(np.vstack(slices))


def loft(sections: Sequence[tuple[float, Array]]) -> Manifold:
    """Solid through outlines of equally many points at rising heights, closed flat at both ends.

    Args:
        sections: height z and outline (n, 2) of each section, the outlines running counter-clockwise.
    """
    return tube([np.column_stack([outline, np.full(len(outline), z)]) for z, outline in sections])


def tube(rings: Sequence[Array]) -> Manifold:
    """Solid through rings (n, 3) of equally many points, closed at both ends about the rings' middles."""
    n, k = len(rings[0]), len(rings)
    points = np.vstack([*rings, rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]])
    i = np.arange(n)
    j = (i + 1) % n
    faces = [np.column_stack([np.full(n, n * k), j, i])]
    for level in range(k - 1):
        a, b = n * level, n * (level + 1)
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    faces.append(np.column_stack([np.full(n, n * k + 1), n * (k - 1) + i, n * (k - 1) + j]))
    solid = _solid(points, np.vstack(faces))
    return solid if solid.volume() > 0 else _solid(points, np.vstack(faces)[:, ::-1])


def _solid(points: Array, faces: NDArray[np.int64]) -> Manifold:
    return Manifold(Mesh(vert_properties=points.astype(np.float32), tri_verts=faces.astype(np.uint32)))


def smooth_loft(
    heights: Sequence[float],
    widths: Sequence[float],
    depths: Sequence[float],
    power: float = 2.0,
    levels: int = 40,
) -> Manifold:
    """Loft of superellipses whose half axes run smoothly through given values.

    Args:
        heights: heights z of the values, rising.
        widths: half axes along x there.
        depths: half axes along y there.
        power: exponent of the superellipses.
        levels: number of sections.
    """
    from scipy.interpolate import PchipInterpolator

    share = (1 - np.cos(np.linspace(0, np.pi, levels))) / 2
    z = heights[0] + share * (heights[-1] - heights[0])
    a, b = PchipInterpolator(heights, widths)(z), PchipInterpolator(heights, depths)(z)
    return loft([(h, superellipse(p, q, power)) for h, p, q in zip(z, a, b, strict=True)])


def rod(path: Points, radius: float | Sequence[float], segments: int = 20) -> Manifold:
    """Round bar along a path of points, with spherical ends; one radius, or one per point."""
    radii = [radius] * len(path) if isinstance(radius, int | float) else list(radius)
    balls = [
        Manifold.sphere(r, segments).translate(tuple(point)) for point, r in zip(path, radii, strict=True)
    ]
    return joined(*[Manifold.batch_hull(list(pair)) for pair in pairwise(balls)])


def arc(
    centre: Sequence[float], radius: float, start: float, end: float, count: int = 13
) -> list[list[float]]:
    """Points (x, 0, z) of an arc about `centre` (x, z), from angle `start` to `end` [deg], +x towards +z."""
    angle = np.radians(np.linspace(start, end, count))
    return [
        [centre[0] + radius * c, 0.0, centre[1] + radius * s]
        for c, s in zip(np.cos(angle), np.sin(angle), strict=True)
    ]


def joined(*solids: Manifold) -> Manifold:
    """Union of solids."""
    total = solids[0]
    for solid in solids[1:]:
        total = total + solid
    return total


def warped(solid: Manifold, move: Callable[[Array], Array], length: float = 2.0) -> Manifold:
    """Solid with its points moved: `move` takes and returns points (n, 3), after refinement to `length`."""
    return solid.refine_to_length(length).warp_batch(lambda points: move(np.array(points)))


def bent(solid: Manifold, radius: float, length: float = 4.0) -> Manifold:
    """Solid along x bent upwards about an axis along y, `radius` above the origin."""

    def move(points: Array) -> Array:
        angle, r = points[:, 0] / radius, radius - points[:, 2]
        return np.column_stack([r * np.sin(angle), points[:, 1], radius - r * np.cos(angle)])

    return warped(solid, move, length)


def grounded(solid: Manifold) -> Manifold:
    """Solid shifted so that it touches z = 0 from above and its bounding box is centred on the z axis."""
    x0, y0, z0, x1, y1, _ = solid.bounding_box()
    return solid.translate((-(x0 + x1) / 2, -(y0 + y1) / 2, -z0))


def triangles(solid: Manifold) -> Array:
    """Corners (n, 3, 3) of a solid's triangles, normals outward."""
    mesh = solid.to_mesh()
    return np.asarray(mesh.vert_properties[:, :3], float)[np.asarray(mesh.tri_verts)]
