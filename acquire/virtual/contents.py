"""Contents of a virtual object that move inside it: a liquid, powder, or a loose lump.

Each is one point mass that moves inside a convex body K, fixed in the object, under gravity, with friction.

- Liquid with a plane surface: its centroid is a function of the surface's direction alone, and the set of all
  these places is the boundary of a convex body, as for the centre of buoyancy of a ship (Dupin's theorem).
  Its lowest point is the centroid at rest. Only a part of the mass follows a fast motion (sloshing.py): it
  moves on K enlarged by the inverse of its share, so that the centroid of all is right whenever the liquid is
  level and the first mode has its period.
- Powder: the same, with dry friction of the tangent of its angle of repose, and all of the mass moves.
- Loose lump: a ball that slides on the walls of the cavity without turning. K is the cavity less the radius.

What the model leaves out: waves beyond the first mode of the pose at rest, the contents' own moments of
inertia, splashing, a lump that rolls.

Frame: O, the object's frame (that of its shape file).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.given_contents import ContentsKind
from acquire.virtual.hidden import HiddenBody
from acquire.virtual.sloshing import first_mode

if TYPE_CHECKING:
    from numpy.typing import NDArray

SLOPE = 0.15
"""slope of a liquid's surface from which the curvature of K is computed"""


@dataclass(frozen=True)
class MovingPart:
    """Part of the contents' mass that moves against the object, and its place at rest."""

    share: float
    """share of the contents' mass; the rest is fixed to the object"""
    shift: NDArray[np.float64]
    """(3,) place from the centroid of the contents at rest [m, in O]"""


@dataclass(frozen=True)
class Contents:
    """Point mass inside a convex body K, and the mass properties of all that does not move."""

    kind: ContentsKind
    mass_kg: float
    friction: float
    """coefficient of dry friction on the boundary of K"""
    damping_per_s: float
    """viscous damping of the motion along the boundary, over the mass [1/s]"""
    planes: NDArray[np.float64]
    """(n, 4) unit outward normals and offsets [m, in O] of K: inside, normal . x <= offset"""
    depths: NDArray[np.float64]
    """(n,) depth of a liquid [m] whose surface is parallel to each plane; empty for a lump"""
    smooth_m: float
    """distance over which the planes are blended to a smooth surface [m]; 0 for walls that meet at edges"""
    middle: NDArray[np.float64]
    """(3,) middle of the cavity [m, in O]"""
    rigid: HiddenBody
    """mass properties of the object without the contents"""
    seed: int = 0
    """seed of the places where a lump lies when the object is set down"""

    def moving_part(self, down: NDArray[np.float64]) -> MovingPart:
        """Part of the mass that moves; `down` (3,) is the unit vector of gravity in O, before the motion."""
        if self.kind is not ContentsKind.LIQUID:
            return MovingPart(1.0, np.zeros(3))
        depth = float(self.depths[int(np.argmax(self.planes[:, :3] @ down))])
        # Curvature radii of K's lowest point: a liquid W wide and h deep has W^2 / 12 h.
        across = np.linalg.svd(down[None])[2][1:]
        steps = [
            (self.lowest(_unit(down + SLOPE * side)) - self.lowest(_unit(down - SLOPE * side))) / (2 * SLOPE)
            for side in across
        ]
        radii = np.linalg.svd(np.array(steps) @ across.T)[1]
        modes = [first_mode(float(np.sqrt(12 * depth * max(radius, 1e-5))), depth) for radius in radii]
        share, height = (
            float(np.mean([getattr(each, name) for each in modes])) for name in ("share", "height")
        )
        return MovingPart(share, (0.5 * depth - height) * down)

    def lowest(self, down: NDArray[np.float64]) -> NDArray[np.float64]:
        """Place (3,) in O [m] of the contents at rest; `down` (3,) is the unit vector of gravity in O.

        For a lump, the middle of the lowest wall.
        """
        normals, offsets = self.planes[:, :3], self.planes[:, 3]
        if self.smooth_m > 0:
            # The boundary touches each plane at one point; the neighbours' planes give it.
            near = np.argsort(-normals @ down)[:12]
            return np.asarray(np.linalg.lstsq(normals[near], offsets[near], rcond=None)[0], dtype=np.float64)
        return self.middle + self.reach(self.middle, down) * down

    def reach(self, place: NDArray[np.float64], direction: NDArray[np.float64]) -> float:
        """Distance [m] from a place (3,) inside K to its boundary along a unit vector (3,)."""
        ahead = self.planes[:, :3] @ direction
        gap = self.planes[:, 3] - self.planes[:, :3] @ place
        towards = ahead > 1e-9
        return float(np.min(gap[towards] / ahead[towards]))


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)
