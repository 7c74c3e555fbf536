"""The real cube of ContactNets (Pfrommer, Halm and Posa 2020): its c and I/m from 400 tosses, by flight and by contact, each on its own.

Its tosses slide on every contact, so that a fit about a fixed pivot fails on them: a test of the moment balance with real motion. Flight
says where c is and how long the file's metre is (g is known better); edges and corners that touch the table say c and I/m, without
knowing of the flights more than that metre.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np

from analyze.errors import EstimationError, RecordingError
from analyze.geometry.rotations import matrix_from_wxyz
from analyze.motion.body_motion import BodyMotion
from analyze.motion.free_flight import Flight, FlightBody, fit_flights, off_the_parabola
from analyze.motion.moment_balance import BalancedBody, Contact, balance_moments
from analyze.types import Array

DEFAULT_DATA: Final = Path("../shared/data/contactnets_tosses.npz")
FRAME_RATE_HZ: Final = 148.0
EDGE_M: Final = 0.1048
EDGE_SD_M: Final = 0.0005
"""nobody states it; half of the last printed digit of its width"""
MASS_KG: Final = 0.37
GRAVITY_M_S2: Final = 9.8017
"""at 39.95 deg north (International Gravity Formula 1980), where the cube was tossed"""
AIR_DRAG: Final = 1.2 * 0.95 * 1.5 * EDGE_M**2 / (2 * MASS_KG)
"""1/m; drag coefficient of a cube 0.8 (edge on) to 1.05 (face on) (Hoerner 1965), mean shadow a quarter of its surface (Cauchy 1841)"""
AIR_DRAG_SD: Final = 0.2 * AIR_DRAG
ROUNDING_M: Final = (0.002, 0.002)
"""of its edges, and 1 sigma: no sharper knowledge than that; it is fitted"""
CLEAR_M, TOUCH_M, LIFTED_M = 0.006, 0.006, 0.008
"""lowest corner of a flight; highest that an edge's ends may be while it touches; lowest that all other corners may be"""
CORNER_TOUCH_M, CORNER_LIFTED_M = 0.004, 0.012
FLIGHT_GUARD, CONTACT_GUARD = 3, 2
"""frames: the file's motion is low-pass filtered, so that an impact reaches into its neighbours"""
LEAST_FRAMES: Final = 9


@dataclass(frozen=True)
class Tosses:
    """Motions of one cube, in the file's lengths."""

    motions: tuple[BodyMotion, ...]
    path: Path


@dataclass(frozen=True)
class CubeAnswer:
    """What the tosses say of the cube; lengths are true ones, not the file's."""

    tosses: int
    frames: int
    flight: FlightBody
    """com is of true lengths, gravity in the file's"""
    edges: BalancedBody
    corners: BalancedBody
    slides_m: tuple[float, float, float]
    """how far the edges slid while they touched: quartiles"""
    scale: float
    """true length of the file's metre"""
    heights: Array
    """(k,) m, where on the line through c along z c might be"""
    off_parabola: Array
    """(k,) m, how far such a point is off a parabola in the median flight of the quarter in which the body turns most, rms"""

    @property
    def apart(self) -> tuple[Array, Array]:
        """(3,) c by edges minus c by flight [m], and its (3, 3) covariance."""
        return self.edges.com - self.flight.com, self.edges.covariance[:3, :3] + self.flight.covariance[:3, :3]


