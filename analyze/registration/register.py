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
from analyze.registration.places import MarkerPlace, TablePlace, marker_place, table_place
from analyze.registration.round_body import free_turn, turned_as_given
from analyze.registration.solution import Solution
from analyze.registration.solve import Problem
from analyze.registration.surface import MAX_TILT_ON_SURFACE, height_over, surface_under
from analyze.registration.table import LAID_BOARD, TablePrior

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.registration.views import StrikeView
    from analyze.types import Array

MAX_SAME_TURN, MAX_SAME_DISTANCE = math.radians(5.0), 0.005
"""largest differences of a marker's pose [rad, m], in addition to its sd, between two strikes that agree on
it"""
MAX_PULL = 5.0
"""largest difference between a marker's height over the surface and its card's thickness, in sd of the
latter, above which the card stands off by an unknown height"""
TWISTED_RATIO, DISAGREES_RATIO, MIN_USUAL_MISFIT = 4.0, 25.0, 0.1
"""multiples of the median misfit (taken as at least the third value): above the first an impact turned the
body about the vertical, above the second the strike contradicts all others"""


@dataclass(frozen=True)
class LeftOut:
    """Strike that was not used for the registration, with the reason."""

    strike_id: str
    """id of the strike"""
    reason: str
    """reason in words, with its numbers"""


@dataclass(frozen=True)
class Registration:
    """Result of a registration: markers' poses, strikes left out, joint fit of the others, tables' poses."""

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
    given: Mapping[int | str, Array] | None = None,
) -> Registration:
    """Estimate the poses (in the object frame O) of all markers that the strikes show.

    Strikes that contradict the others are left out, with the reason.

    Args:
        views: views of the strikes: marker corners at rest and while the object tips.
        sizes: edge of each marker's black square [m].
        thickness: thickness of each marker's card [m].
        model: the object's exterior.
        table: prior sd of the table's tilts [rad] and height [m] in the world frame W, as the recorded camera
            pose defines it; both are always estimated. LAID_BOARD: the board that gave the pose lay on the
            table; UNKNOWN_TABLE: hardly anything is known.
        given: poses T_object_marker (4, 4) that the object file states, if any. They are used only on a body
            of revolution, where they define O's direction about its axis; else the mean placement does.

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
    twisted, standing_off = set[str](), set[int | str]()
    while True:
        surface = surface_under(model, start, sizes, thickness, standing_off)
        free = free_turn(model, used)
        solution = Problem(used, sizes, table, surface, twisted, free).solve(start)
        if not solution.converged:
            raise EstimationError(
                "the strikes do not determine the markers' places:"
                " strike over other edges, and on another resting face"
            )
        more = _strikes_with_misfit(solution, TWISTED_RATIO) - twisted
        if more:
            twisted |= more
            continue
        off = {name for name, pull in solution.pulls.items() if abs(pull) > MAX_PULL}
        if off:
            standing_off |= off
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
    first = next(iter(solution.T_object_marker))
    if free is not None:
        solution = turned_as_given(solution, free, given or {})
    return Registration(
        tuple(
            marker_place(name, solution, used, name in surface.fits, None if free is None else first)
            for name in solution.T_object_marker
        ),
        tuple(left_out),
        solution,
        tuple(
            table_place(setup, solution, next(view.camera for view in used if view.setup == setup))
            for setup in solution.table
        ),
    )


def _solve_each(
    views: Sequence[StrikeView], sizes: Mapping[int | str, float], model: ObjectModel, table: TablePrior
) -> tuple[dict[str, Solution], list[LeftOut]]:
    """Marker and table poses from each strike alone, by strike id; and the strikes whose fit failed.

    Marker poses are in the object frame, the table's is in the world frame, both with covariances. A strike
    whose fit failed is given with the reason.

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
    """Poses of markers on the object, and of the table in the world frame, from one strike alone.

    The marker poses are T_object_marker, with covariances. The fit starts from the object's planned
    orientation; a marker that is nearly parallel to the surface under it is first turned parallel to it.

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
    R_object_world = view.R_world_object.T @ matrix_from_vector(np.array([0.0, 0.0, -view.heading]))
    start: dict[int | str, Array] = {}
    for name, R, p in zip(view.marker_ids, view.R_camera_marker, view.p_camera_marker, strict=True):
        T = np.eye(4)
        T[:3, :3] = R_object_world @ R_world_camera @ R
        T[:3, 3] = (
            R_object_world @ (R_world_camera @ p + p_world_camera - np.array([0, 0, view.radius]))
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
    """True if two solutions agree on a marker's pose: they differ by less than 5 standard deviations.

    The variance is that of both solutions together, plus (5 deg / 3)^2 for the rotation and (5 mm / 3)^2 for
    the position.

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

    It follows from the pose of one marker on the object, T_object_marker, computed in two ways.

    Args:
        view: view of the strike.
        found: (4, 4) the pose by this strike alone, if the object was placed as planned.
        expected: (4, 4) the pose by the other strikes.
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
    """Set of the ids of the strikes whose misfit to the joint fit exceeds `times` the median misfit.

    The misfit is chi^2 per degree of freedom. The median counts as at least 0.1.

    Args:
        solution: the joint fit, with the misfit of each strike.
        times: factor on the median.
    """
    usual = max(float(np.median(list(solution.misfit.values()))), MIN_USUAL_MISFIT)
    return {name for name, misfit in solution.misfit.items() if misfit > times * usual}


def _refuse_overlapping_markers(
    used: Sequence[StrikeView], solution: Solution, sizes: Mapping[int | str, float]
) -> None:
    """Raise an error if two markers come out at one place; otherwise do nothing.

    The cause is that, in the strikes of one of them, the object was not placed as planned.

    Args:
        used: views of the strikes that were used.
        solution: the joint fit.
        sizes: edge of each marker's black square [m].

    Raises:
        EstimationError: two markers that face about the same way (within 60 deg) are closer than the mean of
            their edges.
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
