"""Places of an object's markers from its strikes: each strike alone first, to find those placed otherwise, then all together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.geometry.rotations import matrix_from_vector, vector_from_matrix
from analyze.registration.solve import Problem, Solution
from analyze.registration.surface import LIES_ON, height_over, surface_under
from analyze.registration.table import LAID_BOARD, TablePrior, corrected_camera

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from analyze.registration.views import StrikeView
    from analyze.types import Array, CameraModel

SAME_TURN, SAME_PLACE = math.radians(5.0), 0.005
"""rad, m: two strikes that show a marker within these (and their own sd) agree on how the object lay"""
TWISTED, DISAGREES, USUAL_MISFIT = 4.0, 25.0, 0.1
"""times the usual misfit (at least the third), from which a blow is taken to have turned the body, and a strike to fit with no other"""
UNKNOWN_TURN, UNKNOWN_PLACE = math.radians(0.5), 1e-3
"""rad, m: a direction whose sd is above it is not determined"""


@dataclass(frozen=True)
class LeftOut:
    """A strike that was not used, and why."""

    strike_id: str
    reason: str


@dataclass(frozen=True)
class MarkerPlace:
    """Where one marker is glued."""

    marker_id: int | str
    T_object_marker: Array
    """(4, 4)"""
    covariance: Array
    """(6, 6) of its turn in O [rad] and its centre in O [m]"""
    strikes: tuple[str, ...]
    """that show it"""
    rms_px: float
    on_surface: bool
    """its distance from the surface was held to its thickness"""
    undetermined: tuple[str, ...]
    """directions in O that are not known, in words; empty: all are"""
    remedy: str = ""

    @property
    def turn_sd(self) -> float:
        """Worst direction [rad]."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def place_sd(self) -> float:
        """Worst direction [m]."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1]))


@dataclass(frozen=True)
class TablePlace:
    """How the table lies against the recorded T_world_camera, in one recording."""

    setup: int
    """number of the recording"""
    offset: Array
    """(3,) tilts about W's x and y [rad], and the height [m]"""
    sd: Array
    """(3,)"""
    T_world_camera: Array
    """(4, 4), of the W whose z = 0 is the table as found"""
    undetermined: tuple[str, ...]
    """what of it is not known; empty: all is"""


@dataclass(frozen=True)
class Registration:
    """What the strikes tell of markers, placements and the table."""

    markers: tuple[MarkerPlace, ...]
    left_out: tuple[LeftOut, ...]
    solution: Solution
    tables: tuple[TablePlace, ...]
    """one per recording of which a strike was used"""


def register(
    views: Sequence[StrikeView],
    sizes: Mapping[int | str, float],
    thickness: Mapping[int | str, float],
    model: ObjectModel,
    table: TablePrior = LAID_BOARD,
) -> Registration:
    """Solve for all markers that the strikes show.

    Args:
        views: what the strikes show.
        sizes: m, edge of each marker's black square.
        thickness: m, of each marker's card.
        model: the object's exterior.
        table: how well the recorded T_world_camera knows the table; UNKNOWN_TABLE: its tilts and height are to be found.

    Raises:
        EstimationError: nothing was seen, or the strikes contradict each other so that nobody can say which are right.
    """
    if not views:
        raise EstimationError("no strike shows a marker at rest: check light and focus, and that the object file names its tags")
    left_out: list[LeftOut] = []
    single: dict[str, Solution] = {}
    for view in views:
        try:
            single[view.strike_id] = _alone(view, sizes, model, table)
        except EstimationError as error:
            left_out.append(LeftOut(view.strike_id, f"{error}: is its marker read aright?"))
    start: dict[int | str, Array] = {}
    good = set(single)
    for name in dict.fromkeys(i for view in views for i in view.marker_ids):
        some = [view for view in views if name in view.marker_ids and view.strike_id in good]
        if not some:
            continue
        agreeing = _agreeing(some, single, name)
        start[name] = single[agreeing[0].strike_id].T_object_marker[name]
        for view in some:
            if view not in agreeing:
                good.discard(view.strike_id)
                left_out.append(LeftOut(view.strike_id, _otherwise(view, single[view.strike_id].T_object_marker[name], start[name])))
    used = [view for view in views if view.strike_id in good]
    if not used:
        raise EstimationError(f"no strike can be used: {'; '.join(f'{left.strike_id}: {left.reason}' for left in left_out)}")
    twisted: set[str] = set()
    while True:
        solution = Problem(used, sizes, table, surface_under(model, start, sizes, thickness), twisted).solve(start)
        if not solution.converged:
            raise EstimationError("the strikes do not determine the markers' places: strike over other edges, and on another resting face")
        more = _misfits(solution, TWISTED) - twisted
        if more:
            twisted |= more
            continue
        worst = max(_misfits(solution, DISAGREES), key=lambda name: solution.misfit[name], default=None)
        if worst is None or len(used) <= 2:
            break
        left_out.append(LeftOut(worst, f"fits with no other strike (its misfit is {solution.misfit[worst]:.0f} times the noise): left out"))
        used = [view for view in used if view.strike_id != worst]
        start = {**start, **solution.T_object_marker}
    _refuse_one_on_another(used, solution, sizes)
    held = surface_under(model, start, sizes, thickness).lying
    return Registration(
        tuple(_place(name, solution, used, name in held) for name in solution.T_object_marker),
        tuple(left_out),
        solution,
        tuple(_table(setup, solution, next(view.camera for view in used if view.setup == setup)) for setup in solution.table),
    )


