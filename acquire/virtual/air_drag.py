"""Force and torque of the air on a flying object: pressure on the panels of its surface.

Each panel that moves against the air takes the force -3/4 q n, one that moves away from it +1/4 q n by the
suction of the wake, with q = 1/2 rho Cd A u^2, u its speed along the outward normal n, A its area, rho the
air's density and Cd the object's drag coefficient. Not modelled: lift by rotation, friction of the air,
shelter behind other panels, a wake that lags.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

AIR_KG_M3 = 1.2
"""density of the air [kg/m3]"""
FRONT_SHARE = 0.75
"""share of the drag of a plate across the stream that acts on its front; the rest is suction behind it"""
_PANEL_M = 0.015
"""largest edge of a panel before panels are grouped, and the side of the cells in which they are [m]"""
_TURNS = 4
"""number of steps of a normal's component from 0 to 1 within which panels of a cell are grouped"""


class AirDrag:
    """Wrench of the air on one object, from the velocity of its centre of mass and its rate of turn.

    Args:
        vertices: (n, 3) vertices of the surface in O, the object's frame [m].
        faces: (m, 3) triangles, indices of vertices, normals outward.
        com_object: (3,) centre of mass in O [m].
        drag_coefficient: Cd of the panels.
    """

    def __init__(
        self,
        vertices: NDArray[np.float64],
        faces: NDArray[np.int64],
        com_object: NDArray[np.float64],
        drag_coefficient: float,
    ) -> None:
        middles, areas = _panels(vertices[faces])
        size = np.linalg.norm(areas, axis=1)
        normals = areas / size[:, None]
        self._rows = np.column_stack([normals, np.cross(middles - com_object, normals)])
        self._factors = 0.5 * AIR_KG_M3 * drag_coefficient * size

    def wrench(self, velocity: NDArray[np.float64], rate: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force [N] and torque about the centre of mass [N m], (6,), along the axes of O.

        Args:
            velocity: (3,) velocity of the centre of mass along the axes of O, the object's frame [m/s].
            rate: (3,) angular velocity along the axes of O [rad/s].
        """
        speed = self._rows @ np.concatenate([velocity, rate])
        push = np.where(speed > 0, FRONT_SHARE, FRONT_SHARE - 1.0) * speed * speed
        return -(self._factors * push) @ self._rows


def _panels(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles (p, 3) [m] and area vectors (p, 3) [m2] of small panels of a surface.

    Triangles are halved until no edge is longer than _PANEL_M; those of one cell with similar normals are
    then one panel, so that a fine mesh has few.

    Args:
        triangles: (m, 3, 3) corners [m].
    """
    small: list[NDArray[np.float64]] = []
    while len(triangles):
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = edges.argmax(axis=1)
        fine = edges.max(axis=1) <= _PANEL_M
        small.append(triangles[fine])
        rest, first = triangles[~fine], longest[~fine]
        row = np.arange(len(rest))
        a, b, c = (rest[row, (first + k) % 3] for k in range(3))
        half = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, half, c], axis=1), np.stack([half, b, c], axis=1)])
    found = np.concatenate(small)
    areas = 0.5 * np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    size = np.linalg.norm(areas, axis=1)
    found, areas, size = found[size > 0], areas[size > 0], size[size > 0]
    middles = found.mean(axis=1)
    key = np.column_stack(
        [np.floor(middles / _PANEL_M), np.round(areas / size[:, None] * _TURNS)],
    ).astype(np.int64)
    _, panel = np.unique(key, axis=0, return_inverse=True)
    count = int(panel.max()) + 1
    total = np.bincount(panel, size, count)
    centres = np.stack([np.bincount(panel, size * each, count) for each in middles.T], axis=1)
    vectors = np.stack([np.bincount(panel, each, count) for each in areas.T], axis=1)
    return centres / total[:, None], np.asarray(vectors, np.float64)
