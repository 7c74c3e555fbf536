"""Which tips would measure the entries of the tensor that are still the shape's: a tip over an edge along l tells l.I.l, no more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.export.provenance import ENTRIES
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.planning.footing import footing
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.planning.unscanned import on_scanned_edges, on_scanned_planes
from analyze.types import Array
from schemas.object_spec import ObjectSpec

STRIKE_SD = 0.02
"""of a moment, relative to the prior's sd: a good strike knows it far better than the shape does"""
MEASURED_FRACTION = 0.5
"""of the prior's sd, below which an entry counts as measured (as in analyze.estimation.inertia)"""
STANDS = 0.0
"""part of the region of c beside which a face must hold it: c is known here"""
LEAST_GAIN = 0.05
"""of an entry's sd, for which a strike is worth naming"""


@dataclass(frozen=True)
class Remedy:
    """What would make prior entries measured."""

    axes: tuple[PivotAxis, ...]
    """to tip about; together they measure what can be"""
    never: tuple[tuple[int, int], ...]
    """entries that no edge of this object tells"""


def remedy(
    model: ObjectModel, spec: ObjectSpec, com: Array, made: Sequence[Array], prior: Sequence[tuple[int, int]]
) -> Remedy:
    """The fewest more edges, one after the other, each that which makes most entries measured.

    Edges are those that the planner would look at, under its names; whether camera and striker reach one is for the planner to say.

    Args:
        model: the exterior.
        spec: markers and edge radius, as the planner takes them.
        com: (3,) m, where c was found.
        made: directions (3,) of the axes whose moments are known.
        prior: the entries asked for.
    """
    expected = hypothesis(model)
    believed = replace(expected, region=replace(expected.region, centre=com))
    planes, _ = on_scanned_planes(model, footing(model, resting_planes(model), believed.region, STANDS))
    axes, _ = on_scanned_edges(model, pivot_axes(model, spec, planes, believed))
    rows = [moment_row(axis.direction) for axis in axes]
    information = np.eye(len(ENTRIES)) + sum(
        (_told(moment_row(direction)) for direction in made), np.zeros((len(ENTRIES),) * 2)
    )
    wanted = [ENTRIES.index(entry) for entry in prior]
    chosen: list[PivotAxis] = []
    while axes:
        left = [place for place in wanted if not _measured(information)[place]]
        after = [information + _told(row) for row in rows]
        gains = [
            (int(_measured(each)[left].sum()), float(np.log(_sd(information) / _sd(each))[left].sum()))
            for each in after
        ]
        best = max(range(len(axes)), key=gains.__getitem__)
        if not left or gains[best][1] < LEAST_GAIN:
            break
        chosen.append(axes[best])
        information = after[best]
    reached = _measured(information)
    return Remedy(tuple(chosen), tuple(ENTRIES[place] for place in wanted if not reached[place]))


def moment_row(direction: Array) -> Array:
    """(6,) with which the entries of `ENTRIES` add up to l.I.l."""
    return np.array([direction[i] * direction[j] * (1 if i == j else 2) for i, j in ENTRIES])


def _told(row: Array) -> Array:
    return np.outer(row, row) / STRIKE_SD**2


def _sd(information: Array) -> Array:
    return np.sqrt(np.diag(np.linalg.inv(information)))


def _measured(information: Array) -> BoolArray:
    return _sd(information) < MEASURED_FRACTION
