"""Plan of tosses by hand: axes of spin, time in the air, and place of the flight before the camera.

A toss determines the products of inertia if its spin is not about a principal axis, of which a symmetric
body has many. The axes are therefore taken as far from all principal axes of the expected tensor as they can
be, and from each other. The camera stays where it is for the strikes, so that gravity has one direction in
its image; the object flies farther away, where the image shows its rise and fall.

Frames: W (world, z up, table z = 0) and O (object); c is the centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import apply, inverse_transform
from analyze.planning.examine import Bench
from analyze.planning.followed_squares import FollowedSquare, side_squares, tag_squares
from analyze.planning.hypothesis import Hypothesis
from analyze.planning.toss_card import toss_card
from analyze.planning.toss_hold import Hold, best_hold
from analyze.tracking.camera_model import project
from analyze.types import Array, CameraModel
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import TOSS_PLAN_VERSION, PlannedToss, Range, StrikePlan

TURNS_PER_S = Range(min=2.0, target=3.0, max=4.0)
"""spin [turns/s]: slower ones turn too little in the air, faster ones blur the tags"""
LONGEST_S, WISHED_S, SHORTEST_S = 0.45, 0.40, 0.30
"""time in the air [s] that is aimed at if the image shows it, below which the plan warns, and the least"""
FLIGHT_SPREAD_S = 0.05
"""a toss may be this much shorter or longer than the aim [s]"""
LEAST_TAG_PX = 24.0
"""smallest mean edge of a tag, or of the square on a printed side, in flight in the image [px]; below, it is
lost in some frames"""
MARGIN_M = 0.03
"""distance of the flight from the image's upper and lower end [m]: a hand does not throw more exactly"""
LEAST_SEEN = 0.9
"""least share of a turn in which the camera must see a tag: on a curved side tags lean away from the axes"""
BORDER_PX = 5.0
"""border of the image that counts as outside [px]"""
NEAR_PRINCIPAL_RAD = np.radians(5.0)
"""angle to a principal axis within which a spin determines no product of inertia"""
DIRECTIONS = 1000
"""number of directions among which the spin axes are chosen"""
APART = 54.74 / 70.53
"""weight of the angle between two spin axes against that to a principal axis: in a body of three different
moments the best four axes are then the diagonals, 54.74 degrees from each principal axis and 70.53 apart"""
SAME_MOMENTS = 0.02
"""relative difference of two moments below which any direction between their axes is a principal axis"""


@dataclass(frozen=True)
class FlightPlace:
    """Place and time of a flight that the camera sees as a whole."""

    flight_s: float
    """time in the air [s]"""
    apex: Array
    """(3,) place of c at the top of the flight, in W [m]"""
    square_px: float
    """mean edge of the smallest tag or side's square there, if it faces the camera [px]"""


def with_tosses(
    plan: StrikePlan, spec: ObjectSpec, model: ObjectModel, believed: Hypothesis, bench: Bench, count: int
) -> StrikePlan:
    """Plan with `count` tosses added after its strikes, and `toss_notes` to its warnings; itself for none.

    An object without tags is followed by its print, which the strikes show.

    Raises:
        PlanError: no toss can be planned.
    """
    if count == 0:
        return plan
    sides = () if spec.marker else side_squares(model)
    tosses = plan_tosses(spec, believed, bench, count, sides)
    warnings = [*plan.warnings, *toss_notes(tosses)]
    return plan.model_copy(
        update={"tosses": tosses, "schema_version": TOSS_PLAN_VERSION, "warnings": warnings}
    )


def toss_notes(tosses: Sequence[PlannedToss]) -> list[str]:
    """Notes for the user on what tosses will determine less well; usually none."""
    notes: list[str] = []
    flight, tags = tosses[0].flight_s.target, tosses[0].smallest_tag_px is not None
    if flight < WISHED_S:
        notes.append(
            f"tosses last {flight:.2f} s, so that the image shows them whole with "
            f"{f'tags of {LEAST_TAG_PX:g} px' if tags else 'sides large enough to be followed'}; from "
            f"{WISHED_S:g} s on they determine the inertia better: "
            f"{'larger tags allow' if tags else 'a lens of shorter focal length allows'} that"
        )
    if max(toss.principal_axis_angle_rad or 0.0 for toss in tosses) < NEAR_PRINCIPAL_RAD:
        notes.append(
            "the three moments of inertia are expected to be equal, so that every axis is a principal axis: "
            "tosses show whether they are, but determine no product of inertia well"
        )
    return notes


