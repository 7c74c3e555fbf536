"""Registration: marker poses on an object, estimated from its strikes.

A strike is one impact that tips the object about a known edge. Each strike is solved alone first, to find the
strikes before which the object was put down wrongly, then all together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.geometry.rotations import matrix_from_vector, vector_from_matrix
from analyze.registration.solution import Solution
from analyze.registration.solve import Problem
from analyze.registration.surface import MAX_TILT_ON_SURFACE, height_over, surface_under
from analyze.registration.table import LAID_BOARD, TablePrior, corrected_camera

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.registration.views import StrikeView
    from analyze.types import Array, CameraModel

MAX_SAME_TURN, MAX_SAME_DISTANCE = math.radians(5.0), 0.005
"""largest differences of a marker's pose [rad, m], in addition to its sd, between two strikes that agree on
it"""
TWISTED_RATIO, DISAGREES_RATIO, MIN_USUAL_MISFIT = 4.0, 25.0, 0.1
"""multiples of the median misfit (taken as at least the third value): above the first an impact turned the
body about the vertical, above the second the strike contradicts all others"""
MAX_TURN_SD, MAX_PLACE_SD = math.radians(0.5), 1e-3
"""standard deviations of rotation [rad] and position [m] above which a direction is undetermined"""


@dataclass(frozen=True)
class LeftOut:
    """Strike that was not used for the registration, with the reason."""

    strike_id: str
    """id of the strike"""
    reason: str
    """reason in words, with its numbers"""


@dataclass(frozen=True)
class MarkerPlace:
    """Estimated pose of one marker (frame M) on the object (frame O), with its errors."""

    marker_id: int | str
    """name of the marker"""
    T_object_marker: Array
    """(4, 4) pose of M in O"""
    covariance: Array
    """(6, 6) covariance of its turn in O [rad] and its centre in O [m]"""
    strikes: tuple[str, ...]
    """ids of the used strikes that show it"""
    rms_px: float
    """rms residual of its corners [px]"""
    on_surface: bool
    """True if its height over the surface was constrained to its card's thickness"""
    undetermined: tuple[str, ...]
    """undetermined directions in O, in words; empty if there are none"""
    remedy: str = ""
    """action that would determine these directions; empty if all are determined"""

    @property
    def turn_sd(self) -> float:
        """Standard deviation [rad] of the marker's rotation about its least certain direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def place_sd(self) -> float:
        """Standard deviation [m] of the marker's centre in its least certain direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1]))


@dataclass(frozen=True)
class TablePlace:
    """Pose of the table in one recording, relative to the recorded pose of the camera."""

    setup: int
    """number of the recording"""
    offset: Array
    """(3,) tilts about W's x and y [rad], and the height [m]"""
    sd: Array
    """(3,) standard deviations of `offset` [rad, m]"""
    T_world_camera: Array
    """(4, 4) pose of C in the W whose z = 0 is the estimated table"""
    undetermined: tuple[str, ...]
    """undetermined components, in words; empty if there are none"""


@dataclass(frozen=True)
class Registration:
    """Result of a registration: marker poses, strikes left out, joint fit and tables."""

    markers: tuple[MarkerPlace, ...]
    """pose of each marker"""
    left_out: tuple[LeftOut, ...]
    """strikes that were not used"""
    solution: Solution
    """the joint fit"""
    tables: tuple[TablePlace, ...]
    """table's pose in each recording of which a strike was used"""


