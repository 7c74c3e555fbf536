"""The paper's own plan (3.1.1 to 3.1.3), faithful, to be compared with ours: rays along principal axes, first three by force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel
from analyze.planning.hypothesis import paper_hypothesis, principal_axes, surface_samples
from analyze.planning.stable_planes import RestingPlane, paper_stable_planes, resting_planes
from analyze.types import Array

CLOUD_ACROSS = 60
"""points of the cloud P along the longest edge"""
IN_PLANE = 1e-4
"""m, distance from S_i up to which a point of the cloud belongs to it"""
ALIKE = np.cos(np.radians(20.0))
"""a hull normal that lies within this angle of n_ij counts as 'in its direction'"""
CONTACT_ANGLE = np.radians(5.0)
"""Delta theta of eq. (2), which the paper does not give"""


@dataclass(frozen=True)
class PaperStrike:
    """One impact point with its rotation point, in O."""

    plane_id: str
    up: Array
    """(3,) unit"""
    rotation_point: Array
    """(3,) p^r_ij [m]"""
    axis: Array
    """(3,) unit l_ij; +theta about it tips"""
    impact_point: Array
    """(3,) p^I_ij [m]"""
    force: float
    """N, by eq. (2)"""


def paper_strikes(model: ObjectModel, mass: float, gravity: float = 9.81) -> tuple[PaperStrike, ...]:
    """All of the paper's impact points in order of force, least first.

    Args:
        model: its surface, sampled evenly, is the cloud P.
        mass: kg.
        gravity: m/s^2.

    Raises:
        PlanError: fewer than two stable planes that are not parallel, as for the paper's own salt cylinder.
    """
    cloud, _ = surface_samples(model, CLOUD_ACROSS)
    planes = paper_stable_planes(resting_planes(model), paper_hypothesis(cloud))
    if len(planes) < 2:
        raise PlanError(f"{model.name}: the paper's method needs two stable planes that are not parallel, it has {len(planes)}: use ours")
    strikes = [strike for plane in planes for strike in _strikes_on(model, plane, cloud, mass * gravity)]
    return tuple(sorted(strikes, key=lambda strike: strike.force))


def paper_plan(model: ObjectModel, mass: float, gravity: float = 9.81) -> tuple[PaperStrike, ...]:
    """The first three of `paper_strikes`, what the paper carries out: often parallel axes or one vertex, which do not determine c."""
    return paper_strikes(model, mass, gravity)[:3]


def rotation_points(plane: RestingPlane, support: Array) -> list[tuple[Array, Array]]:
    """Where rays from the mean of `support` (n, 3) along its in-plane axes, both ways, leave the polygon; the tip direction (3,) there."""
    centre = support.mean(axis=0)
    offset = support - centre
    flat = offset - np.outer(offset @ plane.up, plane.up)
    axes = principal_axes(flat.T @ flat / len(flat))[:2]
    start, _ = plane.edges
    out = plane.outward()
    found: list[tuple[Array, Array]] = []
    for ray in (axes[0], -axes[0], axes[1], -axes[1]):
        speed = out @ ray
        room = np.einsum("ki,ki->k", start - centre, out)
        distance = np.where(speed > 1e-9, room / np.where(speed > 1e-9, speed, 1.0), np.inf)
        edge = int(np.argmin(distance))
        found.append((centre + float(distance[edge]) * ray, out[edge]))
    return found


def impact_force(rotation_point: Array, impact_point: Array, up: Array, inwards: Array, weight: float) -> float:
    """F [N] of eq. (2), constant over the contact: F*r*(cos theta1 - cos(theta1 + Delta theta)) = m*g*(h2 - h1), c at the impact point.

    Args:
        rotation_point: (3,) m, in O.
        impact_point: (3,) m, in O.
        up: (3,) unit, in O.
        inwards: (3,) unit n_ij, from the rotation point to the plane's centre; the force acts along its opposite.
        weight: m*g [N].
    """
    lever = impact_point - rotation_point
    length = float(np.linalg.norm(lever))
    rise = length - float(lever @ up)
    theta = float(np.arccos(np.clip(-inwards @ lever / length, -1, 1)))
    turn = abs(np.cos(theta) - np.cos(theta + CONTACT_ANGLE))
    return float(weight * rise / (length * max(float(turn), 1e-9)))


def _strikes_on(model: ObjectModel, plane: RestingPlane, cloud: Array, weight: float) -> Sequence[PaperStrike]:
    support = cloud[np.abs(cloud @ plane.up - plane.level) < IN_PLANE]
    centre = support.mean(axis=0)
    normals, points = _hull_points(model, cloud)
    strikes: list[PaperStrike] = []
    for rotation_point, tip in rotation_points(plane, support):
        inwards = centre - rotation_point
        inwards = inwards - plane.up * float(inwards @ plane.up)
        inwards /= np.linalg.norm(inwards)
        candidates = points[normals @ inwards > ALIKE]
        if not len(candidates):
            continue
        across = np.cross(inwards, plane.up)
        projected = candidates - np.outer((candidates - rotation_point) @ across, across)
        farthest = projected[int(np.argmax(np.linalg.norm(projected - rotation_point, axis=1)))]
        impact_point = candidates[int(np.argmin(np.linalg.norm(candidates - farthest, axis=1)))]
        force = impact_force(rotation_point, impact_point, plane.up, inwards, weight)
        strikes.append(PaperStrike(plane.id, plane.up, rotation_point, np.cross(plane.up, tip), impact_point, force))
    return strikes


def _hull_points(model: ObjectModel, cloud: Array) -> tuple[Array, Array]:
    """Normals (n, 3) and points (n, 3): the cloud's points on the convex hull, each once per hull face it lies on."""
    planes = np.unique(np.round(model.hull_planes, 6), axis=0)
    heights = cloud @ planes[:, :3].T + planes[:, 3]
    point, plane = np.nonzero(heights > -1e-5)
    return planes[plane, :3], cloud[point]
