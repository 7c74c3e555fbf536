"""Preparation of a plan: the pivot axes (edges about which an object tips) are found and checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analyze.geometry.edge_radius import stated_radius
from analyze.geometry.object_model import ObjectModel
from analyze.planning import design
from analyze.planning.earlier_results import EarlierResult, updated_hypothesis, with_strikes_made
from analyze.planning.examine import TURNED, Bench, UsableAxis, examine
from analyze.planning.footing import Q_SCALES, STRIP_AREA_FRACTION, footing
from analyze.planning.hypothesis import Hypothesis, body_size, hypothesis
from analyze.planning.information import Belief, Information, SharedErrors
from analyze.planning.next_edge import (
    CARRYING_SHARE,
    next_edge_rejection,
    over_close_lines,
    over_next_line,
    with_next_edge,
)
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.rim_tangents import named_tangents
from analyze.planning.stable_planes import RestingPlane, resting_planes
from analyze.planning.unscanned import scanned_edges, scanned_planes
from analyze.planning.view import FAULT_CODES
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Rejection

FRICTION = 0.4
"""Friction coefficient between object and table, if none is given."""
MAX_COM_ERROR = 0.01
"""Expected error of the centre of mass, over the body's size, above which further axes are looked for."""
WORTHWHILE = 0.5
"""Factor by which less certain axes, or another striker or mat, must reduce the error of c to be used where c
is determined without them."""
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
    given: EarlierResult | None = None
    """Result of the strikes made before; None if there are none."""

    @property
    def made(self) -> int:
        """Number of strikes made before."""
        return 0 if self.given is None else len(self.given.strikes)

    @property
    def com_error(self) -> float:
        """Expected rms error of c [m] with the usable axes; inf if they do not determine it."""
        return design.usual_com_rms(self.information)

    @property
    def is_accurate(self) -> bool:
        """True if the usable axes determine the centre of mass to `MAX_COM_ERROR` of the body's size."""
        return self.com_error <= MAX_COM_ERROR * body_size(self.model)

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
    of Q. If these axes do not determine c to `MAX_COM_ERROR` of the body's size, edges whose tags the camera
    sees only with object and striker turned by 180 degrees are added; then axes on lines that land before
    balance and over which it then balances. Then the same is done for half of Q, then for its centre alone;
    at last rounded or bevelled edges are added, of whose several close lines any may carry at balance. The
    first axes that determine c at all are kept if the others do not make its error smaller by `WORTHWHILE`.

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
        struck = [strike.axis_id for strike in given.strikes]
        every += named_tangents(struck, model, spec, planes, believed.region.centre)
        belief = with_strikes_made(belief, given, every, believed, spec.mass_kg, bench.gravity)
    shared = replace(
        errors or SharedErrors(),
        scale=spec.shape.scale_sd,
        edge_radius=stated_radius(spec).sd,
        mass=spec.mass_sd_kg / spec.mass_kg,
    )
    search = _Search(model, spec, bench, believed, Information((), belief, shared))
    for share in Q_SCALES:
        known: set[str] = {plane.id for plane in search.standing}
        search.standing = model.cached(
            ("standing", *search.shape_key, share),
            lambda model, share=share: footing(model, planes, believed.region, share),
        )
        new = [plane for plane in search.standing if plane.id not in known]
        found = model.cached(
            ("axes", *search.shape_key, *(plane.id for plane in new)),
            lambda model, new=new: _axes_on(model, spec, new, believed),
        )
        search.stable += found.planes
        search.rejected += found.rejected
        search.waiting += found.axes
        if search.use_carrying(min(share, CARRYING_SHARE)) or search.use_next():
            break
    else:
        search.use_close()
    search = search.best()
    return PreparedObject(
        model,
        spec,
        bench,
        planes,
        tuple(search.stable),
        believed,
        tuple(search.usable),
        (
            *_unstable(planes, search.standing, believed),
            *search.rejected,
            *(next_edge_rejection(axis, believed) for axis in search.waiting),
        ),
        search.information,
        given,
    )


@dataclass(frozen=True)
class _AxesFound:
    """Pivot axes of some faces: what depends on the shape, not on the bench (striker, camera, table)."""

    planes: tuple[RestingPlane, ...]
    """Those of the faces that were scanned."""
    axes: tuple[PivotAxis, ...]
    """Pivot axes on them, each with the edge that lands next."""
    rejected: tuple[Rejection, ...]
    """Faces and edges that were not scanned."""


def _axes_on(
    model: ObjectModel, spec: ObjectSpec, planes: Sequence[RestingPlane], believed: Hypothesis
) -> _AxesFound:
    """Pivot axes of some faces, each with the edge that lands next as the object tips over it."""
    scanned, bare = scanned_planes(model, planes)
    axes, cut = scanned_edges(model, pivot_axes(model, spec, scanned, believed))
    next_edges = tuple(with_next_edge(model, axis, believed.region) for axis in axes)
    return _AxesFound(tuple(scanned), next_edges, (*bare, *cut))