def read_tosses(path: Path) -> Tosses:
    """Read the packed tosses.

    Raises:
        RecordingError: the file is not there, or is no such file.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: not found: give --data FILE, the tosses of DAIRLab/contact-nets packed as docs/reproduce.md says")
    try:
        with np.load(path, allow_pickle=False) as packed:
            lengths = np.asarray(packed["length"], dtype=np.int64)
            position = np.asarray(packed["position_m"], dtype=np.float64)
            quaternion = np.asarray(packed["quaternion_wxyz"], dtype=np.float64)
    # A TypeError: an .npy, which is an array and no archive.
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise RecordingError(f"{path}: no packed tosses: {error}: see docs/reproduce.md") from None
    total = int(lengths.sum()) if lengths.ndim == 1 else -1
    if position.shape != (total, 3) or quaternion.shape != (total, 4) or np.any(lengths < 2):
        raise RecordingError(f"{path}: its lengths do not fit its poses: see docs/reproduce.md")
    norm = np.linalg.norm(quaternion, axis=1)
    if not (np.all(np.isfinite(position)) and np.all(np.abs(norm - 1) < 0.01)):
        raise RecordingError(f"{path}: holds poses that are none: see docs/reproduce.md")
    R = matrix_from_wxyz(quaternion / norm[:, None])
    ends = np.cumsum(lengths)
    return Tosses(
        tuple(
            BodyMotion(np.arange(end - start) / FRAME_RATE_HZ, position[start:end], R[start:end])
            for start, end in zip(np.append(0, ends[:-1]), ends, strict=True)
        ),
        path,
    )


def analyse_tosses(tosses: Tosses, progress: Callable[[str, int, int], None] | None = None) -> CubeAnswer:
    """Flight first, which gives the length of the file's metre; then edges and corners in true lengths.

    Raises:
        EstimationError: there are too few flights or contacts.
    """

    def tell(text: str, done: int) -> None:
        if progress is not None:
            progress(text, done, 5)

    tell("flights", 0)
    flown = flights(tosses.motions)
    flight = fit_flights(flown, AIR_DRAG)
    more_drag = fit_flights(flown, AIR_DRAG + AIR_DRAG_SD)
    by_drag = np.append(more_drag.com - flight.com, more_drag.gravity - flight.gravity)
    flight = replace(flight, covariance=flight.covariance + np.outer(by_drag, by_drag))
    scale = GRAVITY_M_S2 / flight.gravity
    to_true = np.diag([scale, scale, scale, 1.0])
    true_flight = replace(
        flight, com=scale * flight.com, covariance=to_true @ flight.covariance @ to_true, residual=scale * flight.residual
    )
    motions = [scaled(motion, scale) for motion in tosses.motions]
    found: list[BalancedBody] = []
    touching = (edge_contacts(motions, EDGE_M), corner_contacts(motions, EDGE_M))
    for number, contacts in enumerate(touching):
        tell("edges" if number == 0 else "corners", 1 + 2 * number)
        body = balance_moments(contacts, GRAVITY_M_S2, ROUNDING_M)
        # What all tosses share: the cube's width, and the metre.
        tell("edges, other width" if number == 0 else "corners, other width", 2 + 2 * number)
        wider = balance_moments([_wider(contact, EDGE_SD_M) for contact in contacts], GRAVITY_M_S2, ROUNDING_M)
        by_width = _entries(wider) - _entries(body)
        by_metre = _entries(body) * np.array([1.0] * 3 + [2.0] * 6 + [1.0]) * flight.gravity_sd / flight.gravity
        shared = np.outer(by_width, by_width) + np.outer(by_metre, by_metre)
        found.append(replace(body, covariance=body.covariance + shared))
    slid = [float(np.linalg.norm(np.ptp(contact.motion.path_of(contact.corner)[:, :2], axis=0))) for contact in touching[0]]
    heights = np.linspace(-0.002, 0.014, 33)
    low, middle, high = (float(value) for value in np.percentile(slid, [25, 50, 75]))
    return CubeAnswer(
        tosses=len(motions),
        frames=sum(len(motion) for motion in motions),
        flight=true_flight,
        edges=found[0],
        corners=found[1],
        slides_m=(low, middle, high),
        scale=scale,
        heights=heights,
        off_parabola=scale * _off_parabola(flown, flight, heights / scale),
    )


def _off_parabola(flown: Sequence[Flight], flight: FlightBody, heights: Array) -> Array:
    """In the file's lengths, as is `flight`; (k,) of heights (k,)."""
    turned = [float(np.sum(np.linalg.norm(each.motion.angular_velocity, axis=1) * each.motion.dt)) for each in flown]
    most = [each for each, angle in zip(flown, turned, strict=True) if angle >= np.percentile(turned, 75)]
    points = [np.array([flight.com[0], flight.com[1], height]) for height in heights]
    return np.array([np.median(off_the_parabola(most, point, flight.gravity, AIR_DRAG)) for point in points])


def scaled(motion: BodyMotion, scale: float) -> BodyMotion:
    """The motion in lengths that are `scale` times as long."""
    return replace(motion, position=motion.position * scale)


def cube_corners(edge: float) -> Array:
    """(8, 3) m in O."""
    return 0.5 * edge * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=np.float64)


def flights(motions: Sequence[BodyMotion]) -> list[Flight]:
    """Every stretch of every toss in which no corner is near the table."""
    found: list[Flight] = []
    for number, motion in enumerate(motions):
        clear = _heights(motion, EDGE_M).min(axis=1) > CLEAR_M
        for start, stop in _runs(clear):
            # Where the toss begins or ends in the air there is no impact to keep away from.
            first = start + FLIGHT_GUARD if start else start
            last = stop - FLIGHT_GUARD if stop < len(motion) else stop
            if last - first > LEAST_FRAMES:
                found.append(Flight(motion.part(first, last), number))
    return found


