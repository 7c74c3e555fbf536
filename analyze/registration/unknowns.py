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
    from analyze.types import Array

PER_STRIKE, PER_EDGE, PER_TABLE, PER_FRAME = 5, 2, 3, 5
"""number of unknowns of each strike, edge, table and tipping frame"""
HEADING_SD, PLACE_SD = math.radians(6.0), 0.02
"""prior sd of a placement by hand [rad, m]; wide, so that the hand gives no information beyond the start"""
IMPACT_TURN_SD, TWISTED_SD, DRIFT_SD = math.radians(0.05), math.radians(3.0), math.radians(0.1)
"""sd of the body's turn about the vertical by the impact [rad], by an impact that clearly missed the body's
middle [rad], and while the body tips [rad per rad of tipping angle]"""
FRAME_SD = np.array([np.inf, math.radians(0.05), 0.02, 2e-4, 3e-5])
"""sd of theta, heading, slip along x and along y, and lift in one frame of a tip [rad, m]"""
MARKER_SD = np.array([3.0, 3.0, 3.0, 1.0, 1.0, 1.0])
"""prior sd of a marker's pose [rad, m]: no information, but it keeps undetermined directions finite"""


@dataclass
class Unknowns:
    """Unknowns of the registration, which estimates the poses of an object's markers from strikes.

    They are those of markers, strikes, pivot edges, tables and video frames. O is the object frame, M a
    marker's, W the world frame. Of a strike, psi is the heading of the object as put down, less the planned
    one, x and y its place on the table, kappa its turn about the vertical by the impact, and tau its further
    turn about the vertical while it tips, per rad of tipping angle theta.
    """

    R: list[Array]
    """(3, 3) rotation from M to O per marker"""
    t: list[Array]
    """(3,) centre in O per marker [m]"""
    strike: Array
    """(s, 5) of each strike psi, x, y, kappa, tau [rad, m, m, rad, 1]; psi is relative to the plan"""
    edge: Array
    """(e, 2) displacement of each edge's centre line across itself [m]"""
    table: Array
    """(recordings, 3) tilts about W's x and y [rad], and height [m]"""
    frames: list[Array]
    """per strike (f - 1, 5), for its frames after rest: theta, heading, x, y, z [rad, rad, m, m, m]"""

    def after_step(self, shared: Array, frames: list[Array]) -> Unknowns:
        """Copy of the registration's unknowns, changed by a step of the iteration.

        Args:
            shared: (n,) step of all but the frames' unknowns: 6 per marker (turn in the object frame O [rad],
                position in O [m]), 5 per strike (heading, x, y, turn by the impact, turn per rad of tipping
                [rad, m, m, rad, 1]), 2 per edge (its displacement [m]), 3 per table (two tilts, height [rad,
                rad, m]).
            frames: per strike (f - 1, 5) step of the unknowns of its f - 1 frames after rest: tipping angle,
                heading, x, y, z [rad, rad, m, m, m].
        """
        parts = np.cumsum([6 * len(self.R), self.strike.size, self.edge.size])
        markers, strike, edge, table = np.split(shared, parts)
        markers = markers.reshape(-1, 6)
        return Unknowns(
            [matrix_from_vector(step[:3]) @ R for step, R in zip(markers, self.R, strict=True)],
            [t + step[3:] for step, t in zip(markers, self.t, strict=True)],
            self.strike + strike.reshape(self.strike.shape),
            self.edge + edge.reshape(self.edge.shape),
            self.table + table.reshape(self.table.shape),
            [frame + step for frame, step in zip(self.frames, frames, strict=True)],
        )


def heading_by_frame(strike: Array, frame: Array) -> Array:
    """Heading (f,) of the object about the vertical in every frame of a strike [rad]; frame 0 is at rest.

    Args:
        strike: (5,) psi (heading as put down) [rad], x, y [m], kappa (turn by the impact) [rad], tau (turn
            per rad of tipping angle) of the strike.
        frame: (f, 5) of every frame: tipping angle theta, a small further heading d_psi [rad], and shifts x,
            y, z [m].
    """
    psi, _, _, kappa, tau = strike
    return psi + kappa * (np.arange(len(frame)) > 0) + tau * frame[:, 0] + frame[:, 1]