@dataclass
class _Search:
    """Axes that passed every check so far, those rejected, and those that wait for a reason to be used.

    c is the centre of mass, Q the region believed to hold it.
    """

    model: ObjectModel
    """Shape of the object."""
    spec: ObjectSpec
    """Mass, edge radius, markers."""
    bench: Bench
    """Striker, camera and table."""
    believed: Hypothesis
    """Q, and inertia per kilogram."""
    information: Information
    """Information of the usable axes."""
    usable: list[UsableAxis] = field(default_factory=list[UsableAxis])
    """Axes that passed every check."""
    rejected: list[Rejection] = field(default_factory=list[Rejection])
    """Reasons why others are not used."""
    waiting: list[PivotAxis] = field(default_factory=list[PivotAxis])
    """Axes that were not checked yet, as their next edge may land before balance."""
    standing: tuple[RestingPlane, ...] = ()
    """Faces on which the object stands for the share of Q that was last tried."""
    stable: list[RestingPlane] = field(default_factory=list[RestingPlane])
    """Those of the faces tried that were scanned."""
    com_error: float = np.inf
    """Expected rms error of c [m] with the usable axes; inf if they do not determine it."""
    first: _Search | None = None
    """State in which c was determined first; None until then."""

    @cached_property
    def shape_key(self) -> tuple[str, bytes]:
        """Object file and region Q: all that faces and axes depend on besides the shape.

        Mats, strikers and fillings are tried in turn on one shape, for which both stay as they are.
        """
        region = self.believed.region
        arrays = [region.centre, region.axes, region.half, np.array(region.groups)]
        return self.spec.model_dump_json(), b"".join(each.tobytes() for each in arrays)

    def best(self) -> _Search:
        """This state, or the first one that determined c, if the axes added since are not `WORTHWHILE`."""
        if self.first is None or self.com_error < WORTHWHILE * self.first.com_error:
            return self
        return self.first

    def use_carrying(self, share: float) -> bool:
        """Use waiting axes that carry up to balance for a share of Q; True if c is then known well.

        If it is not, edges are added whose tags the camera sees with object and striker turned by 180
        degrees.

        Args:
            share: Scale of Q about its centre.
        """
        carrying = [axis for axis in self.waiting if axis.carries_for(share)]
        self.waiting = [axis for axis in self.waiting if not axis.carries_for(share)]
        unseen = {each.axis_id for each in self._use(carrying) if each.code in FAULT_CODES}
        if self._suffices():
            return True
        turned = [axis for axis in carrying if axis.id in unseen]
        passed, _ = examine(self.model, self.spec, turned, self.believed, self.bench, TURNED)
        seen = {each.candidate.axis.id for each in passed}
        self.usable += passed
        self.rejected = [each for each in self.rejected if each.axis_id not in seen]
        return self._suffices()

    def use_next(self) -> bool:
        """Use lines that land before balance and then carry; True if c is then known well."""
        return self._use_instead({axis.id: over_next_line(axis) for axis in self.waiting})

    def use_close(self) -> bool:
        """Use axes amid close lines, as of a rounding's facets; True if c is then known well."""
        region = self.believed.region
        return self._use_instead(
            {
                axis.id: self.model.cached(
                    ("close lines", *self.shape_key, axis.id),
                    lambda model, axis=axis: over_close_lines(model, axis, region),
                )
                for axis in self.waiting
            }
        )

    def _use_instead(self, others: Mapping[str, PivotAxis | None]) -> bool:
        """Use other axes in place of waiting ones; True if the centre of mass is then known well.

        Args:
            others: Axis to use by the id of each waiting one; None leaves it waiting.
        """
        self.waiting = [axis for axis in self.waiting if others[axis.id] is None]
        self._use([axis for axis in others.values() if axis is not None])
        return self._suffices()

    def _use(self, axes: Sequence[PivotAxis]) -> list[Rejection]:
        """Add the axes that pass every check, and the rejections of the others, which are returned."""
        passed, failed = examine(self.model, self.spec, axes, self.believed, self.bench)
        self.usable += passed
        self.rejected += failed
        return failed

    def _suffices(self) -> bool:
        """Update information and error of the usable axes; True if the error is at most `MAX_COM_ERROR`.

        The error is that of the centre of mass, over the body's size. The first state that determines the
        centre of mass at all is kept in `first`.
        """
        self.information = replace(self.information, candidates=tuple(each.candidate for each in self.usable))
        self.com_error = design.usual_com_rms(self.information)
        if self.first is None and np.isfinite(self.com_error):
            copies = {name: list(getattr(self, name)) for name in ("usable", "rejected", "waiting", "stable")}
            self.first = replace(self, **copies)
        return self.com_error <= MAX_COM_ERROR * body_size(self.model)


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