def plan_tosses(
    spec: ObjectSpec,
    believed: Hypothesis,
    bench: Bench,
    count: int,
    sides: Sequence[FollowedSquare] = (),
) -> list[PlannedToss]:
    """Plan `count` tosses of an object; their ids are t1, t2, ...

    Args:
        spec: object file: name and markers.
        believed: region of the centre of mass, and expected inertia.
        bench: camera, gravity and table.
        count: number of tosses.
        sides: printed sides by which an object without tags is followed.

    Raises:
        PlanError: the camera cannot see a flight of SHORTEST_S with tags of LEAST_TAG_PX, or the tags are on
            too few sides of the object; the message has the remedy.
    """
    com = believed.region.centre
    squares = sides or _placed_tags(spec)
    place = flight_place(spec, com, bench, squares, by_print=bool(sides))
    least, most = max(SHORTEST_S, place.flight_s - FLIGHT_SPREAD_S), place.flight_s + FLIGHT_SPREAD_S
    found: list[PlannedToss] = []
    axes = spin_axes(believed.unit_inertia, count)
    for number, axis in enumerate(axes, 1):
        hold = best_hold(squares, axis)
        if hold.seen < LEAST_SEEN:
            raise PlanError(_unseen(spec, hold, by_print=bool(sides)))
        found.append(
            PlannedToss(
                id=f"t{number}",
                spin_axis_object=axis.tolist(),
                turns_per_s=TURNS_PER_S,
                flight_s=Range(min=least, target=place.flight_s, max=most),
                R_world_object=hold.R_world_object.tolist(),
                p_world_apex=place.apex.tolist(),
                principal_axis_angle_rad=float(principal_angles(believed.unit_inertia, axis[None])[0]),
                smallest_tag_px=None if sides else place.square_px,
                card=toss_card(spec, hold, place.flight_s, place.apex, bench.gravity, TURNS_PER_S.target),
            )
        )
    return found


