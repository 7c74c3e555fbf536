"""Labelled parts of an object as uniform solids: closed bodies of its mesh, or its shell and layers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry.polyhedron import MassProperties, merged_solid

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from analyze.estimation.cells import Cells
    from analyze.geometry.bodies import Body
    from analyze.types import Array
    from schemas.object_spec import PartLabel

REST = "rest"
"""Name of the part that holds everything without a label."""
MIN_VOLUME_FRACTION = 1e-3
"""Fraction of the object's volume below which a part, or the rest, is neglected."""
MIN_REST_LAYER = 0.1
"""Thickness of the rest, over that of a layer of cells, below which it is neglected: cells do not resolve
it."""


def parts_of_bodies(
    labels: Sequence[PartLabel], bodies: Sequence[Body], name: str, left_out: Collection[int] = ()
) -> list[tuple[str, MassProperties]]:
    """Parts of an object, each made of the closed bodies of its mesh that one label names.

    Args:
        labels: Labels, each with a name and the numbers of its bodies, which count from 1.
        bodies: Closed bodies of the mesh, largest first.
        name: Name of the shape file, for messages.
        left_out: Numbers of bodies that do not belong to the object: those of its fixture.

    Returns:
        Name and uniform solid (volume, centroid and inertia per kilogram, in the object frame O) of each
        label, then of the unlabelled bodies as `rest` if they hold more than `MIN_VOLUME_FRACTION` of the
        volume.

    Raises:
        ShapeError: a label names a body that the mesh does not have, or that is not closed.
    """
    used = {number for label in labels for number in label.bodies}
    if beyond := sorted(number for number in used if number > len(bodies)):
        raise ShapeError(
            f"{name}: has {len(bodies)} closed bodies, the object file's labels name number {beyond[0]}: "
            "correct it, `analyze parts` lists the bodies"
        )
    if torn := sorted(number for number in used if bodies[number - 1].open_edges):
        raise ShapeError(
            f"{name}: body {torn[0]} is not closed ({bodies[torn[0] - 1].open_edges} open edges), so that it"
            " has no volume: close it in a mesh editor, or export the assembly with one solid per part"
        )
    parts = [
        (label.name, merged_solid([bodies[number - 1].properties for number in label.bodies]))
        for label in labels
    ]
    own = {number: body for number, body in enumerate(bodies, 1) if number not in left_out}
    others = [body.properties for number, body in own.items() if number not in used]
    total = sum(body.properties.volume for body in own.values())
    if sum(one.volume for one in others) > MIN_VOLUME_FRACTION * total:
        parts.append((REST, merged_solid(others)))
    return parts


def parts_of_cells(labels: Sequence[PartLabel], cells: Cells, name: str) -> list[tuple[str, MassProperties]]:
    """Parts of an object that its labels name: the shell (outer wall) and layers of the interior.

    A cell that a layer's end cuts belongs to the layer in part.

    Args:
        labels: Labels of the shell and of layers.
        cells: Cells of the body.
        name: Name of the object, for messages.

    Returns:
        Name and uniform solid (volume, centroid and inertia per kilogram, in the object frame O) of each
        label, then of the remainder as `rest` if it holds more than `MIN_VOLUME_FRACTION` of the volume, and
        more than a layer of a tenth of a cell (`MIN_REST_LAYER`) across a cube of the object's volume.

    Raises:
        ShapeError: a part holds at most 0.1 % (`MIN_VOLUME_FRACTION`) of the volume, or two layers overlap.
    """
    left_wall, left_inside = cells.shell.copy(), cells.interior.copy()
    parts: list[tuple[str, MassProperties]] = []
    for label in labels:
        if label.wall:
            share, left_wall = left_wall, np.zeros_like(left_wall)
        else:
            share = cells.interior * _between(cells, label)
            left_inside = left_inside - share
        if share.sum() <= MIN_VOLUME_FRACTION * cells.volumes.sum():
            raise ShapeError(
                f"{name}: part {label.name!r} contains nothing of the object: check its ends, in metres from "
                "O along `along`"
            )
        parts.append((label.name, _solid(cells, share)))
    if left_inside.min() < -1e-6 * cells.volumes.max():
        raise ShapeError(f"{name}: two layers overlap: let one begin where the other ends")
    left = left_wall + np.maximum(left_inside, 0.0)
    volume = float(cells.volumes.sum())
    if left.sum() > max(MIN_VOLUME_FRACTION * volume, MIN_REST_LAYER * cells.pitch * volume ** (2 / 3)):
        parts.append((REST, _solid(cells, left)))
    return parts


def _between(cells: Cells, label: PartLabel) -> Array:
    """Fraction (n,) of each of n cells (small pieces of the body) between the ends of a labelled layer.

    The ends are in metres from the origin of the object frame O along the layer's direction; the fraction is
    0 for a label without ends.
    """
    low, high = label.between_m or (0.0, 0.0)
    along = np.array(label.along) / np.linalg.norm(label.along)
    return cells.share_below(along, high) - cells.share_below(along, low)


def _solid(cells: Cells, volumes: Array) -> MassProperties:
    """Uniform solid made of cubes: volume [m^3], centroid (3,) [m], inertia per kilogram (3, 3) [m^2].

    The inertia tensor is about the centroid. Centroid and axes are those of the object frame O.

    Args:
        cells: Cells (small cubes) of the body.
        volumes: (n,) volume [m^3] of each cell that belongs to the solid.
    """
    volume = float(volumes.sum())
    centroid = volumes @ cells.points / volume
    arm = cells.points - centroid
    second = (arm * volumes[:, None]).T @ arm / volume
    return MassProperties(
        volume, centroid, (np.trace(second) + volumes @ cells.own_inertia / volume) * np.eye(3) - second
    )
