"""Impact point, impulse and tip speed for a tip about one axis (VISAPP 2013, eq. 2; method 1.4, 1.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning.clearance import (
    HEIGHT_STEP,
    LANES,
    TIP_RADIUS,
    meets_squarely,
    section,
    stays_clear,
    under_arm,
    without_noise,
)
from analyze.planning.pivots import PivotAxis, Swing
from analyze.types import Array
from schemas.impact_law import inverse_impact_mass, tip_speed_for_impulse
from schemas.rig_limits import tip_speeds

NOMINAL = tip_speeds()
"""Range of the nominal striker's tip speeds [m/s]."""
GRAVITY = 9.81
"""Gravity [m/s^2], precise enough for plans."""
MIN_DEPTH_BELOW_TOP = 0.010
"""Smallest distance of an impact point below the object's top [m]."""
CARD_OVER_TAG_SIZE = 10 / 8
"""Edge of a marker's card over that of its black square (one white cell around 8)."""


@dataclass(frozen=True)
class StrikerModel:
    """Effective mass [kg] and restitution of the striker's tip, with the speeds and heights it can reach.

    Mass and restitution have a standard deviation. Speeds are those of the tip [m/s], heights those over the
    table [m].
    """

    effective_mass_kg: float = 0.2
    """Effective mass at the tip [kg]."""
    restitution: float = 0.4
    """Coefficient of restitution of the impact."""
    effective_mass_sd_kg: float = 0.05
    """1 sigma of the effective mass [kg]."""
    restitution_sd: float = 0.15
    """1 sigma of the restitution."""
    slowest_m_s: float = NOMINAL.slowest_m_s
    """Smallest tip speed [m/s]."""
    fastest_m_s: float = NOMINAL.fastest_m_s
    """Largest tip speed [m/s]."""
    lowest_m: float = 0.015
    """Smallest height of the tip over the table [m]."""
    highest_m: float = 0.4
    """Largest height of the tip over the table [m]."""

    def too_fast_or_slow(self, speed: float) -> str:
        """Message if the striker cannot strike at a tip speed [m/s]; empty if it can."""
        if self.slowest_m_s <= speed <= self.fastest_m_s:
            return ""
        return (
            f"it needs a tip speed of {speed:.2f} m/s: the striker gives {self.slowest_m_s:.3g} to "
            f"{self.fastest_m_s:.3g} m/s"
        )

    def too_high_or_low(self, height: float) -> str:
        """Message if the striker's tip cannot be set to a height [m] over the table; empty if it can."""
        if self.lowest_m <= height <= self.highest_m:
            return ""
        lowest, highest = 1000 * self.lowest_m, 1000 * self.highest_m
        return (
            f"it is struck at {1000 * height:.0f} mm: the striker reaches {lowest:.0f} to {highest:.0f} mm "
            "over the table"
        )


HAND = StrikerModel(slowest_m_s=0.02, fastest_m_s=5.0, lowest_m=0.005, highest_m=1.0)
"""A hand's flick: nearly any speed, at any height of a table-top object."""


@dataclass(frozen=True)
class ImpactPoint:
    """Place on the object's surface to strike, and the friction that holds the pivot edge in place then.

    c is the object's centre of mass.
    """

    height: float
    """Height over the table [m]."""
    point: Array
    """(3,) place [m], in the object frame."""
    friction: float
    """Horizontal over vertical impulse at the edge for the expected c: the friction coefficient needed."""
    worst_friction: float
    """Largest such ratio for the places of c that were examined."""
    on_card: bool
    """True if the tip meets a marker's card, or may touch it."""


def impact_points(
    model: ObjectModel,
    axis: PivotAxis,
    swings: Sequence[Swing],
    cards: list[tuple[Array, float]],
    striker: StrikerModel,
) -> list[ImpactPoint]:
    """Impact points on the object that the striker's tip, a sphere, can meet with its front.

    The sphere moves along +x in the plane y = 0 of W, the world frame at rest: x in the direction in which
    the object tips, y along the pivot edge (0 at `axis.point`), z up. Heights are `HEIGHT_STEP` apart. Left
    out are heights at which the sphere meets another part first, those whose surface has a step near by or is
    too oblique (`meets_squarely`), those at which the arm meets an overhanging part (`under_arm`), those at
    which a part that juts out below, such as a handle, rises against the sphere as the object tips
    (`stays_clear`), those less than `MIN_DEPTH_BELOW_TOP` below the top, and those out of the striker's
    reach.

    Args:
        model: Shape of the object.
        axis: Pivot axis (edge about which the object tips).
        swings: Expected swing (parameters of the object's tipping), then swings for other places of the
            centre of mass. Each point has the friction needed for the first, and the largest one needed for
            any.
        cards: Centre (3,) [m, in the object frame] and edge [m] of the black square of each marker.
        striker: Striker, for its reach.

    Returns:
        Impact points from the lowest to the highest; empty if there are none.
    """
    R, p = axis.R_world_object, axis.p_world_object
    # Mats and effective masses are tried in turn, and change nothing here.
    key = ("met", R.tobytes(), p.tobytes(), axis.radius, striker.lowest_m, striker.highest_m)
    met = model.cached(key, lambda model: _met(model, axis, striker))
    centres = np.array([centre for centre, _ in cards]).reshape(-1, 3)
    near_to = np.array([0.5 * CARD_OVER_TAG_SIZE * edge + TIP_RADIUS for _, edge in cards])
    result: list[ImpactPoint] = []
    for ahead, height in met:
        point = R.T @ (np.array([ahead, 0.0, height]) - p)
        friction = [friction_at_impact(each, height) for each in swings]
        near = bool(np.any(np.linalg.norm(point - centres, axis=1) < near_to))
        result.append(ImpactPoint(height, point, friction[0], max(friction), near))
    return result