def _alone(view: StrikeView, sizes: Mapping[int | str, float], model: ObjectModel, table: TablePrior) -> Solution:
    """One strike by itself."""
    camera = view.camera
    R_world_camera, p_world_camera = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    start: dict[int | str, Array] = {}
    for name, R, p in zip(view.marker_ids, view.R_camera_marker, view.p_camera_marker, strict=True):
        T = np.eye(4)
        T[:3, :3] = view.R_world_object.T @ R_world_camera @ R
        T[:3, 3] = view.R_world_object.T @ (R_world_camera @ p + p_world_camera - np.array([0, 0, view.radius])) + view.p_object_pivot
        start[name] = _laid_flat(T, model)
    return Problem([view], sizes, table, surface_under(model, start, sizes, {})).solve(start)


def _laid_flat(T: Array, model: ObjectModel) -> Array:
    """The pose turned until its normal is the surface's, where it nearly is: a square seen face-on hardly shows its tilt."""
    _, normal = height_over(model, T[:3, 3])
    axis = np.cross(T[:3, 2], normal)
    sine, cosine = float(np.linalg.norm(axis)), float(T[:3, 2] @ normal)
    if cosine < math.cos(2 * LIES_ON) or sine < 1e-9:
        return T
    flat = T.copy()
    flat[:3, :3] = matrix_from_vector(axis / sine * math.atan2(sine, cosine)) @ T[:3, :3]
    return flat


def _agreeing(views: Sequence[StrikeView], single: Mapping[str, Solution], name: int | str) -> list[StrikeView]:
    """The largest set of strikes that show the marker at one place, those that know it best first.

    Raises:
        EstimationError: two sets are equally large: nobody can say which is right.
    """
    agree = [[_same(single[a.strike_id], single[b.strike_id], name) for b in views] for a in views]
    sets = {tuple(i for i in range(len(views)) if row[i]) for row in agree}
    ranked = sorted(sets, key=len, reverse=True)
    best = ranked[0]
    if len(best) < len(views):
        rival = next((other for other in ranked[1:] if len(other) == len(best) and not set(other) & set(best)), None)
        if rival is not None:
            one, two = (", ".join(views[i].strike_id for i in each) for each in (best, rival))
            turned = _otherwise(views[rival[0]], *(single[views[each[0]].strike_id].T_object_marker[name] for each in (rival, best)))
            raise EstimationError(
                f"strikes {one} and {two} contradict each other on marker {name} ({turned}): look which was placed otherwise than its card "
                "says, and leave it out with --exclude"
            )
    return sorted((views[i] for i in best), key=lambda view: float(np.trace(single[view.strike_id].covariance[name][:3, :3])))


def _same(one: Solution, two: Solution, name: int | str) -> bool:
    a, b = one.T_object_marker[name], two.T_object_marker[name]
    covariance = one.covariance[name] + two.covariance[name]
    apart = np.concatenate([vector_from_matrix(a[:3, :3] @ b[:3, :3].T), a[:3, 3] - b[:3, 3]])
    allowed = covariance + np.diag([SAME_TURN**2 / 9] * 3 + [SAME_PLACE**2 / 9] * 3)
    return float(apart @ np.linalg.solve(allowed, apart)) < 25.0