def edge_contacts(motions: Sequence[BodyMotion], edge: float) -> list[Contact]:
    """Every stretch in which the cube stands on one edge."""
    corners = cube_corners(edge)
    pairs = [(a, b) for a, b in combinations(range(8), 2) if np.count_nonzero(corners[a] != corners[b]) == 1]
    found: list[Contact] = []
    for number, motion in enumerate(motions):
        heights = _heights(motion, edge)
        for a, b in pairs:
            others = np.delete(heights, [a, b], axis=1).min(axis=1)
            on_edge = (np.abs(heights[:, [a, b]]).max(axis=1) < TOUCH_M) & (others > LIFTED_M)
            along = (corners[b] - corners[a]) / edge
            inward = -np.sign(corners[a]) * (along == 0)
            found += [Contact(part, 0.5 * (corners[a] + corners[b]), inward, along, number) for part in _parts(motion, on_edge)]
    return found


def corner_contacts(motions: Sequence[BodyMotion], edge: float) -> list[Contact]:
    """Every stretch in which the cube stands on one corner."""
    corners = cube_corners(edge)
    found: list[Contact] = []
    for number, motion in enumerate(motions):
        heights = _heights(motion, edge)
        for a in range(8):
            on_corner = (heights[:, a] < CORNER_TOUCH_M) & (np.delete(heights, a, axis=1).min(axis=1) > CORNER_LIFTED_M)
            found += [Contact(part, corners[a], -np.sign(corners[a]), None, number) for part in _parts(motion, on_corner)]
    return found


def _wider(contact: Contact, by: float) -> Contact:
    return replace(contact, corner=contact.corner * (1.0 + by / EDGE_M))


def _entries(body: BalancedBody) -> Array:
    """(10,) as the covariance has them."""
    inertia = body.inertia
    off = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return np.array([*body.com, *np.diag(inertia), *off, body.rounding])


def _heights(motion: BodyMotion, edge: float) -> Array:
    """(n, 8) m, of the corners over the table."""
    return motion.position[:, 2:] + motion.R_world_object[:, 2, :] @ cube_corners(edge).T


def _parts(motion: BodyMotion, touching: Array) -> list[BodyMotion]:
    runs = [(start + CONTACT_GUARD, stop - CONTACT_GUARD) for start, stop in _runs(touching)]
    return [motion.part(start, stop) for start, stop in runs if stop - start >= LEAST_FRAMES]


def _runs(true: Array) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(int), [0]])))
    return [(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def answer_json(answer: CubeAnswer) -> dict[str, Any]:
    """For scripts; SI, 95 % intervals as value +- 1.96 sd."""

    def quantity(value: Array, sd: Array, unit: str) -> dict[str, Any]:
        interval = [(value - 1.96 * sd).tolist(), (value + 1.96 * sd).tolist()]
        return {"value": value.tolist(), "sd": sd.tolist(), "unit": unit, "interval95": interval}

    def balanced(body: BalancedBody) -> dict[str, Any]:
        return {
            "contacts": body.contacts,
            "centre_of_mass": quantity(body.com, body.com_sd, "m"),
            "inertia_per_mass": quantity(body.inertia, body.inertia_sd, "m^2"),
            "edge_rounding": quantity(np.array(body.rounding), np.array(body.rounding_sd), "m"),
            "explained": body.explained,
        }

    apart, covariance = answer.apart
    flight = answer.flight
    return {
        "tosses": answer.tosses,
        "frames": answer.frames,
        "flight": {
            "flights": flight.flights,
            "centre_of_mass": quantity(flight.com, flight.com_sd, "m"),
            "gravity": {**quantity(np.array(flight.gravity), np.array(flight.gravity_sd), "m/s^2"), "true": GRAVITY_M_S2},
            "residual_m": flight.residual,
            "inertia_per_mass": None,
        },
        "metre_of_the_file": answer.scale,
        "edge_contact": balanced(answer.edges),
        "corner_contact": balanced(answer.corners),
        "edge_minus_flight": {**quantity(apart, np.sqrt(np.diag(covariance)), "m"), "distance": float(np.linalg.norm(apart))},
        "edge_slides_m": {"quartiles": list(answer.slides_m)},
    }


def distance_sd(apart: Array, covariance: Array) -> float:
    """1 sigma of the length of a difference [m], along itself."""
    length = float(np.linalg.norm(apart))
    if length == 0:
        raise EstimationError("no difference to speak of")
    direction = apart / length
    return math.sqrt(float(direction @ covariance @ direction))