def register(
    views: Sequence[StrikeView],
    sizes: Mapping[int | str, float],
    thickness: Mapping[int | str, float],
    model: ObjectModel,
    table: TablePrior = LAID_BOARD,
) -> Registration:
    """Estimate the poses (in the object frame O) of all markers that the strikes show.

    Strikes that contradict the others are left out, with the reason.

    Args:
        views: views of the strikes: marker corners at rest and while the object tips.
        sizes: edge of each marker's black square [m].
        thickness: thickness of each marker's card [m].
        model: the object's exterior.
        table: prior of the table against the recorded T_world_camera; UNKNOWN_TABLE to estimate its tilts and
            height.

    Returns:
        Pose of each marker, strikes left out, the joint fit, and the table's pose in each recording.

    Raises:
        EstimationError: no strike shows a marker or can be used, strikes contradict each other without a
            majority, two markers come out at one place, or the strikes do not determine the markers' places.
    """
    if not views:
        raise EstimationError(
            "no strike shows a marker at rest: check light and focus, and that the object file names its tags"
        )
    single, left_out = _solve_each(views, sizes, model, table)
    start, good, misplaced = _starts(views, single)
    left_out += misplaced
    used = [view for view in views if view.strike_id in good]
    if not used:
        reasons = "; ".join(f"{left.strike_id}: {left.reason}" for left in left_out)
        raise EstimationError(f"no strike can be used: {reasons}")
    twisted: set[str] = set()
    while True:
        surface = surface_under(model, start, sizes, thickness)
        solution = Problem(used, sizes, table, surface, twisted).solve(start)
        if not solution.converged:
            raise EstimationError(
                "the strikes do not determine the markers' places:"
                " strike over other edges, and on another resting face"
            )
        more = _strikes_with_misfit(solution, TWISTED_RATIO) - twisted
        if more:
            twisted |= more
            continue
        worst = max(
            _strikes_with_misfit(solution, DISAGREES_RATIO),
            key=lambda name: solution.misfit[name],
            default=None,
        )
        if worst is None or len(used) <= 2:
            break
        misfit = f"its misfit is {solution.misfit[worst]:.0f} times the noise"
        left_out.append(LeftOut(worst, f"fits with no other strike ({misfit}): left out"))
        used = [view for view in used if view.strike_id != worst]
        start = {**start, **solution.T_object_marker}
    _refuse_overlapping_markers(used, solution, sizes)
    held = surface_under(model, start, sizes, thickness).fits
    return Registration(
        tuple(_marker_place(name, solution, used, name in held) for name in solution.T_object_marker),
        tuple(left_out),
        solution,
        tuple(
            _table_place(setup, solution, next(view.camera for view in used if view.setup == setup))
            for setup in solution.table
        ),
    )


def _solve_each(
    views: Sequence[StrikeView], sizes: Mapping[int | str, float], model: ObjectModel, table: TablePrior
) -> tuple[dict[str, Solution], list[LeftOut]]:
    """Marker and table poses from each strike alone, by strike id, and strikes without a fit, with reason.

    Args:
        views: views of the strikes.
        sizes: edge of each marker's black square [m].
        model: the object's exterior.
        table: prior of the table's pose.
    """
    single: dict[str, Solution] = {}
    left_out: list[LeftOut] = []
    for view in views:
        try:
            single[view.strike_id] = _solve_alone(view, sizes, model, table)
        except EstimationError as error:
            left_out.append(LeftOut(view.strike_id, f"{error}: is its marker the right one?"))
    return single, left_out


def _starts(
    views: Sequence[StrikeView], single: Mapping[str, Solution]
) -> tuple[dict[int | str, Array], set[str], list[LeftOut]]:
    """First pose of each marker, the ids of the strikes that agree on them, and the strikes left out.

    The first pose T_object_marker (4, 4) of a marker is that of the agreeing strike that determines its
    rotation best. A strike that disagrees on one marker is left out for all markers.

    Args:
        views: views of the strikes.
        single: solution of each strike alone, by strike id.

    Raises:
        EstimationError: two equally large sets of strikes disagree on a marker.
    """
    start: dict[int | str, Array] = {}
    good = set(single)
    left_out: list[LeftOut] = []
    for name in dict.fromkeys(i for view in views for i in view.marker_ids):
        some = [view for view in views if name in view.marker_ids and view.strike_id in good]
        if not some:
            continue
        agreeing = _agreeing(some, single, name)
        start[name] = single[agreeing[0].strike_id].T_object_marker[name]
        for view in some:
            if view not in agreeing:
                good.discard(view.strike_id)
                found = single[view.strike_id].T_object_marker[name]
                left_out.append(LeftOut(view.strike_id, _placement_difference(view, found, start[name])))
    return start, good, left_out


def _solve_alone(
    view: StrikeView, sizes: Mapping[int | str, float], model: ObjectModel, table: TablePrior
) -> Solution:
    """Poses of a strike's markers and of the table, from this strike alone.

    The fit starts from the object's planned orientation; a marker that is nearly parallel to the surface
    under it is first turned parallel to it.

    Args:
        view: view of the strike.
        sizes: edge of each marker's black square [m].
        model: the object's exterior.
        table: prior of the table's pose.

    Raises:
        EstimationError: the iteration diverges.
    """
    camera = view.camera
    R_world_camera, p_world_camera = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    start: dict[int | str, Array] = {}
    for name, R, p in zip(view.marker_ids, view.R_camera_marker, view.p_camera_marker, strict=True):
        T = np.eye(4)
        T[:3, :3] = view.R_world_object.T @ R_world_camera @ R
        T[:3, 3] = (
            view.R_world_object.T @ (R_world_camera @ p + p_world_camera - np.array([0, 0, view.radius]))
            + view.p_object_pivot
        )
        start[name] = _flattened_pose(T, model)
    return Problem([view], sizes, table, surface_under(model, start, sizes, {})).solve(start)


