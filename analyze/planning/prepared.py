"""Preparation of a plan: the pivot axes (edges about which an object tips) are found and checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.geometry.edge_radius import stated_radius
from analyze.geometry.object_model import ObjectModel
from analyze.planning import design
from analyze.planning.earlier_results import EarlierResult, updated_hypothesis, with_strikes_made
from analyze.planning.examine import Bench, UsableAxis, examine
from analyze.planning.footing import Q_SCALES, STRIP_AREA_FRACTION, footing
from analyze.planning.hypothesis import Hypothesis, body_size, hypothesis
from analyze.planning.information import Belief, Information, SharedErrors
from analyze.planning.next_edge import CARRYING_SHARE, next_edge_rejection, over_next_line, with_next_edge
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import RestingPlane, resting_planes
from analyze.planning.unscanned import scanned_edges, scanned_planes
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Rejection

FRICTION = 0.4
"""Friction coefficient between object and table, if none is given."""
INERTIA_SD = 0.3
"""Relative prior 1 sigma of the moment about any direction: shell or solid, uniform or not."""


@dataclass(frozen=True)
class PreparedObject:
    """Object, bench (striker, camera, table) and checked pivot axes: the input for planning strikes.

    c is the centre of mass, Q the region that is believed to hold it. A pivot axis is an edge about which the
    object tips.
    """

    model: ObjectModel
    """Shape of the object."""
    spec: ObjectSpec
    """Object file: mass, edge radius, markers."""
    bench: Bench
    """Striker, camera and table."""
    planes: tuple[RestingPlane, ...]
    """All resting planes of the object, largest first."""
    stable: tuple[RestingPlane, ...]
    """Faces that are planned on: scanned ones that hold all of Q or, if needed, the expected c only."""
    believed: Hypothesis
    """Region Q of c, and inertia per kilogram."""
    usable: tuple[UsableAxis, ...]
    """Axes that passed every check."""
    rejected: tuple[Rejection, ...]
    """Reasons why the other axes and faces are not used."""
    information: Information
    """Information of the usable axes about c and the inertia."""
    made: int
    """Number of strikes made before."""

    @property
    def unsure(self) -> frozenset[str]:
        """Ids of the faces in the plan that do not hold all of Q, the region of the centre of mass.

        On these faces the object may fall over.
        """
        return frozenset(plane.id for plane in self.stable if plane.margin_of(self.believed.region) <= 0)


def prepare_object(
    model: ObjectModel,
    spec: ObjectSpec,
    bench: Bench,
    errors: SharedErrors | None = None,
    given: EarlierResult | None = None,
) -> PreparedObject:
    """Find and check the pivot axes (edges about which it tips) of an object.

    Q is the region believed to hold the centre of mass c. The axes belong to faces on which the object stands
    for all of Q, and it balances over their edges, before the next edge lands, for the share `CARRYING_SHARE`
    of Q. If these axes do not determine c, axes are added on lines that land before balance and over which it
    then balances. Then the same is done for half of Q, at last for its centre alone.

    Args:
        model: Shape of the object.
        spec: Mass, edge radius, markers.
        bench: Striker, camera and table.
        errors: Errors of the rig that strikes share, None for the defaults; scale, edge radius and mass are
            replaced by those of `spec`.
        given: Earlier result of the object, None if there is none.

    Returns:
        The object with its usable axes, perhaps none, the Fisher information about c and the inertia that
        strikes on them give, and the rejections of the other axes and faces.

    Raises:
        PlanError: a strike in `given` is on an axis that the object does not have.
    """
    believed = hypothesis(model)
    planes = resting_planes(model)
    if given is not None:
        believed = updated_hypothesis(believed, given)
    inertia = spec.mass_kg * believed.unit_inertia
    belief = Belief(body_size(model) / 4, inertia, INERTIA_SD * float(np.trace(inertia)) / 3)
    if given is not None:
        every = pivot_axes(model, spec, planes, believed)
        belief = with_strikes_made(belief, given, every, believed, spec.mass_kg, bench.gravity)
    shared = replace(
        errors or SharedErrors(),
        scale=spec.shape.scale_sd,
        edge_radius=stated_radius(spec).sd,
        mass=spec.mass_sd_kg / spec.mass_kg,
    )
    information = Information((), belief, shared)
    standing: tuple[RestingPlane, ...] = ()
    stable: list[RestingPlane] = []
    usable: list[UsableAxis] = []
    left_out: list[Rejection] = []
    waiting: list[PivotAxis] = []
    for share in Q_SCALES:
        known: set[str] = {plane.id for plane in standing}
        standing = footing(model, planes, believed.region, share)
        scanned, bare = scanned_planes(model, [plane for plane in standing if plane.id not in known])
        axes, cut = scanned_edges(model, pivot_axes(model, spec, scanned, believed))
        waiting += [with_next_edge(model, axis, believed.region) for axis in axes]
        carried = min(share, CARRYING_SHARE)
        carrying = [axis for axis in waiting if axis.carries_for(carried)]
        waiting = [axis for axis in waiting if not axis.carries_for(carried)]
        passed, failed = examine(model, spec, carrying, believed, bench)
        stable += scanned
        usable += passed
        left_out += [*bare, *cut, *failed]
        information = replace(information, candidates=tuple(each.candidate for each in usable))
        if design.can_determine_com(information):
            break
        over_next = [line for axis in waiting if (line := over_next_line(axis)) is not None]
        waiting = [axis for axis in waiting if over_next_line(axis) is None]
        passed, failed = examine(model, spec, over_next, believed, bench)
        usable += passed
        left_out += failed
        information = replace(information, candidates=tuple(each.candidate for each in usable))
        if design.can_determine_com(information):
            break
    return PreparedObject(
        model,
        spec,
        bench,
        planes,
        tuple(stable),
        believed,
        tuple(usable),
        (
            *_unstable(planes, standing, believed),
            *left_out,
            *(next_edge_rejection(axis, believed) for axis in waiting),
        ),
        information,
        0 if given is None else len(given.strikes),
    )


def _unstable(
    planes: Sequence[RestingPlane], stable: Sequence[RestingPlane], believed: Hypothesis
) -> list[Rejection]:
    """One rejection for each face on which the object may fall over.

    Its `number` is the smallest distance [m] of Q, the region of the centre of mass, projected on the face,
    from the face's edges; it is negative if part of Q lies outside. Narrow faces (strips), as of round
    flanks, share one rejection, whose `number` is their count.

    Args:
        planes: All resting planes.
        stable: Faces on which the object stands as surely as the plan needs; all others are rejected.
        believed: Hypothesis with the region Q.
    """
    names = {plane.id for plane in stable}
    left = [plane for plane in planes if plane.id not in names]
    strips = [plane for plane in left if plane.area < STRIP_AREA_FRACTION * sum(each.area for each in planes)]
    text = "the object may fall over on this face: its centre of mass may lie outside the support"
    rejected = [
        Rejection(axis_id=plane.id, code="unstable_plane", number=plane.margin_of(believed.region), text=text)
        for plane in left
        if plane not in strips
    ]
    if strips:
        text = (
            "narrow faces of a round or bevelled flank, on which the object rolls; the number is their count"
        )
        rejected.append(
            Rejection(
                axis_id=f"{strips[0].id}..{strips[-1].id}", code="flank", number=float(len(strips)), text=text
            )
        )
    return rejected