def _met(model: ObjectModel, axis: PivotAxis, striker: StrikerModel) -> list[tuple[float, float]]:
    """Places x and heights z [m] in W at which the striker's tip can meet the object, from the lowest up.

    Args:
        model: Shape of the object.
        axis: Pivot axis (edge about which the object tips).
        striker: Striker, for its reach.
    """
    world = model.hull_vertices @ axis.R_world_object.T + axis.p_world_object
    start, top = float(world[:, 0].min()) - 0.1, float(world[:, 2].max())
    heights = np.arange(HEIGHT_STEP / 2, top, HEIGHT_STEP)
    sections = [section(model, axis, heights, start, beside) for beside in LANES]
    if model.noise_sd:
        sections = without_noise(sections, heights, model.noise_sd)
    distance = sections[len(LANES) // 2].distance
    tried = np.flatnonzero(
        (heights >= striker.lowest_m) & (heights <= min(top - MIN_DEPTH_BELOW_TOP, striker.highest_m))
    )
    tried = tried[meets_squarely(sections, heights, tried)]
    tried = tried[under_arm(sections, heights, tried)]
    tried = tried[stays_clear(sections, heights, start, axis.radius, tried)]
    return [(start + float(distance[i]), float(heights[i])) for i in tried]


def plate_points(
    model: ObjectModel, axis: PivotAxis, swings: Sequence[Swing], striker: StrikerModel
) -> list[ImpactPoint]:
    """Impact points on an upright plate behind an object, which the striker's tip can meet at every height.

    The plate is as high as the object, and its mass is neglected.

    Args:
        model: Shape of the object.
        axis: Pivot axis (edge about which the object tips).
        swings: Expected swing, then swings for other places of the centre of mass, as of `impact_points`.
        striker: Striker, for its reach.

    Returns:
        Impact points from the lowest to the highest; empty if the object is too low.
    """
    R, p = axis.R_world_object, axis.p_world_object
    world = model.hull_vertices @ R.T + p
    top = min(float(world[:, 2].max()) - MIN_DEPTH_BELOW_TOP, striker.highest_m)
    result: list[ImpactPoint] = []
    for height in np.arange(striker.lowest_m, top, HEIGHT_STEP).tolist():
        point = R.T @ (np.array([float(world[:, 0].min()), 0.0, height]) - p)
        friction = [friction_at_impact(each, height) for each in swings]
        result.append(ImpactPoint(height, point, friction[0], max(friction), on_card=False))
    return result


def best_impact(points: list[ImpactPoint], friction: float) -> ImpactPoint | None:
    """Impact point of `points` at which the pivot edge needs the least friction; None without points.

    The friction is the coefficient needed for the worst of the examined places of the centre of mass.

    Args:
        points: Impact points that the striker can reach.
        friction: Available friction coefficient. Points off the markers' cards (white border included) where
            it suffices for the expected centre of mass are preferred; without such points all are considered.
    """
    free = [point for point in points if not point.on_card and point.friction <= friction]
    return min(free or points, key=lambda point: point.worst_friction, default=None)


def friction_at_impact(expected: Swing, height: float) -> float:
    """Friction coefficient needed at the edge during impact (method 1.4).

    It is abs(R cos phi - I_edge / (m h)) / (R sin phi): the edge's impulse along the table over that upwards,
    and 0 at the centre of percussion. R is the distance of the centre of mass from the edge's centre line,
    phi the balance angle, I_edge the moment of inertia about the edge, m the mass.

    Args:
        expected: Expected swing, with R, phi, I_edge and m.
        height: Impact height h over the table [m].
    """
    horizontal = expected.distance * np.cos(expected.phi) - expected.i_edge / (expected.mass * height)
    return float(abs(horizontal) / max(expected.distance * np.sin(expected.phi), 1e-9))


def release_rate(expected: Swing, energy_ratio: float) -> float:
    """Angular rate right after the strike, omega0 [rad/s] (method 1.5).

    I_edge omega0^2 / 2 = m g (h2 - h1) E, with h2 - h1 = R (1 - cos phi) the rise of the centre of mass to
    its balance, R its distance from the edge, and I_edge the moment of inertia about the edge.

    Args:
        expected: Expected swing, with the balance angle phi, and the rate k = m g R / I_edge [rad/s^2].
        energy_ratio: E, energy over that needed to reach balance.
    """
    return float(np.sqrt(2 * expected.k * (1 - np.cos(expected.phi)) * energy_ratio))


def impulse_for(expected: Swing, height: float, energy_ratio: float) -> float:
    """Impulse J = I_edge omega0 / h [N s] of a strike at height h that gives an energy ratio.

    Args:
        expected: Expected swing, with the moment of inertia I_edge about the edge.
        height: Impact height h over the table [m].
        energy_ratio: Energy over that needed to reach balance, which sets the angular rate omega0.
    """
    return expected.i_edge * release_rate(expected, energy_ratio) / height


def tip_speed_for(striker: StrikerModel, expected: Swing, height: float, impulse: float) -> float:
    """Tip speed v [m/s] of the striker that gives an impulse J [N s].

    J = (1 + e) v / (1/m_s + h^2/I_edge), with I_edge the object's moment of inertia about the edge.

    Args:
        striker: Effective mass m_s and restitution e.
        expected: Expected swing, for I_edge.
        height: Impact height h over the table [m].
        impulse: Impulse J [N s].
    """
    inverse_mass = inverse_impact_mass(1 / striker.effective_mass_kg, height, expected.i_edge)
    return tip_speed_for_impulse(impulse, striker.restitution, inverse_mass)
