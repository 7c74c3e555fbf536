"""Positions, in the world frame W [m], of everything that the pictures of one strike show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.cards.body import PlacedObject
from analyze.types import Array
from schemas.strike_plan import PlannedStrike

EDGE_TOLERANCE = 0.004
"""Fraction of the object's size within which a corner counts as lying on the pivot edge."""
ARC_PAST_BALANCE, MIN_ARC = float(np.radians(12.0)), float(np.radians(16.0))
"""Angle [rad] by which the arrow of the tipping direction goes past the balance, and the least balance angle
that it shows, so that it looks like an arc."""


@dataclass(frozen=True)
class Setting:
    """Positions of object, striker and camera of one strike in its world frame W [m].

    W has z up and the table at z = 0. The pivot line, on which the edge lies, is along y at x = 0; the mark
    on it is at y = 0. The striker comes from -x, in plans of `analyze plan` at y = 0. The eye of the pictures
    is at -y, where the camera stands unless the strike is turned. For a turned strike (object and striker
    turned by 180° on the table), W is turned with them.
    """

    body: PlacedObject
    """Object, placed as planned."""
    low: Array
    """(3,) least coordinates of the object in W [m]."""
    high: Array
    """(3,) greatest coordinates of the object in W [m]."""
    edge: tuple[float, float] | None
    """Ends (least, greatest) of the pivot edge along W's y [m]; None for a rim, which touches in a point, or
    if no edge is found."""
    hit: Array
    """(3,) impact point in W [m]."""
    strike_height: float
    """Height [m] of the impact over the table."""
    camera: Array
    """(3,) centre of the camera in W [m]."""
    tag: int | str | None
    """Name of the best visible tag of the plan; None if there is none, or the strike is turned."""
    tip_angle: float
    """Angle [rad] at which the object balances on the edge."""
    rolls: bool
    """True if the object tips over a round rim."""
    turned: bool = False
    """True if the striker is on the other side of the line: drawn as seen from opposite the camera, without
    the camera."""

    @property
    def size(self) -> float:
        """Longest extent [m] of the object along the world frame's axes, as it is placed."""
        return float(np.max(self.high - self.low))

    @property
    def reach(self) -> float:
        """Length [m] that scales the drawn distances of striker and camera from the object.

        It is the geometric mean of the object's size and of its diagonal across the pivot line.
        """
        across = float(np.hypot(self.high[0] - self.low[0], self.high[2] - self.low[2]))
        return float(np.sqrt(across * self.size))

    @property
    def front_to_mark(self) -> float:
        """Distance [m] along the pivot line from the edge's near end to the mark.

        The mark is the point y = 0 of the line. The near end is the one towards -y, the eye of the pictures;
        if there is no edge (a rim), the near end of the object counts. The distance is negative if the mark
        is nearer to the eye.
        """
        return -(self.low[1] if self.edge is None else self.edge[0])


def strike_setting(body: PlacedObject, strike: PlannedStrike) -> Setting:
    """Positions, in the world frame [m], of object, striker and camera in one strike's pictures.

    Args:
        body: Object, placed as planned.
        strike: Strike as planned.
    """
    corners = body.corners
    return Setting(
        body,
        corners.min(axis=0),
        corners.max(axis=0),
        pivot_edge(body, strike),
        np.array(strike.aim.impact.point) @ body.R.T + body.p,
        strike.aim.impact_height_m,
        np.array(strike.camera_pose)[:3, 3],
        strike.visible_markers[0] if strike.visible_markers and not strike.heading_rad else None,
        strike.phi_predicted_rad,
        strike.rolls,
        strike.heading_rad != 0.0,
    )


def pivot_edge(body: PlacedObject, strike: PlannedStrike) -> tuple[float, float] | None:
    """Ends (least, greatest) of the pivot edge along W's y [m]; None for a rim, or if no edge is found.

    Args:
        body: Object, placed as planned.
        strike: Strike about the edge.
    """
    corners = body.corners
    near = EDGE_TOLERANCE * body.shape.size
    line = np.array(strike.pivot.point) @ body.R.T + body.p
    # The sharp edge lies one radius of rounding outside its centre line, and below.
    sharp = corners[(np.abs(corners[:, 2]) < near) & (corners[:, 0] > line[0] - near)]
    if len(sharp) and not strike.rolls and float(np.ptp(sharp[:, 1])) > 5 * near:
        return float(sharp[:, 1].min()), float(sharp[:, 1].max())
    return None


def tip_arc(place: Setting) -> Array:
    """Points (24, 3) [m] of the curved arrow that shows the tipping direction, in the world frame.

    The arrow is an arc about the pivot line at the near end of the object, outside its corner farthest from
    that line. It runs from just before the vertical to past the balance.

    Args:
        place: Positions of object, line, striker and camera.
    """
    corners = place.body.corners
    radius = 1.12 * float(np.hypot(corners[:, 0], corners[:, 2]).max())
    angles = np.linspace(-0.06, max(place.tip_angle, MIN_ARC) + ARC_PAST_BALANCE, 24)
    return np.stack([radius * np.sin(angles), np.full(24, place.low[1]), radius * np.cos(angles)], axis=1)
