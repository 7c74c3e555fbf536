"""One-line message why no plan can be made, with a remedy: stand, stick-on foot, mat, tags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Set

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning import next_edge, unscanned
from analyze.planning.information import unknown_direction
from analyze.planning.prepared import PreparedObject
from analyze.planning.rejections import rejection_summary
from analyze.planning.remedies import first_remedy
from analyze.types import Array
from schemas.wording import counted

MAX_BALL_SPREAD = 0.08
"""Relative spread of the hull's widths over all directions below which the object is a ball."""
MAX_ROUND_SPREAD = 0.08
"""Relative spread of the hull's widths across one direction below which the object is round about it."""
MIN_FACE_SHARE = 0.02
"""Fraction of all resting planes' area up to which one counts as a strip of a round flank; and fraction of
the surface up to which a part that was not scanned does not explain that the object stands on no face."""
WIDTH_DIRECTIONS = 400
"""Number of directions in which widths are measured."""
MIN_BARE_SHARE = 0.005
"""Fraction of the surface up to which an unscanned part is too small for the rest to be a part of a ball."""
MIN_BALL_SHARE = 0.3
"""Fraction of a sphere that must be scanned to recognise it."""
FOOT = (
    "print a base (`analyze fixture`), or stick on a foot (a flat plate with straight edges, its weight "
    "given as a marker's), scan both together, and plan again"
)
"""Remedy for objects without usable edges."""
UPRIGHT_FOOT = (
    "print a base (`analyze fixture`), or glue it upright on a foot (a flat plate with straight edges, its "
    "weight given as a marker's, half as wide as the object is then high), tags on all sides, scan both "
    "together, and plan again"
)
"""Remedy for objects too flat or too wide for their height, and with edges that land before balance."""
GAPS = f"the gaps of the scan leave no usable edge: {unscanned.REMEDY}"
"""Remedy for scans whose edges were not scanned."""
RESHAPED_CODES = frozenset({next_edge.CODE, "lifts", "too_steep"})
"""Codes of axes that only another shape makes usable: `UPRIGHT_FOOT`."""


def refusal_message(prepared: PreparedObject) -> str:
    """One-line message why no plan can be made: state of the object, reasons of the rejections, remedy.

    The remedy has been tried on the planner (`first_remedy`); if none of those suffices, it gives the object
    other edges.

    Args:
        prepared: Object whose usable axes do not determine the centre of mass.
    """
    model, candidates = prepared.model, prepared.information.candidates
    axes = [rejection for rejection in prepared.rejected if rejection.code not in ("unstable_plane", "flank")]
    counts = Counter(rejection.code for rejection in axes)
    if not candidates and not counts.keys() - {unscanned.CODE}:
        return f"{model.name}: {_shape_message(prepared, counts[unscanned.CODE])}"
    state = "no axis can be used"
    if candidates:
        worst = unknown_direction(np.array([each.normal for each in candidates]))
        along = ", ".join(f"{value:.2f}" for value in np.round(worst, 2) + 0.0)
        state = (
            f"the {counted(len(candidates), 'usable axis', 'leaves')} the centre of mass unknown "
            f"along ({along})"
        )
    if not counts:
        return f"{model.name}: {state}; {_too_few_faces(prepared)}: {FOOT}"
    tried = "edges and faces" if unscanned.CODE in counts else "axes" if len(axes) > 1 else "axis"
    reasons = f"{len(axes)} {tried} rejected: {rejection_summary(axes)}"
    return f"{model.name}: {state}; {reasons}: {_remedy(prepared, counts.keys())}"


def _remedy(prepared: PreparedObject, codes: Set[str]) -> str:
    """Remedy that leads to a plan: the easiest of those that were tried, else other edges.

    Args:
        prepared: Object whose usable axes do not determine the centre of mass.
        codes: Codes of the rejected axes.
    """
    if unscanned.CODE in codes:
        return GAPS
    found = first_remedy(prepared)
    if found is not None:
        return found.text
    return UPRIGHT_FOOT if codes & RESHAPED_CODES else FOOT


def _too_few_faces(prepared: PreparedObject) -> str:
    """Reason why usable axes are too few although none was rejected: faces on which it cannot stand."""
    stable, planes = prepared.stable, prepared.planes
    return f"it surely stands on {len(stable)} of {counted(len(planes), 'face')} of its hull"