def _flattened_pose(T: Array, model: ObjectModel) -> Array:
    """Pose T_object_marker (4, 4) of a marker turned so that its normal is that of the surface under it.

    If the two normals are more than 30 deg apart, the pose is returned as it is. A square seen face-on hardly
    shows its tilt.

    Args:
        T: (4, 4) pose T_object_marker.
        model: the object's exterior.
    """
    _, normal = height_over(model, T[:3, 3])
    axis = np.cross(T[:3, 2], normal)
    sine, cosine = float(np.linalg.norm(axis)), float(T[:3, 2] @ normal)
    if cosine < math.cos(2 * MAX_TILT_ON_SURFACE) or sine < 1e-9:
        return T
    flat = T.copy()
    flat[:3, :3] = matrix_from_vector(axis / sine * math.atan2(sine, cosine)) @ T[:3, :3]
    return flat


def _agreeing(
    views: Sequence[StrikeView], single: Mapping[str, Solution], name: int | str
) -> list[StrikeView]:
    """Views of the largest set of strikes that agree on a marker's pose, the most accurate first.

    Args:
        views: views of the strikes that show the marker.
        single: solution of each strike alone, by strike id.
        name: name of the marker.

    Raises:
        EstimationError: two sets are equally large, so that neither can be preferred.
    """
    agree = [[_agree_on(single[a.strike_id], single[b.strike_id], name) for b in views] for a in views]
    sets = {tuple(i for i in range(len(views)) if row[i]) for row in agree}
    ranked = sorted(sets, key=len, reverse=True)
    best = ranked[0]
    if len(best) < len(views):
        rival = next(
            (other for other in ranked[1:] if len(other) == len(best) and not set(other) & set(best)), None
        )
        if rival is not None:
            one, two = (", ".join(views[i].strike_id for i in each) for each in (best, rival))
            turned = _placement_difference(
                views[rival[0]],
                *(single[views[each[0]].strike_id].T_object_marker[name] for each in (rival, best)),
            )
            raise EstimationError(
                f"strikes {one} and {two} contradict each other on marker {name} ({turned}):"
                " find the one that was not placed as on its card, and leave it out with --exclude"
            )
    return sorted(
        (views[i] for i in best),
        key=lambda view: float(np.trace(single[view.strike_id].covariance[name][:3, :3])),
    )


def _agree_on(one: Solution, two: Solution, name: int | str) -> bool:
    """True if two solutions agree on a marker's pose, within their errors and about 5 deg and 5 mm.

    Args:
        one: solution of one strike alone.
        two: solution of another strike alone.
        name: name of the marker, which both contain.
    """
    a, b = one.T_object_marker[name], two.T_object_marker[name]
    covariance = one.covariance[name] + two.covariance[name]
    difference = np.concatenate([vector_from_matrix(a[:3, :3] @ b[:3, :3].T), a[:3, 3] - b[:3, 3]])
    allowed = covariance + np.diag([MAX_SAME_TURN**2 / 9] * 3 + [MAX_SAME_DISTANCE**2 / 9] * 3)
    return float(difference @ np.linalg.solve(allowed, difference)) < 25.0


def _placement_difference(view: StrikeView, found: Array, expected: Array) -> str:
    """Error of the object's placement before a strike, in words: turned, on another face or edge.

    Args:
        view: view of the strike.
        found: (4, 4) pose T_object_marker of a marker, estimated from this strike as if placed as planned.
        expected: (4, 4) its pose by the other strikes.
    """
    turn = view.R_world_object @ found[:3, :3] @ expected[:3, :3].T @ view.R_world_object.T
    vector = vector_from_matrix(turn.T)
    angle = math.degrees(float(np.linalg.norm(vector)))
    if angle < math.degrees(MAX_SAME_TURN):
        apart_mm = 1000 * float(np.linalg.norm(found[:3, 3] - expected[:3, 3]))
        return f"its marker is {apart_mm:.0f} mm from where other strikes show it: struck over another edge"
    if abs(vector[2]) > 0.9 * np.linalg.norm(vector):
        return f"not placed as on its card: turned by {angle:.0f} deg about the vertical"
    return f"not placed as on its card: turned by {angle:.0f} deg, on another face"


def _strikes_with_misfit(solution: Solution, times: float) -> set[str]:
    """Ids of the strikes whose misfit to the joint fit exceeds `times` the median misfit.

    The misfit is chi^2 per degree of freedom. The median counts as at least 0.1.
    """
    usual = max(float(np.median(list(solution.misfit.values()))), MIN_USUAL_MISFIT)
    return {name for name, misfit in solution.misfit.items() if misfit > times * usual}


