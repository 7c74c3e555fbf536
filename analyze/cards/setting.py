"""What every picture of one strike shows: where things are in W, in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.cards.body import Placed
from analyze.types import Array
from schemas.strike_plan import PlannedStrike

ON_LINE = 0.004
"""part of the object's size within which a corner lies on the pivot edge"""
PAST, LEAST_ARC = float(np.radians(12.0)), float(np.radians(16.0))
"""how far past the balance the tipping arrow goes, and a balance from which it can be seen as an arc"""


@dataclass(frozen=True)
class Setting:
    """One strike in W: pivot line along y at x = 0, its mark at y = 0, striker from -x (at y = 0 in plans of ours), camera at -y."""

    body: Placed
    low: Array
    """(3,) m, least coordinates of the object"""
    high: Array
    """(3,)"""
    edge: tuple[float, float] | None
    """m, where the pivot edge begins (nearest to the camera) and ends along W's y; None: it touches in one point (a rim)"""
    hit: Array
    """(3,) m"""
    strike_height: float
    camera: Array
    """(3,) m"""
    tag: int | str | None
    """the one that faces the camera"""
    tip_angle: float
    """rad, at which it stands on the edge"""
    rolls: bool
    turned: bool = False
    """with the striker on the line's other side: drawn as seen by somebody opposite the camera, which is not drawn"""

    @property
    def size(self) -> float:
        """Metres: longest edge of the box around the object as it lies."""
        return float(np.max(self.high - self.low))

    @property
    def reach(self) -> float:
        """Metres: how far from the object striker and camera are drawn: what looks right for standing and for lying objects."""
        across = float(np.hypot(self.high[0] - self.low[0], self.high[2] - self.low[2]))
        return float(np.sqrt(across * self.size))

    @property
    def front_to_mark(self) -> float:
        """Along the line [m], from the end of the edge nearest to the camera (of a rim: of the object) to the mark."""
        return -(self.low[1] if self.edge is None else self.edge[0])


def setting(body: Placed, strike: PlannedStrike) -> Setting:
    """Everything about one strike; the body lies as the strike says."""
    corners = body.corners
    near = ON_LINE * body.shape.size
    line = np.array(strike.pivot.point) @ body.R.T + body.p
    # The sharp edge lies one radius of rounding outside its centre line, and below.
    sharp = corners[(np.abs(corners[:, 2]) < near) & (corners[:, 0] > line[0] - near)]
    edge = None
    if len(sharp) and not strike.rolls and float(np.ptp(sharp[:, 1])) > 5 * near:
        edge = (float(sharp[:, 1].min()), float(sharp[:, 1].max()))
    return Setting(
        body,
        corners.min(axis=0),
        corners.max(axis=0),
        edge,
        np.array(strike.impact.point) @ body.R.T + body.p,
        strike.impact_height_m,
        np.array(strike.camera_pose)[:3, 3],
        strike.visible_markers[0] if strike.visible_markers and not strike.heading_rad else None,
        strike.phi_predicted_rad,
        strike.rolls,
        strike.heading_rad != 0.0,
    )


def tip_arc(place: Setting) -> Array:
    """(n, 3) m: an arc about the pivot line before the object's front, outside of its far corner, from the upright on."""
    corners = place.body.corners
    radius = 1.12 * float(np.hypot(corners[:, 0], corners[:, 2]).max())
    angles = np.linspace(-0.06, max(place.tip_angle, LEAST_ARC) + PAST, 24)
    return np.stack([radius * np.sin(angles), np.full(24, place.low[1]), radius * np.cos(angles)], axis=1)
