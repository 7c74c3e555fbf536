"""Pressure of the air on the panels of a moving body's hull: force and moment per kilogram.

A panel that moves against the air at u, u_n along its outward normal, is pressed by 1/2 rho C u_n^2
(Newton's law of resistance, Principia 1687, with a free coefficient C); one that moves away from it is not.
The law is rough: force and moment have a coefficient each, which flights determine, and a second law, with
|u| u_n instead, shows how much depends on it.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from analyze.flight.attitude import cross

if TYPE_CHECKING:
    from analyze.types import Array

AIR_DENSITY = 1.2
"""density of the air of a room [kg/m^3]"""
_PANELS = 100
"""least number of panels of a hull"""


@dataclass(frozen=True)
class HullPanels:
    """Flat pieces of a body's convex hull, in the object frame O."""

    points: Array
    """(p, 3) their centres [m]"""
    normals: Array
    """(p, 3) their outward unit normals"""
    areas: Array
    """(p,) their areas [m^2]"""
    oblique: bool = False
    """True for the second law, by which the air presses more on panels that move obliquely"""

    @property
    def mean_shadow(self) -> float:
        """Mean area [m^2] of the hull's shadow: a quarter of its surface (Cauchy 1841)."""
        return 0.25 * float(self.areas.sum())

    def load_about(self, com: Array, mass: float) -> AirLoad:
        """Air's load on the body with the centre of mass `com` (3,) [m, in O] and a mass [kg]."""
        arms = self.points - com
        wrench = np.hstack([self.normals, cross(arms, self.normals)])
        pressed = (-0.5 * AIR_DENSITY / mass) * self.areas[:, None] * wrench
        return AirLoad(arms, wrench, pressed, self.oblique)


@dataclass(frozen=True)
class AirLoad:
    """Force [N/kg] and moment about c [N m/kg] of the air in O, for a coefficient of 1."""

    arms: Array
    """(p, 3) panels' centres seen from c [m, in O]"""
    wrench: Array
    """(p, 6) panels' normals, and the moments of a force of 1 along each about c"""
    pressed: Array
    """(p, 6) force and moment of each panel at 1 m/s against the air, per kilogram of the body"""
    oblique: bool
    """True for the second law, by which the air presses more on panels that move obliquely"""

    def __call__(self, motion: Array | tuple[float, ...]) -> Array:
        """Force and moment (..., 6) at velocities of c and angular velocities (..., 6) in O [m/s, rad/s]."""
        motion = np.asarray(motion)
        against = motion @ self.wrench.T
        np.maximum(against, 0.0, out=against)
        if not self.oblique:
            against *= against
            return against @ self.pressed
        moved = motion[..., None, :3] + cross(motion[..., None, 3:], self.arms)
        return (against * np.sqrt(np.sum(moved**2, axis=-1))) @ self.pressed


def hull_panels(hull_vertices: Array) -> HullPanels:
    """Panels of the convex hull of points (h, 3) [m], its triangles divided until there are 100 or more.

    Each triangle is divided into k^2 equal ones, with k by its area.
    """
    hull = ConvexHull(hull_vertices)
    corners = hull_vertices[hull.simplices]
    areas = 0.5 * np.linalg.norm(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    target = float(areas.sum()) / _PANELS
    points: list[Array] = []
    normals: list[Array] = []
    pieces: list[Array] = []
    for triangle, normal, area in zip(corners, hull.equations[:, :3], areas, strict=True):
        parts = max(1, int(np.ceil(np.sqrt(area / target))))
        weights = _barycentric_centres(parts)
        points.append(weights @ triangle)
        normals.append(np.tile(normal, (len(weights), 1)))
        pieces.append(np.full(len(weights), area / len(weights)))
    return HullPanels(np.concatenate(points), np.concatenate(normals), np.concatenate(pieces))


def _barycentric_centres(parts: int) -> Array:
    """Centres (parts^2, 3), in barycentric coordinates, of the equal triangles into which one is divided."""
    centres: list[tuple[float, float, float]] = []
    for i in range(parts):
        for j in range(parts - i):
            a, b = (i + 1 / 3) / parts, (j + 1 / 3) / parts
            centres.append((a, b, 1 - a - b))
            if j < parts - i - 1:
                a, b = (i + 2 / 3) / parts, (j + 2 / 3) / parts
                centres.append((a, b, 1 - a - b))
    return np.array(centres)