def _refuse_overlapping_markers(
    used: Sequence[StrikeView], solution: Solution, sizes: Mapping[int | str, float]
) -> None:
    """Raise an error if two markers come out at one place.

    One of them was then struck in a wrong placement. Otherwise nothing is done.

    Args:
        used: views of the strikes that were used.
        solution: the joint fit.
        sizes: edge of each marker's black square [m].

    Raises:
        EstimationError: two markers that face the same way are closer than the mean of their edges.
    """
    names = list(solution.T_object_marker)
    for i, one in enumerate(names):
        for two in names[i + 1 :]:
            a, b = solution.T_object_marker[one], solution.T_object_marker[two]
            near = float(np.linalg.norm(a[:3, 3] - b[:3, 3])) < 0.5 * (sizes[one] + sizes[two])
            if near and float(a[:3, 2] @ b[:3, 2]) > 0.5:
                by = {
                    name: ", ".join(view.strike_id for view in used if name in view.marker_ids)
                    for name in (one, two)
                }
                raise EstimationError(
                    f"markers {one} (strikes {by[one]}) and {two} (strikes {by[two]}) come out at one place:"
                    " in the strikes of one of them the object was not placed as on its card:"
                    " find them, and leave them out with --exclude"
                )


def _marker_place(
    name: int | str, solution: Solution, used: Sequence[StrikeView], on_surface: bool
) -> MarkerPlace:
    """Estimated pose of one marker, with the directions that the strikes leave open, and a remedy.

    Args:
        name: name of the marker.
        solution: the joint fit.
        used: views of the strikes that were used.
        on_surface: True if the marker was constrained to the body's surface.
    """
    covariance = solution.covariance[name]
    mine = [view for view in used if name in view.marker_ids]
    words = [
        *(f"turn about {_axis(v)}" for v in _undetermined_directions(covariance[:3, :3], MAX_TURN_SD)),
        *(f"place along {_axis(v)}" for v in _undetermined_directions(covariance[3:, 3:], MAX_PLACE_SD)),
    ]
    return MarkerPlace(
        name,
        solution.T_object_marker[name],
        covariance,
        tuple(view.strike_id for view in mine),
        solution.rms_px[name],
        on_surface,
        tuple(words),
        _remedy(mine) if words else "",
    )


def _remedy(mine: Sequence[StrikeView]) -> str:
    """Action, in words, that would determine the directions of a marker's pose that are still open.

    Args:
        mine: views of the strikes that show the marker.
    """
    tipped = [view for view in mine if len(view.theta) > 1]
    if any(view.rolls for view in mine):
        return "the body is round there: its turn about its axis is unknown: measure T_object_marker by hand"
    if not tipped and any(view.on_curve for view in mine):
        return (
            "the body rolls on a curve there, about no line:"
            " strike it over a sharp edge, or measure T_object_marker by hand"
        )
    if not tipped:
        return "strike the object so that this marker is seen while it tips"
    return "strike it on another resting face, over an edge that is not parallel to " + ", ".join(
        sorted({v.axis_id for v in tipped})
    )


def _undetermined_directions(covariance: Array, limit: float) -> list[Array]:
    """Unit vectors (3,) along which the standard deviation exceeds `limit`; empty if there are none.

    Args:
        covariance: (3, 3) covariance of a turn [rad^2] or a place [m^2].
        limit: standard deviation [rad or m].
    """
    values, vectors = np.linalg.eigh(covariance)
    return [vectors[:, i] for i in range(3) if math.sqrt(max(float(values[i]), 0.0)) > limit]


def _axis(vector: Array) -> str:
    """Name of a direction (3,) in the object frame O, regardless of its sign: an axis, or its components."""
    v = vector if vector[np.argmax(np.abs(vector))] > 0 else -vector
    largest = int(np.argmax(v))
    if v[largest] > 0.99:
        return f"O's {'xyz'[largest]}"
    return f"({v[0]:.2f}, {v[1]:.2f}, {v[2]:.2f}) in O"


def _table_place(setup: int, solution: Solution, camera: CameraModel) -> TablePlace:
    """Pose of the table in one recording, with the names of the tilts or height left undetermined.

    Args:
        setup: number of the recording.
        solution: the joint fit.
        camera: camera of the recording with its recorded pose.
    """
    offset, sd = solution.table[setup], np.sqrt(np.diag(solution.table_covariance[setup]))
    names = ("tilt about W's x", "tilt about W's y", "height")
    limits = (MAX_TURN_SD, MAX_TURN_SD, MAX_PLACE_SD)
    unknown = tuple(name for name, value, limit in zip(names, sd, limits, strict=True) if value > limit)
    return TablePlace(setup, offset, sd, corrected_camera(camera, offset).T_world_camera, unknown)
