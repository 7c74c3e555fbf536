"""All tips that an object can make: from each face on which it may stand, over each edge of that face.

Whether a striker, a hand or a camera could make or see such a tip is not asked: strikes that were made
without a plan are recognised among them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning.footing import footing
from analyze.planning.hypothesis import Hypothesis, hypothesis
from analyze.planning.impact import GRAVITY
from analyze.planning.next_edge import CARRYING_SHARE, over_close_lines, over_next_line, with_next_edge
from analyze.planning.pivots import PivotAxis, Swing, phi_spread, pivot_axes, swing
from analyze.planning.rim_tangents import tangent_in_degrees
from analyze.planning.rims import round_rim
from analyze.planning.stable_planes import RestingPlane, resting_planes
from analyze.planning.unscanned import scanned_edges, scanned_planes
from analyze.types import Array
from schemas.object_spec import ObjectSpec

ANY_FOOTING = -1.0
"""share of the region of the centre of mass at which a face counts if any place in the region is above it"""
MAX_LEVEL_ANGLE = math.radians(20.0)
"""largest angle between a seen turning line and a face for a tip over that face's rim [rad]"""
SAME_TANGENT = math.radians(2.0)
"""angle between two tips over one rim below which they are one: as well as a hand repeats a heading [rad]"""


@dataclass(frozen=True)
class PossibleTip:
    """Tip from a resting face over one edge, with its swing for the expected centre of mass."""

    axis: PivotAxis
    """Edge about which the object tips, with the face that it rests on."""
    expected: Swing
    """Balance angle, rate and moment about the edge, for the expected centre of mass and inertia."""
    phi_sd: float
    """1 sigma of the balance angle as the centre of mass varies over its region [rad]."""
    stands_surely: bool
    """True if the object stands on the face wherever in its region the centre of mass is."""


class PossibleTips:
    """All tips that an object can make, with the names of faces and edges that plans give them.

    Args:
        model: Shape of the object.
        spec: Object file: mass, edge radius and markers.
    """

    def __init__(self, model: ObjectModel, spec: ObjectSpec) -> None:
        self._model, self._spec = model, spec
        self._believed = hypothesis(model)
        standing = footing(model, resting_planes(model), self._believed.region, ANY_FOOTING)
        self._planes, _ = scanned_planes(model, standing)
        axes, _ = scanned_edges(model, pivot_axes(model, spec, self._planes, self._believed))
        self._tangents = [axis for axis in axes if axis.rolls]
        self.tips = tuple(self._tip(axis) for axis in axes if _can_balance(axis, self._believed))
        """Tips over straight edges, and over those tangents of rims that plans use."""

    def over_rims(self, direction: Array) -> tuple[PossibleTip, ...]:
        """Tips over round rims about a tangent in a given direction.

        A tangent that differs from one of a plan by less than `SAME_TANGENT` is that one; others are named by
        the direction of the tip in the face's plane, in whole degrees, as p0t143deg.

        Args:
            direction: (3,) unit direction of the line about which the object turned, in the object frame.
        """
        found: list[PossibleTip] = []
        for plane in self._planes:
            axis = self._tangent(plane, direction)
            if axis is not None and _can_balance(axis, self._believed):
                found.append(self._tip(axis))
        return tuple(found)

    def _tangent(self, plane: RestingPlane, direction: Array) -> PivotAxis | None:
        """Pivot axis of a tip over a face's rim about a seen direction; None if no rim lies there."""
        rim = round_rim(plane)
        ahead = np.cross(direction, plane.up)
        if not rim.any() or np.linalg.norm(ahead) < math.cos(MAX_LEVEL_ANGLE):
            return None
        ahead /= np.linalg.norm(ahead)
        if not rim[int(np.argmax(plane.outward @ ahead))]:
            return None
        near = [
            axis
            for axis in self._tangents
            if axis.plane.id == plane.id and axis.tip @ ahead > math.cos(SAME_TANGENT)
        ]
        if near:
            return max(near, key=lambda axis: float(axis.tip @ ahead))
        return tangent_in_degrees(self._model, self._spec, plane, ahead, self._believed.region.centre)

    def _tip(self, axis: PivotAxis) -> PossibleTip:
        """Tip over an edge, or over the line that takes over from it before balance."""
        carried = _carrying(self._model, axis, self._believed)
        region = self._believed.region
        expected = swing(carried, region.centre, self._spec.mass_kg, self._believed.unit_inertia, GRAVITY)
        return PossibleTip(
            carried, expected, phi_spread(carried, self._believed), axis.plane.margin_of(region) > 0
        )


def _carrying(model: ObjectModel, axis: PivotAxis, believed: Hypothesis) -> PivotAxis:
    """Pivot axis as plans use it: with the edge that lands next, or with the line that takes over from it."""
    axis = with_next_edge(model, axis, believed.region)
    if axis.carries_for(CARRYING_SHARE):
        return axis
    return over_next_line(axis) or over_close_lines(model, axis, believed.region) or axis


def _can_balance(axis: PivotAxis, believed: Hypothesis) -> bool:
    """True if the centre of the edge's rounding lies below the expected centre of mass."""
    return float((believed.region.centre - axis.point) @ axis.plane.up) > 0
