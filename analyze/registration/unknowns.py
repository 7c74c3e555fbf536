"""Unknowns of the registration's least-squares problem, their layout in a step, and their priors.

Registration estimates where an object's markers are glued on, from strikes that tip the object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.rotations import matrix_from_vector

if TYPE_CHECKING:
    from analyze.registration.round_body import FreeTurn
    from analyze.types import Array

PER_STRIKE, PER_EDGE, PER_TABLE, PER_FRAME = 6, 2, 3, 6
"""number of unknowns of each strike, edge, table and tipping frame"""
HEADING_SD, PLACE_SD = math.radians(6.0), 0.02
"""prior sd of a placement by hand [rad, m]; wide, so that the hand gives no information beyond the start"""
IMPACT_TURN_SD, TWISTED_SD, DRIFT_SD = math.radians(0.05), math.radians(3.0), math.radians(0.1)
"""sd of the body's turn about the vertical by the impact [rad], by an impact that clearly missed the body's
middle [rad], and while the body tips [rad per rad of tipping angle]"""
FRAME_SD = np.array([np.inf, math.radians(0.05), 1.0, 0.02, 2e-4, 3e-5])
"""sd of theta, heading, turn about a rim's axis, slip along x and along y, and lift in one frame of a tip
[rad, m]; over a straight edge nothing turns about a rim's axis"""
RIM_FRAME_SD = np.array([np.inf, math.radians(1.0), math.radians(3.0), 0.02, 0.005, 3e-5])
"""the same over a round rim, which touches the table in one point: about it the body yaws, and it rolls along
the rim"""
RIM_DRIFT_SD = math.radians(5.0)
"""sd of a body's turn about the vertical while it tips over a round rim [rad per rad of tipping angle]"""
MARKER_SD = np.array([3.0, 3.0, 3.0, 1.0, 1.0, 1.0])
"""prior sd of a marker's pose [rad, m]: no information, but it keeps undetermined directions finite"""

SIZE_SD = 1e-3
"""prior sd of a marker's edge length, relative: how it was printed and measured, and by how much its edges
look displaced in the images; it moves the marker along the line of sight"""


@dataclass
class Unknowns:
    """Unknowns of the registration, which estimates the poses of an object's markers from strikes.

    They are those of markers, strikes, pivot edges, tables and video frames. O is the object frame, M a
    marker's, W the world frame. Of a strike, psi is the heading of the object as put down, less the planned
    one, x and y its place on the table, kappa its turn about the vertical by the impact, and tau its further
    turn about the vertical while it tips, per rad of tipping angle theta, and alpha, over a round rim, the
    turn about the rim's axis with which it was put down: another point of the rim than planned is in front.
    """

    R: list[Array]
    """(3, 3) rotation from M to O per marker"""
    t: list[Array]
    """(3,) centre in O per marker [m]"""
    strike: Array
    """(s, 6) of each strike psi, x, y, kappa, tau, alpha [rad, m, m, rad, 1, rad]; psi and alpha are relative
    to the plan"""
    edge: Array
    """(e, 2) displacement of each edge's centre line across itself [m]"""
    table: Array
    """(recordings, 3) tilts about W's x and y [rad], and height [m]"""
    size: Array
    """(m,) relative error of each marker's stated edge length"""
    frames: list[Array]
    """per strike (f - 1, 6), for its frames after rest: theta, heading, turn about the rim's axis, x, y, z
    [rad, rad, rad, m, m, m]"""

    def after_step(self, shared: Array, frames: list[Array], axis: FreeTurn | None = None) -> Unknowns:
        """Copy of the registration's unknowns, changed by a step of the iteration.

        Where markers turn about a rim's axis they are carried on circles about it, not on tangents: that turn
        is hardly determined, so that steps are large, and what else is known of the markers must not change.

        Args:
            shared: (n,) step of all but the frames' unknowns: 6 per marker (turn in the object frame O [rad],
                position in O [m]), 6 per strike (heading, x, y, turn by the impact, turn per rad of tipping,
                turn about the rim's axis [rad, m, m, rad, 1, rad]), 2 per edge (its displacement [m]), 3 per
                table (two tilts, height [rad, rad, m]), 1 per marker (its size, relative).
            frames: per strike (f - 1, 6) step of the unknowns of its f - 1 frames after rest: tipping angle,
                heading, turn about the rim's axis, x, y, z [rad, rad, rad, m, m, m].
            axis: axis of the round rim over which the body tips; None if it tips over straight edges.
        """
        parts = np.cumsum([6 * len(self.R), self.strike.size, self.edge.size, self.table.size])
        markers, strike, edge, table, size = np.split(shared, parts)
        markers = markers.reshape(-1, 6)
        return Unknowns(
            [matrix_from_vector(step[:3]) @ R for step, R in zip(markers, self.R, strict=True)],
            [
                t + step[3:] + (np.zeros(3) if axis is None else axis.off_tangent(t, step[:3]))
                for step, t in zip(markers, self.t, strict=True)
            ],
            self.strike + strike.reshape(self.strike.shape),
            self.edge + edge.reshape(self.edge.shape),
            self.table + table.reshape(self.table.shape),
            self.size + size,
            [frame + step for frame, step in zip(self.frames, frames, strict=True)],
        )


def heading_by_frame(strike: Array, frame: Array) -> Array:
    """Heading (f,) of the object about the vertical in every frame of a strike [rad]; frame 0 is at rest.

    Args:
        strike: (6,) psi (heading as put down) [rad], x, y [m], kappa (turn by the impact) [rad], tau (turn
            per rad of tipping angle), alpha (turn about the rim's axis) [rad] of the strike.
        frame: (f, 6) of every frame: tipping angle theta, a small further heading d_psi, a further turn about
            the rim's axis [rad], and shifts x, y, z [m].
    """
    psi, _, _, kappa, tau, _ = strike
    return psi + kappa * (np.arange(len(frame)) > 0) + tau * frame[:, 0] + frame[:, 1]