def _shape_message(prepared: PreparedObject, unseen: int) -> str:
    """Message with remedy for an object of which no edge can be used because of its shape.

    The message names the case: a ball, a round body that rolls, a scan with gaps, a body that may fall over
    on every face, or one whose faces have no edge beside the centre of mass. It is never empty.

    Args:
        prepared: Object without usable axes.
        unseen: Number of faces and edges rejected because they were not scanned.
    """
    model, planes, stable = prepared.model, prepared.planes, prepared.stable
    across = _scanned_ball_diameter(model) if _unscanned_share(model) > MIN_BARE_SHARE else None
    if across is not None:
        return (
            f"what was scanned is part of a ball of {1000 * across:.0f} mm: if the rest is round too, there "
            f"is no face to rest on and no edge to tip over: set it in a ring stand glued to it, "
            f"or {FOOT}; if not: {unscanned.REMEDY}"
        )
    if _is_ball(model):
        return (
            "it is a ball: it has no face to rest on and no edge to tip over: set it in a ring stand glued "
            f"to it, or {FOOT}"
        )
    if unseen or (not stable and _unscanned_share(model) > MIN_FACE_SHARE):
        return f"{GAPS}; if a hole of the mesh is an end of the object, close it in a mesh editor"
    round_about = _axis_of_roundness(model)
    area = sum(plane.area for plane in planes)
    flat = [plane for plane in planes if plane.area > MIN_FACE_SHARE * area] if area > 0 else []
    if round_about is not None and not stable:
        along = ", ".join(f"{value:.2f}" for value in np.round(round_about, 2) + 0.0)
        return (
            f"it only rolls, about ({along}), and stands on no end: glue it to a stand that keeps it from "
            f"rolling, or {FOOT}"
        )
    if not stable:
        return (
            f"it has {counted(len(flat), 'flat face')}, but may fall over on each: the centre of mass may "
            f"lie outside every support: put it on a stand, or {FOOT}"
            if flat
            else f"it has no flat face to rest on, it rolls: put it on a stand, or {FOOT}"
        )
    return (
        f"it rests on {counted(len(stable), 'face')}, but none has an edge beside the centre of mass "
        f"to tip over: {FOOT}"
    )


def _is_ball(model: ObjectModel) -> bool:
    """True if the widths of the hull in all directions are equal within `MAX_BALL_SPREAD`."""
    widths = _widths(model, _half_sphere())
    return float(np.ptp(widths)) < MAX_BALL_SPREAD * float(widths.mean())


def _unscanned_share(model: ObjectModel) -> float:
    """Fraction of the surface that was not scanned; 0 for shapes that are not scans."""
    return 0.0 if model.scanned is None else model.scanned.bare_share


def _scanned_ball_diameter(model: ObjectModel) -> float | None:
    """Diameter [m] of the sphere that fits the scanned surface.

    None if the samples scatter about the sphere by more than `MAX_BALL_SPREAD` of its radius, if the scanned
    part is less than `MIN_BALL_SHARE` of the sphere, if fewer than `WIDTH_DIRECTIONS` samples of the surface
    were scanned, or if the shape is no scan.
    """
    if model.scanned is None:
        return None
    seen = model.scanned.surely_scanned()
    if len(seen) < WIDTH_DIRECTIONS:
        return None
    origin = seen.mean(axis=0)
    arm = seen - origin
    design = np.column_stack([2 * arm, np.ones(len(arm))])
    answer = np.linalg.pinv(design) @ np.sum(arm**2, axis=1)
    centre: Array = np.array(answer[:3], dtype=np.float64)
    radius = float(np.sqrt(max(float(answer[3]) + float(centre @ centre), 0.0)))
    off = np.linalg.norm(arm - centre, axis=1) - radius
    area = model.scanned.area * (1 - model.scanned.bare_share)
    if (
        float(np.ptp(np.quantile(off, [0.01, 0.99]))) > MAX_BALL_SPREAD * radius
        or area < MIN_BALL_SHARE * 4 * np.pi * radius**2
    ):
        return None
    return 2 * radius


def _axis_of_roundness(model: ObjectModel) -> Array | None:
    """Unit direction (3,) in the object frame about which the hull is round; None if there is none.

    The hull counts as round about one of its principal axes if its widths in all directions across this axis
    are equal within `MAX_ROUND_SPREAD`. Of several such axes, the one along which the hull extends most is
    returned. Its largest component is positive.
    """
    vertices = model.hull_vertices - model.hull_vertices.mean(axis=0)
    for axis in np.linalg.eigh(vertices.T @ vertices)[1].T[::-1]:
        u = np.linalg.svd(axis[None])[2][1:]
        turn = np.linspace(0, np.pi, 36, endpoint=False)
        widths = _widths(model, np.outer(np.cos(turn), u[0]) + np.outer(np.sin(turn), u[1]))
        if float(np.ptp(widths)) < MAX_ROUND_SPREAD * float(widths.mean()):
            return axis * np.sign(axis[int(np.argmax(np.abs(axis)))])
    return None


def _widths(model: ObjectModel, directions: Array) -> Array:
    """Widths (n,) [m] of the object's convex hull along unit `directions` (n, 3) in the object frame."""
    return np.ptp(model.hull_vertices @ directions.T, axis=0)


def _half_sphere() -> Array:
    """Unit directions (n, 3) spread evenly over the half sphere z > 0 (Fibonacci lattice)."""
    i = np.arange(WIDTH_DIRECTIONS) + 0.5
    z, turn = i / WIDTH_DIRECTIONS, i * np.pi * (1 + np.sqrt(5))
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
