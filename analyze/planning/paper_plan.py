"""The paper's plan: rays along principal axes, first three by force (VISAPP 2013, 3.1.1 to 3.1.3).

Q is the region of the centre of mass c. The paper's indices: i for the resting plane S_i, j for the ray;
p^r_ij is the rotation point, p^I_ij the impact point, l_ij the rotation axis, n_ij the direction from p^r_ij
to the plane's centre. Choices that the paper leaves open are made here:

- The cloud P of a mesh is `CLOUD_POINTS` points at equal steps of its area.
- Q: eq. (1) as printed sums over all points and so grows with their number; where that leaves fewer than two
  planes, the same with means.
- Equal eigenvalues (a square base): the object's own axes, x before y before z. A ray into a corner: the edge
  that comes first.
- "Normals in the direction of n_ij": within 20 degrees, and if no point has one, the nearest there is.
- Eq. (2): Delta theta is 5 degrees, and theta falls while the object tips.
- Equal forces (both ends of a ray in a symmetric object): larger plane first, then longer axis, then + before
  -.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.even_samples import even_samples
from analyze.geometry.object_model import ObjectModel
from analyze.planning.hypothesis import paper_hypothesis, principal_axes
from analyze.planning.stable_planes import RestingPlane, paper_stable_planes, resting_planes
from analyze.types import Array

CLOUD_POINTS = 8000
"""Number of points of the cloud P."""
PLANE_TOLERANCE = 1e-4
"""Distance [m] from a plane S_i up to which a point of the cloud belongs to it."""
SAME_DIRECTION_COSINE = np.cos(np.radians(20.0))
"""Cosine of the largest angle to n_ij at which a hull normal counts as 'in its direction'."""
CONTACT_ANGLE = np.radians(5.0)
"""Delta theta of eq. (2) [rad], which the paper does not give."""
STRUCK_POINTS = 3
"""Number of impact points that the paper strikes."""
FORCE_DECIMALS = 6
"""Decimals of the force, over the smallest one, beyond which forces count as equal."""


@dataclass(frozen=True)
class PaperStrike:
    """Strike by the paper (VISAPP 2013): impact point, and rotation point about which the object tips.

    Both are in the object frame. The rotation point p^r_ij lies where ray j from the middle of resting
    plane i leaves the plane's support polygon; p^I_ij is the impact point that belongs to it.
    """

    plane: RestingPlane
    """Face that the object rests on."""
    rotation_point: Array
    """(3,) rotation point p^r_ij [m]."""
    tip: Array
    """(3,) unit vector in the resting plane, outward normal of the edge that holds p^r_ij."""
    impact_point: Array
    """(3,) impact point p^I_ij [m]."""
    force: float
    """Force by eq. (2) [N]."""

    @property
    def axis(self) -> Array:
        """Unit direction (3,) of the axis about which the object tips (l_ij in VISAPP 2013).

        It is in the object frame; a positive turn about it tips the object.
        """
        return np.cross(self.plane.up, self.tip)

    @property
    def energy(self) -> float:
        """Energy needed to tip, divided by the weight m g: rise [m] of the centre of mass to balance.

        The centre of mass is assumed at the impact point, so the rise h2 - h1 of eq. (2), VISAPP 2013, is the
        impact point's distance from the rotation point less its height over it.
        """
        lever = self.impact_point - self.rotation_point
        return float(np.linalg.norm(lever)) - float(lever @ self.plane.up)


@dataclass(frozen=True)
class PaperPlan:
    """All impact points that the paper's method finds on an object, by ascending force (VISAPP 2013, 3.1).

    The force is the one that tips the object when it acts there, by eq. (2).
    """

    strikes: tuple[PaperStrike, ...]
    """Impact points of all rotation points."""
    as_printed: bool
    """False if eq. (1) was used with means, because with sums no two planes are stable."""

    @property
    def struck(self) -> tuple[PaperStrike, ...]:
        """Strikes that the paper makes: the first `STRUCK_POINTS` (3), those of least force.

        Often their tipping axes are parallel or pass through one vertex; then they do not determine the
        centre of mass.
        """
        return self.strikes[:STRUCK_POINTS]


def paper_plan(model: ObjectModel, mass: float, gravity: float = 9.81) -> PaperPlan:
    """Impact points on an object by the paper's method (VISAPP 2013, 3.1.1 to 3.1.3).

    They are in order of the force needed to tip the object.

    Args:
        model: Shape, whose uniformly sampled surface is the paper's point cloud P.
        mass: Mass of the object [kg].
        gravity: Gravity [m/s^2].

    Returns:
        Four impact points for each of two stable planes, smallest force first, and whether eq. (1) was used
        as printed.

    Raises:
        PlanError: fewer than two stable planes that are not parallel, as for the paper's own salt cylinder.
    """
    cloud, _ = even_samples(model.vertices, model.faces, CLOUD_POINTS)
    planes = resting_planes(model)
    found = [paper_stable_planes(planes, paper_hypothesis(cloud, weight)) for weight in (1.0, 1 / len(cloud))]
    as_printed = len(found[0]) >= 2
    stable = found[0] if as_printed else found[1]
    if len(stable) < 2:
        raise PlanError(
            f"{model.name}: the paper's method needs two stable planes that are not parallel, it has "
            f"{len(stable)}: use --method ours"
        )
    strikes = [strike for plane in stable for strike in _strikes_on(model, plane, cloud, mass * gravity)]
    least = min((strike.force for strike in strikes), default=1.0)
    return PaperPlan(
        tuple(sorted(strikes, key=lambda strike: round(strike.force / least, FORCE_DECIMALS))), as_printed
    )


def rotation_points(plane: RestingPlane, support: Array) -> list[tuple[Array, Array]]:
    """Rotation points p^r (3,) [m] and unit tip directions (3,) of a plane, in the object frame.

    Rays from the mean of the plane's points along their two in-plane principal axes, both ways, leave the
    support polygon at the rotation points; the tip direction is the outward normal of the edge there.

    Args:
        plane: Resting plane.
        support: (n, 3) points of the surface that lie in the plane [m], in the object frame.

    Returns:
        Four pairs: for both ways along the axis of largest spread, then along the other.
    """
    centre = support.mean(axis=0)
    offset = support - centre
    flat = offset - np.outer(offset @ plane.up, plane.up)
    axes = principal_axes(flat.T @ flat / len(flat))[:2]
    out = plane.outward
    found: list[tuple[Array, Array]] = []
    for ray in (axes[0], -axes[0], axes[1], -axes[1]):
        speed = out @ ray
        room = np.einsum("ki,ki->k", plane.polygon - centre, out)
        distance = np.where(speed > 1e-9, room / np.where(speed > 1e-9, speed, 1.0), np.inf)
        edge = int(np.argmin(np.round(distance, 9)))
        found.append((centre + float(distance[edge]) * ray, out[edge]))
    return found


def impact_force(
    rotation_point: Array, impact_point: Array, up: Array, inwards: Array, weight: float
) -> float:
    """Force F [N] of the paper's eq. (2), constant over the contact.

    F r abs(cos theta1 - cos(theta1 - Delta theta)) = m g (h2 - h1), with the centre of mass assumed at the
    impact point: r is its distance from the rotation point, h2 - h1 its rise to balance (r less its height
    over the rotation point), theta1 the angle between the vector from rotation to impact point and the
    opposite of `inwards`, Delta theta `CONTACT_ANGLE`.

    Args:
        rotation_point: (3,) rotation point p^r_ij [m], in the object frame.
        impact_point: (3,) impact point p^I_ij [m], in the object frame.
        up: (3,) unit vector upwards at rest, in the object frame.
        inwards: (3,) unit vector n_ij, horizontal at rest, from the rotation point towards the centre of the
            resting face; the force acts along its opposite.
        weight: Weight m g [N].
    """
    lever = impact_point - rotation_point
    length = float(np.linalg.norm(lever))
    rise = length - float(lever @ up)
    theta = float(np.arccos(np.clip(-inwards @ lever / length, -1, 1)))
    turn = abs(np.cos(theta) - np.cos(theta - CONTACT_ANGLE))
    return float(weight * rise / (length * max(float(turn), 1e-9)))


def _strikes_on(
    model: ObjectModel, plane: RestingPlane, cloud: Array, weight: float
) -> Sequence[PaperStrike]:
    """Impact point for each of the four rotation points of a resting plane (VISAPP 2013, 3.1.3).

    A rotation point, about which the object tips, lies on the rim of the plane's support polygon. The impact
    point is on the shape's hull, on the far side from it. With each pair comes the force [N] needed to tip.

    Args:
        model: Shape of the object.
        plane: Resting plane.
        cloud: (n, 3) points of the surface [m], in the object frame.
        weight: Weight m g [N].
    """
    support = cloud[np.abs(cloud @ plane.up - plane.level) < PLANE_TOLERANCE]
    if len(support) < 3:
        support = plane.polygon
    centre = support.mean(axis=0)
    normals, points = _hull_points(model, cloud)
    strikes: list[PaperStrike] = []
    for rotation_point, tip in rotation_points(plane, support):
        inwards = centre - rotation_point
        inwards = inwards - plane.up * float(inwards @ plane.up)
        inwards /= np.linalg.norm(inwards)
        along = normals @ inwards
        candidates = points[along >= min(float(SAME_DIRECTION_COSINE), float(along.max()) - 1e-6)]
        across = np.cross(inwards, plane.up)
        projected = candidates - np.outer((candidates - rotation_point) @ across, across)
        farthest = projected[int(np.argmax(np.linalg.norm(projected - rotation_point, axis=1).round(9)))]
        impact_point = candidates[int(np.argmin(np.linalg.norm(candidates - farthest, axis=1).round(9)))]
        force = impact_force(rotation_point, impact_point, plane.up, inwards, weight)
        strikes.append(PaperStrike(plane, rotation_point, tip, impact_point, force))
    return strikes


def _hull_points(model: ObjectModel, cloud: Array) -> tuple[Array, Array]:
    """Unit normals (n, 3) and points (n, 3) [m] on the faces of the hull, in the object frame.

    Points are those of the `cloud` (m, 3) and the hull's corners that lie on a face of the hull; a point on
    several faces is repeated with the normal of each.
    """
    planes = np.unique(np.round(model.hull_planes, 6), axis=0)
    every = np.vstack([cloud, model.hull_vertices])
    heights = every @ planes[:, :3].T + planes[:, 3]
    point, plane = np.nonzero(heights > -1e-5)
    return planes[plane, :3], every[point]