def spin_axes(inertia: Array, count: int) -> list[Array]:
    """Unit vectors (3,) in O, far from the principal axes of an inertia (3, 3) and from each other.

    Chosen one after the other: each has the largest least angle to a principal axis and, with the weight
    `APART`, to the axes before it. From the fifth on the axes before the last four no longer count.
    """
    directions = _half_sphere(DIRECTIONS, inertia)
    principal = principal_angles(inertia, directions)
    chosen: list[Array] = []
    for _ in range(count):
        score = principal
        recent = chosen[len(chosen) // 4 * 4 :]
        if recent:
            between = np.arccos(np.clip(np.abs(directions @ np.array(recent).T), 0.0, 1.0)).min(axis=1)
            score = np.minimum(principal, APART * between)
        chosen.append(directions[int(np.argmax(np.round(score, 3)))])
    return chosen


def principal_angles(inertia: Array, directions: Array) -> Array:
    """Angles (n,) [rad] between directions (n, 3) in O and the nearest principal axis of an inertia (3, 3).

    Where two moments are equal, to `SAME_MOMENTS`, every direction between their axes is a principal axis;
    where all three are, every direction is.
    """
    moments, vectors = np.linalg.eigh(inertia)
    along = np.abs(directions @ vectors)
    angles = np.arccos(np.clip(along, 0.0, 1.0)).min(axis=1)
    same = np.diff(moments) < SAME_MOMENTS * moments[-1]
    if same.all():
        return np.zeros(len(directions))
    for pair, axis in ((0, 2), (1, 0)):
        if same[pair]:
            to_plane = np.arcsin(np.clip(along[:, axis], 0.0, 1.0))
            angles = np.minimum(angles, to_plane)
    return angles


def flight_place(
    spec: ObjectSpec, com: Array, bench: Bench, squares: Sequence[FollowedSquare], *, by_print: bool = False
) -> FlightPlace:
    """Nearest place of the longest flight, up to LONGEST_S, that the image shows with readable tags.

    Without tags up to WISHED_S.

    Args:
        spec: object file, for messages.
        com: (3,) expected centre of mass in O [m].
        bench: camera, gravity and table.
        squares: tags or printed sides of the object.
        by_print: True for printed sides.

    Raises:
        PlanError: there is none of SHORTEST_S; the message has the remedy.
    """
    reach, size = squares_reach(squares, com), min(square.size for square in squares)
    # Print needs a larger image more than a longer flight.
    longest = WISHED_S if by_print else LONGEST_S
    camera = bench.camera
    focal = float(np.sqrt(camera.K[0, 0] * camera.K[1, 1]))
    best: FlightPlace | None = None
    for depth in np.arange(0.2, focal * size / LEAST_TAG_PX, 0.01):
        sight = _sight(camera, float(depth), bench.table_far_edge, reach)
        if sight is None:
            continue
        middle, low, high = sight
        rise = high - low - 2 * (reach + MARGIN_M)
        flight = float(np.sqrt(8 * max(rise, 0.0) / bench.gravity))
        if best is not None and flight <= best.flight_s:
            continue
        flight = min(flight, longest)
        rise = bench.gravity * flight**2 / 8
        top = np.array([middle[0], middle[1], low + MARGIN_M + reach + rise])
        best = FlightPlace(flight, top, focal * size / float(depth))
        if flight == longest:
            break
    if best is None or best.flight_s < SHORTEST_S:
        raise PlanError(_no_place(spec, reach, size, best, focal, bench, by_print=by_print))
    return best


def squares_reach(squares: Sequence[FollowedSquare], com: Array) -> float:
    """Largest distance [m] of a square's corner from c, (3,) in O [m]: in flight all lie within it."""
    return max(float(np.linalg.norm(square.corners - com, axis=1).max()) for square in squares)


def _placed_tags(spec: ObjectSpec) -> tuple[FollowedSquare, ...]:
    """Tags of an object whose place on it is known.

    Raises:
        PlanError: there is none.
    """
    squares = tag_squares(spec)
    if not squares:
        raise PlanError(
            f"{spec.name}: has no tags: tosses alone need them at known places, or strikes in the same"
            " session, which show the object's print: plan both (--strikes 9), or add a [[marker]] per tag"
            if not spec.marker
            else f"{spec.name}: no marker has a T_object_marker: tosses need tags at known places: measure"
            " the places with `analyze register`"
        )
    return squares


def _sight(
    camera: CameraModel, depth: float, far_edge: float, reach: float
) -> tuple[Array, float, float] | None:
    """Point (3,) in W on the camera's axis at a depth [m], and the lowest and highest z [m] in sight there.

    The table, which ends at y = `far_edge` [m], hides what lies behind it and below the line of sight over
    its edge; nothing tossed above it comes below its top. None if the axis is too steep to see a flight.

    Args:
        camera: camera, with its pose in W.
        depth: distance from the camera along its axis [m].
        far_edge: y of the table's far edge [m].
        reach: distance of the tags from c [m].
    """
    T = camera.T_world_camera
    middle = T[:3, 3] + depth * T[:3, 2]
    heights = middle[2] + np.linspace(-1.0, 1.0, 801) * depth
    points = np.column_stack([np.full(801, middle[0]), np.full(801, middle[1]), heights])
    in_camera = apply(inverse_transform(T), points)
    ahead = in_camera[:, 2] > 0.2 * depth
    pixels = project(camera, in_camera[ahead])
    last = np.array([camera.width, camera.height]) - 1 - BORDER_PX
    inside = ((pixels >= BORDER_PX) & (pixels <= last)).all(axis=1)
    if not inside.any():
        return None
    seen = heights[ahead][inside]
    low, high = float(seen.min()), float(seen.max())
    eye, y = T[:3, 3], float(middle[1])
    if eye[1] < far_edge:
        over_edge = eye[2] * (1 - (y - eye[1]) / (far_edge - eye[1])) if y - reach > far_edge else 0.0
        low = max(low, float(over_edge))
    return middle, low, high


def _half_sphere(count: int, inertia: Array) -> Array:
    """Directions (n, 3) in O, spread evenly over half a sphere; the diagonals of the principal axes lead.

    The others are a Fibonacci lattice (R. Swinbank and R. J. Purser, 2006) of `count` directions.
    """
    vectors = np.linalg.eigh(inertia)[1]
    diagonals = np.array([[1.0, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]]) / np.sqrt(3)
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    around = np.sqrt(1 - z**2)
    return np.concatenate(
        [diagonals @ vectors.T, np.column_stack([around * np.cos(turn), around * np.sin(turn), z])]
    )


def _no_place(
    spec: ObjectSpec,
    reach: float,
    size: float,
    best: FlightPlace | None,
    focal: float,
    bench: Bench,
    *,
    by_print: bool,
) -> str:
    """Message that no flight of SHORTEST_S fits the image with readable tags, with the size that would."""
    rise = bench.gravity * SHORTEST_S**2 / 8
    needed = rise + 2 * (reach + MARGIN_M)
    longest = "none" if best is None else f"{best.flight_s:.2f} s"
    larger = None if by_print else _sufficient_size(reach, focal, bench)
    remedy = (
        f"glue tags of {1000 * larger:.0f} mm on all sides"
        if larger is not None
        else "use a lens of shorter focal length, or lower the camera and level it"
    )
    what = "the object's narrowest printed side" if by_print else "the smallest tag"
    return (
        f"{spec.name}: no toss fits the image: {SHORTEST_S:g} s in the air need {1000 * needed:.0f} mm of "
        f"height in view; where {what} ({1000 * size:.0f} mm) still has {LEAST_TAG_PX:g} px the "
        f"longest flight is {longest}: {remedy}"
    )


def _sufficient_size(reach: float, focal: float, bench: Bench) -> float | None:
    """Edge [m] of tags with which a flight of SHORTEST_S fits the image, in whole mm; None if none does."""
    rise = bench.gravity * SHORTEST_S**2 / 8
    for depth in np.arange(0.2, 6.0, 0.02):
        sight = _sight(bench.camera, float(depth), bench.table_far_edge, reach)
        if sight is not None and sight[2] - sight[1] >= rise + 2 * (reach + MARGIN_M):
            size = np.ceil(1000 * LEAST_TAG_PX * float(depth) / focal + 1) / 1000
            return float(size) if size < 0.1 else None
    return None


def _unseen(spec: ObjectSpec, hold: Hold, *, by_print: bool) -> str:
    """Message that the camera sees no tag, or no side to follow, in part of each turn."""
    what = "a side wide enough to be followed" if by_print else "a tag"
    remedy = "tags on all sides" if by_print else "tags on more sides of the object (all six are best)"
    return (
        f"{spec.name}: a toss about the axis {_vector(hold.axis)} shows the camera {what} in only "
        f"{100 * hold.seen:.0f} % of each turn: glue {remedy}"
    )


def _vector(axis: Array) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in axis) + ")"
