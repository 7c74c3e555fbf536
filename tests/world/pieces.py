"""Convex pieces of world shapes that overlap a little, as convex decompositions for simulators have them."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import WorldShape

MAX_PIECES = 20
_CUTS = 7
_CONVEX = 0.03
"""volume of its hollows, as a share of the piece's hull, up to which a piece counts as convex"""
_GROWTH_MM = 0.15
"""distance by which pieces are grown, so that neighbours overlap"""


def convex_pieces(shape: WorldShape) -> list[Manifold]:
    """Convex hulls [mm, in O] of at most 20 slices of a shape, each grown by 0.15 mm.

    The slice with the largest hollows is cut by the plane, perpendicular to an axis, that leaves the smallest
    hulls, as by V-HACD.
    """
    waiting = [shape.solid]
    while len(waiting) < MAX_PIECES:
        hollows = [piece.hull().volume() - piece.volume() for piece in waiting]
        worst = int(np.argmax(hollows))
        if hollows[worst] < _CONVEX * waiting[worst].hull().volume():
            break
        waiting[worst : worst + 1] = _best_halves(waiting[worst])
    return [_grown(piece.hull()) for piece in waiting if piece.volume() > 1]


def _best_halves(piece: Manifold) -> list[Manifold]:
    box = np.array(piece.bounding_box())
    low, high = box[:3], box[3:]
    best: tuple[float, list[Manifold]] = (np.inf, [piece])
    for axis in range(3):
        normal = tuple(float(value) for value in np.eye(3)[axis])
        for share in (np.arange(_CUTS) + 1) / (_CUTS + 1):
            offset = float(low[axis] + share * (high[axis] - low[axis]))
            halves = [half for half in piece.split_by_plane(normal, offset) if half.volume() > 1e-3]
            # Equal savings go to the longer side: a ring's hulls shrink only from its quarters on.
            hulls = sum(half.hull().volume() for half in halves) - 1e-3 * float(high[axis] - low[axis])
            if hulls < best[0]:
                best = (hulls, halves)
    return best[1]


def _grown(hull: Manifold) -> Manifold:
    box = np.array(hull.bounding_box())
    middle, size = (box[:3] + box[3:]) / 2, np.maximum(box[3:] - box[:3], 0.1)
    factor = 1 + 2 * _GROWTH_MM / size
    return hull.translate(tuple(-middle)).scale(tuple(factor)).translate(tuple(middle)).simplify(0.02)