def _otherwise(view: StrikeView, found: Array, expected: Array) -> str:
    """How the object lay, against the plan."""
    turn = view.R_world_object @ found[:3, :3] @ expected[:3, :3].T @ view.R_world_object.T
    vector = vector_from_matrix(turn.T)
    angle = math.degrees(float(np.linalg.norm(vector)))
    if angle < math.degrees(SAME_TURN):
        apart_mm = 1000 * float(np.linalg.norm(found[:3, 3] - expected[:3, 3]))
        return f"its marker is {apart_mm:.0f} mm off where other strikes show it: another edge"
    if abs(vector[2]) > 0.9 * np.linalg.norm(vector):
        return f"placed otherwise than its card says: turned by {angle:.0f} deg about the vertical"
    return f"placed otherwise than its card says: turned by {angle:.0f} deg, on another face"


def _misfits(solution: Solution, times: float) -> set[str]:
    """Strikes that fit so much worse than the others do."""
    usual = max(float(np.median(list(solution.misfit.values()))), USUAL_MISFIT)
    return {name for name, misfit in solution.misfit.items() if misfit > times * usual}


def _refuse_one_on_another(used: Sequence[StrikeView], solution: Solution, sizes: Mapping[int | str, float]) -> None:
    """Two markers at one place: the object lay otherwise in the strikes of one of them."""
    names = list(solution.T_object_marker)
    for i, one in enumerate(names):
        for two in names[i + 1 :]:
            a, b = solution.T_object_marker[one], solution.T_object_marker[two]
            near = float(np.linalg.norm(a[:3, 3] - b[:3, 3])) < 0.5 * (sizes[one] + sizes[two])
            if near and float(a[:3, 2] @ b[:3, 2]) > 0.5:
                by = {name: ", ".join(view.strike_id for view in used if name in view.marker_ids) for name in (one, two)}
                raise EstimationError(
                    f"markers {one} (strikes {by[one]}) and {two} (strikes {by[two]}) come out at one place: the object lay otherwise than "
                    "its card says in the strikes of one of them: look which, and leave them out with --exclude"
                )


def _place(name: int | str, solution: Solution, used: Sequence[StrikeView], on_surface: bool) -> MarkerPlace:
    covariance = solution.covariance[name]
    mine = [view for view in used if name in view.marker_ids]
    words = [
        *(f"turn about {_axis(v)}" for v in _unknown(covariance[:3, :3], UNKNOWN_TURN)),
        *(f"place along {_axis(v)}" for v in _unknown(covariance[3:, 3:], UNKNOWN_PLACE)),
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
    """What would determine a marker's place that these strikes do not."""
    tipped = [view for view in mine if len(view.theta) > 1]
    if any(view.rolls for view in mine):
        return "the body is round there: it shows nothing of how it is turned about its axis: measure T_object_marker by hand"
    if not tipped and any(view.flank for view in mine):
        return "the body rolls on a curved flank there, about no line: strike it over a sharp edge, or measure T_object_marker by hand"
    if not tipped:
        return "strike the object so that this marker is seen while it tips"
    return "strike it on another resting face, over an edge that is not parallel to " + ", ".join(sorted({v.axis_id for v in tipped}))


def _unknown(covariance: Array, limit: float) -> list[Array]:
    values, vectors = np.linalg.eigh(covariance)
    return [vectors[:, i] for i in range(3) if math.sqrt(max(float(values[i]), 0.0)) > limit]


def _axis(vector: Array) -> str:
    """A direction in O, either way."""
    v = vector if vector[np.argmax(np.abs(vector))] > 0 else -vector
    largest = int(np.argmax(v))
    if v[largest] > 0.99:
        return f"O's {'xyz'[largest]}"
    return f"({v[0]:.2f}, {v[1]:.2f}, {v[2]:.2f}) in O"


def _table(setup: int, solution: Solution, camera: CameraModel) -> TablePlace:
    offset, sd = solution.table[setup], np.sqrt(np.diag(solution.table_covariance[setup]))
    names = ("tilt about W's x", "tilt about W's y", "height")
    limits = (UNKNOWN_TURN, UNKNOWN_TURN, UNKNOWN_PLACE)
    unknown = tuple(name for name, value, limit in zip(names, sd, limits, strict=True) if value > limit)
    return TablePlace(setup, offset, sd, corrected_camera(camera, offset).T_world_camera, unknown)
