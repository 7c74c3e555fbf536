"""Find edges whose tips would measure entries of the inertia tensor that are only assumed so far.

The assumption, from the shape alone, is called prior. A tip over an edge with the unit direction l determines
l.I.l, with I the inertia tensor about the centre of mass, and no other combination of its entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.planning.footing import footing
from analyze.planning.hypothesis import hypothesis
from analyze.planning.information import moment_row
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.planning.unscanned import scanned_edges, scanned_planes
from analyze.types import TENSOR_ENTRIES, Array
from schemas.object_spec import ObjectSpec

STRIKE_SD_FRACTION = 0.02
"""sd of a moment from one strike over the prior's sd: a good strike is far better than the shape"""
MEASURED_FRACTION = 0.5
"""sd relative to the prior's below which an entry counts as measured (as in analyze.estimation.inertia)"""
FOOTING_MARGIN = 0.0
"""scale of the region of the centre of mass that must lie over a resting face; 0: only its centre, which is
known here"""
MIN_GAIN = 0.05
"""smallest ln(sd before / sd after), summed over the entries still to measure, for which an edge is named"""


@dataclass(frozen=True)
class AdditionalEdges:
    """Edges about which further strikes would measure more entries of the object's inertia tensor.

    An entry that no strike has measured has a value assumed from the shape. `axes` are the edges to tip the
    object over. `unreachable` are the entries (row, column) that no edge of the object determines: they stay
    assumed. The tensor is along the axes of O, the frame of the shape file.
    """

    axes: tuple[PivotAxis, ...]
    """edges to tip over; together they measure all entries that can be measured"""
    unreachable: tuple[tuple[int, int], ...]
    """entries (i, j) of the tensor that no edge of this object determines"""


def additional_edges(
    model: ObjectModel, spec: ObjectSpec, com: Array, made: Sequence[Array], prior: Sequence[tuple[int, int]]
) -> AdditionalEdges:
    """Choose edges whose tips would measure inertia tensor entries that come from the shape so far.

    They are chosen one by one, each time the edge with which most entries of `prior` become measured; of
    equal ones, the edge that reduces the entries' standard deviations most. The choice ends when all entries
    are measured or no edge helps. The edges are those that the planner would consider, with the same ids;
    whether camera and striker reach one is for the planner to decide. O is the frame of the object's shape
    file.

    Args:
        model: exterior of the object.
        spec: object specification, of which markers and edge radius are used.
        com: (3,) estimated centre of mass in O [m].
        made: unit directions (3,) in O of the axes about which moments of inertia were measured.
        prior: entries (i, j) of the inertia tensor to measure, which come from the shape so far.

    Returns:
        The edges, in the order chosen, and the entries of `prior` that stay unmeasured.
    """
    expected = hypothesis(model)
    struck = com if model.held is None else model.held.com_struck(com)
    believed = replace(expected, region=replace(expected.region, centre=struck))
    planes, _ = scanned_planes(model, footing(model, resting_planes(model), believed.region, FOOTING_MARGIN))
    axes, _ = scanned_edges(model, pivot_axes(model, spec, planes, believed))
    rows = [moment_row(axis.direction) for axis in axes]
    information = np.eye(len(TENSOR_ENTRIES)) + sum(
        (_information(moment_row(direction)) for direction in made), np.zeros((len(TENSOR_ENTRIES),) * 2)
    )
    wanted = [TENSOR_ENTRIES.index(entry) for entry in prior]
    chosen: list[PivotAxis] = []
    while axes:
        left = [place for place in wanted if not _measured(information)[place]]
        after = [information + _information(row) for row in rows]
        gains = [
            (int(_measured(each)[left].sum()), float(np.log(_sd(information) / _sd(each))[left].sum()))
            for each in after
        ]
        best = max(range(len(axes)), key=gains.__getitem__)
        if not left or gains[best][1] < MIN_GAIN:
            break
        chosen.append(axes[best])
        information = after[best]
    reached = _measured(information)
    return AdditionalEdges(
        tuple(chosen), tuple(TENSOR_ENTRIES[place] for place in wanted if not reached[place])
    )


def _information(row: Array) -> Array:
    """Fisher information (6, 6) about the tensor's six entries from measuring one moment of inertia.

    It is in units of the entries' prior standard deviations; the moment's sd is `STRIKE_SD_FRACTION` of such
    a unit. The moment is the product of `row` (6,) and the entries.
    """
    return np.outer(row, row) / STRIKE_SD_FRACTION**2


def _sd(information: Array) -> Array:
    """Standard deviations (6,) of the inertia tensor's entries, divided by those of the prior.

    The order is that of `TENSOR_ENTRIES`. `information` (6, 6) is the Fisher information about the entries,
    in units of their prior sd; the prior is the assumption from the shape alone.
    """
    return np.sqrt(np.diag(np.linalg.inv(information)))


def _measured(information: Array) -> BoolArray:
    """Mask (6,) of the inertia tensor's entries that count as measured, in the order of `TENSOR_ENTRIES`.

    Their standard deviation is below `MEASURED_FRACTION` of the prior's (the assumption from the shape).

    Args:
        information: (6, 6) Fisher information about the entries, in units of their prior sd.
    """
    return _sd(information) < MEASURED_FRACTION
