"""The labelled parts of an object as uniform solids: bodies of its mesh, or its wall and layers inside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry.polyhedron import MassProperties

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.cells import Cells
    from analyze.geometry.bodies import Body
    from analyze.types import Array
    from schemas.object_spec import PartLabel

REST = "rest"
"""what no label names"""
LEAST_REST = 1e-3
"""of the volume; less is no part"""


def parts_of_bodies(labels: Sequence[PartLabel], bodies: Sequence[Body], name: str) -> list[tuple[str, MassProperties]]:
    """Each label's bodies as one solid, and what no label names as `rest`.

    Args:
        labels: of bodies.
        bodies: of the mesh, largest first.
        name: of the shape file, for messages.

    Raises:
        ShapeError: a label names a body that the mesh does not have.
    """
    used = {number for label in labels for number in label.bodies}
    if beyond := sorted(number for number in used if number > len(bodies)):
        raise ShapeError(f"{name}: has {len(bodies)} closed bodies, the object file's labels name number {beyond[0]}: see `analyze parts`")
    parts = [(label.name, joined([bodies[number - 1].properties for number in label.bodies])) for label in labels]
    others = [body.properties for number, body in enumerate(bodies, 1) if number not in used]
    total = sum(body.properties.volume for body in bodies)
    if sum(one.volume for one in others) > LEAST_REST * total:
        parts.append((REST, joined(others)))
    return parts


def parts_of_cells(labels: Sequence[PartLabel], cells: Cells, name: str) -> list[tuple[str, MassProperties]]:
    """Wall and layers as solids, a cell that a layer's border cuts in part; what no label names is `rest`.

    Args:
        labels: of wall and layers.
        cells: the body.
        name: of the object, for messages.

    Raises:
        ShapeError: a layer holds nothing of the object, or two hold the same.
    """
    left_wall, left_inside = cells.wall.copy(), cells.interior.copy()
    parts: list[tuple[str, MassProperties]] = []
    for label in labels:
        if label.wall:
            share, left_wall = left_wall, np.zeros_like(left_wall)
        else:
            share = cells.interior * _between(cells, label)
            left_inside = left_inside - share
        if share.sum() <= LEAST_REST * cells.volumes.sum():
            raise ShapeError(f"{name}: part {label.name!r} holds nothing of the object: look at its ends, in metres from O along `along`")
        parts.append((label.name, _solid(cells, share)))
    if left_inside.min() < -1e-6 * cells.volumes.max():
        raise ShapeError(f"{name}: two layers hold the same place: let one begin where the other ends")
    left = left_wall + np.maximum(left_inside, 0.0)
    if left.sum() > LEAST_REST * cells.volumes.sum():
        parts.append((REST, _solid(cells, left)))
    return parts


def joined(solids: Sequence[MassProperties]) -> MassProperties:
    """Several solids of one density as one."""
    volume = sum(one.volume for one in solids)
    centroid = np.sum([one.volume * one.centroid for one in solids], axis=0) / volume
    inertia = np.zeros((3, 3))
    for one in solids:
        arm = one.centroid - centroid
        inertia = inertia + one.volume / volume * (one.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return MassProperties(volume, centroid, inertia)


def _between(cells: Cells, label: PartLabel) -> Array:
    """Part (cells,) of each cell between a layer's ends."""
    low, high = label.between_m or (0.0, 0.0)
    height = cells.points @ (np.array(label.along) / np.linalg.norm(label.along))
    above, below = (np.clip((height - end) / cells.pitch + 0.5, 0.0, 1.0) for end in (low, high))
    return np.asarray(above - below, dtype=np.float64)


def _solid(cells: Cells, volumes: Array) -> MassProperties:
    volume = float(volumes.sum())
    centroid = volumes @ cells.points / volume
    arm = cells.points - centroid
    second = (arm * volumes[:, None]).T @ arm / volume
    return MassProperties(volume, centroid, (np.trace(second) + volumes @ cells.own / volume) * np.eye(3) - second)
