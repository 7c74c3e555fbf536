"""Centre of mass c and inertia per mass of a real cube, from 400 tosses onto a table.

Data: ContactNets (Pfrommer, Halm and Posa 2020). The cube slides on every contact, so that a fit about a
fixed pivot fails: this tests the moment balance (contact forces have no moment about the line of contact) on
real motion. Free flight gives c and, because g is known better than the file's unit of length, the true
length of the file's metre. Edge and corner contacts give c and I/m; they use nothing of the flights but that
length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Final, TypeVar

import numpy as np

from analyze.flight.free_flight import Flight, FlightBody, distance_from_parabola, fit_flights
from analyze.flight.free_rotation import FreeRotation, fit_rotations, tensor_ratios
from analyze.least_squares.intervals import pooled_freedom
from analyze.motion.body_motion import BodyMotion
from analyze.motion.moment_balance import BalancedBody, Contact, balance_moments
from analyze.progress import Progress, no_progress
from analyze.types import Array

Fitted = TypeVar("Fitted", FlightBody, BalancedBody)
EDGE_M: Final = 0.1048
"""Width of the cube [m]."""
CORNERS: Final = 0.5 * EDGE_M * np.array(list(product((-1.0, 1.0), repeat=3)))
"""(8, 3) corners of the cube [m] in the object frame O, whose origin is the middle of the cube."""
EDGE_SD_M: Final = 0.0005
"""1 sigma of the width [m], which the data do not state: half of its last printed digit."""
MASS_KG: Final = 0.37
"""Mass of the cube [kg]."""
GRAVITY_M_S2: Final = 9.8017
"""Gravity [m/s^2] at 39.95 deg north, where the cube was tossed (International Gravity Formula 1980)."""
AIR_DRAG: Final = 1.2 * 0.95 * 1.5 * EDGE_M**2 / (2 * MASS_KG)
"""Drag per mass [1/m]. Drag coefficient of a cube: 0.8 (edge on) to 1.05 (face on) (Hoerner 1965); mean
projected area: a quarter of the surface (Cauchy 1841)."""
AIR_DRAG_SD: Final = 0.2 * AIR_DRAG
ROUNDING_M: Final = (0.002, 0.002)
"""Radius of the edges' rounding [m]: prior mean and 1 sigma. The radius is fitted."""
CLEAR_M, TOUCH_M, LIFTED_M = 0.006, 0.006, 0.008
"""Heights above the table [m]: least of every corner in flight; greatest of an edge's two ends in contact;
least of the other corners during an edge contact."""
CORNER_TOUCH_M, CORNER_LIFTED_M = 0.004, 0.012
"""Heights above the table [m]: greatest of a corner in contact; least of the other corners meanwhile."""
FLIGHT_GUARD, CONTACT_GUARD = 3, 2
"""Frames left out next to an impact: the file's motion is low-pass filtered, which spreads the impact over
them."""
LEAST_FRAMES: Final = 9
"""Least number of frames of a contact; a flight has more than this."""
PROGRESS_STEPS: Final = 6
"""Steps of the progress bar."""


@dataclass(frozen=True)
class CubeAnswer:
    """Centre of mass of the cube by free flight, edge contact and corner contact, with their errors.

    The two kinds of contact also give the inertia per mass. Lengths are true ones [m], unless a field states
    that it is in the file's unit.
    """

    tosses: int
    """Number of tosses."""
    frames: int
    """Number of frames of all tosses."""
    flight: FlightBody
    """By free flight. `com` [m] is in true lengths; `gravity` is in the file's unit of length."""
    rotation: FreeRotation
    """Ratios of the moments of inertia by free flight."""
    edges: BalancedBody
    """By edge contact, inertia per mass included; lengths in m."""
    corners: BalancedBody
    """By corner contact, inertia per mass included; lengths in m."""
    slides_m: tuple[float, float, float]
    """Quartiles of the distance [m] that an edge slid during one contact."""
    scale: float
    """True length [m] of the file's metre."""
    heights: Array
    """(k,) trial heights z [m] of c, on the line through c along the cube's z."""
    off_parabola: Array
    """(k,) rms deviation [m] from a parabola of the points at `heights`: median over the quarter of flights
    with the largest rotation."""

    @property
    def edge_minus_flight_freedom(self) -> Array:
        """Degrees of freedom (3,) of the variances of `edge_minus_flight`.

        That is the centre of mass by edge contact minus that by free flight.
        """
        bodies = (self.edges, self.flight)
        return pooled_freedom(
            np.array([body.com_sd**2 for body in bodies]), np.array([body.freedom[:3] for body in bodies])
        )

    @property
    def edge_minus_flight(self) -> tuple[Array, Array]:
        """Centre of mass by edge contact minus that by free flight (3,) [m, in O], with covariance [m^2].

        The covariance is (3, 3); O is the cube's object frame.
        """
        return self.edges.com - self.flight.com, self.edges.covariance[:3, :3] + self.flight.covariance[
            :3, :3
        ]


def contact_ratios(body: BalancedBody) -> tuple[Array, Array, Array]:
    """Inertia by contact over the mean of its diagonal, to compare with flight.

    Args:
        body: fit to contacts.

    Returns:
        (6,) ratios xx, yy, zz, xy, xz, yz; their covariance (6, 6); degrees of freedom (6,) of the variances,
        taken as those of the entries.
    """
    ratios = tensor_ratios(body.inertia)
    mean = float(np.trace(body.inertia)) / 3.0
    by_entry = (np.eye(6) - np.outer(ratios, [1 / 3] * 3 + [0.0] * 3)) / mean
    return ratios, by_entry @ body.covariance[3:9, 3:9] @ by_entry.T, body.freedom[3:9]


def analyse_tosses(tosses: Sequence[BodyMotion], progress: Progress = no_progress) -> CubeAnswer:
    """Estimate centre of mass c of a tossed cube from flights, and c and I/m from contacts with a table.

    I/m is the inertia per mass about c. The file's metre, the true length of the unit in which the file
    states lengths, follows from the acceleration of gravity in flight; the contacts are scaled by it. The
    covariances include errors that all tosses share: drag for the flights; the cube's width and the file's
    metre for the contacts.

    Args:
        tosses: recorded motions of the cube, in the file's unit of length.
        progress: called with (text, done, total).

    Returns:
        Estimates by flight (c), by edge contact and by corner contact (c and I/m), in true lengths [m] and
        the cube's frame, with covariances; and the true length [m] of the file's metre.

    Raises:
        EstimationError: there are too few flights or contacts, or they are too similar.
    """
    progress("flights", 0, PROGRESS_STEPS)
    flown = flights(tosses)
    flight = fit_flights(flown, AIR_DRAG)
    more_drag = fit_flights(flown, AIR_DRAG + AIR_DRAG_SD)
    by_drag = np.append(more_drag.com - flight.com, more_drag.gravity - flight.gravity)
    flight = _with_shared_errors(flight, np.outer(by_drag, by_drag))
    scale = GRAVITY_M_S2 / flight.gravity
    to_true = np.diag([scale, scale, scale, 1.0])
    true_flight = replace(
        flight,
        com=scale * flight.com,
        covariance=to_true @ flight.covariance @ to_true,
        residual=scale * flight.residual,
    )
    motions = [replace(motion, position=motion.position * scale) for motion in tosses]
    found: list[BalancedBody] = []
    touching = {"edge contacts": edge_contacts(motions), "corner contacts": corner_contacts(motions)}
    for number, (name, contacts) in enumerate(touching.items()):
        progress(name, 1 + 2 * number, PROGRESS_STEPS)
        body = balance_moments(contacts, GRAVITY_M_S2, ROUNDING_M)
        # Errors that all tosses share: the cube's width and the file's metre.
        progress(f"{name}, other width", 2 + 2 * number, PROGRESS_STEPS)
        wider = balance_moments(
            [_wider(contact, EDGE_SD_M) for contact in contacts], GRAVITY_M_S2, ROUNDING_M
        )
        by_width = _entries(wider) - _entries(body)
        by_metre = (
            _entries(body) * np.array([1.0] * 3 + [2.0] * 6 + [1.0]) * flight.gravity_sd / flight.gravity
        )
        shared = np.outer(by_width, by_width) + np.outer(by_metre, by_metre)
        found.append(_with_shared_errors(body, shared))
    progress("rotation in flight", 5, PROGRESS_STEPS)
    slid = [
        float(np.linalg.norm(np.ptp(contact.motion.path_of(contact.corner)[:, :2], axis=0)))
        for contact in touching["edge contacts"]
    ]
    heights = np.linspace(-0.002, 0.014, 33)
    low, middle, high = (float(value) for value in np.percentile(slid, [25, 50, 75]))
    return CubeAnswer(
        tosses=len(motions),
        frames=sum(len(motion) for motion in motions),
        flight=true_flight,
        rotation=fit_rotations(flown),
        edges=found[0],
        corners=found[1],
        slides_m=(low, middle, high),
        scale=scale,
        heights=heights,
        off_parabola=scale * _off_parabola(flown, flight, heights / scale),
    )


def _with_shared_errors(body: Fitted, shared: Array) -> Fitted:
    """Copy of a fit with errors that all tosses share added to its covariance.

    Its degrees of freedom grow, because the size of these errors is taken as known.

    Args:
        body: fit with the (p, p) covariance of its p numbers.
        shared: (p, p) covariance of the shared errors, of the same numbers in the same units.
    """
    own = np.diag(body.covariance)
    freedom = pooled_freedom(
        np.array([own, np.diag(shared)]), np.array([body.freedom, np.full(len(own), np.inf)])
    )
    return replace(body, covariance=body.covariance + shared, freedom=freedom)


def _off_parabola(flown: Sequence[Flight], flight: FlightBody, heights: Array) -> Array:
    """Deviations (k,) of points of the cube from free fall with air drag, in the file's unit of length.

    The point at the centre of mass falls freely; the others turn about it. For each point, the rms distance
    from the best-fitting fall is computed in each flight. The result is the median of these over the quarter
    of flights with the largest rotation.

    Args:
        flown: flights.
        flight: centre of mass and gravity by flight, in the file's unit of length.
        heights: (k,) z of the points in the object frame O, in the file's unit; x and y are those of the
            centre of mass.
    """
    turned = [
        float(np.sum(np.linalg.norm(each.motion.angular_velocity, axis=1) * each.motion.dt)) for each in flown
    ]
    most = [each for each, angle in zip(flown, turned, strict=True) if angle >= np.percentile(turned, 75)]
    points = [np.array([flight.com[0], flight.com[1], height]) for height in heights]
    return np.array(
        [np.median(distance_from_parabola(most, point, flight.gravity, AIR_DRAG)) for point in points]
    )


def flights(motions: Sequence[BodyMotion]) -> list[Flight]:
    """Flights in toss order: stretches in which all corners are more than `CLEAR_M` above the table.

    Each has the cube's poses and the number of its toss. `FLIGHT_GUARD` frames next to an impact are cut
    off; a flight has more than `LEAST_FRAMES` frames left.

    Args:
        motions: motions of the tosses, in the file's unit of length.
    """
    found: list[Flight] = []
    for number, motion in enumerate(motions):
        clear = _heights(motion).min(axis=1) > CLEAR_M
        for start, stop in _runs(clear):
            # A toss that begins or ends in the air has no impact there: no guard frames are needed.
            first = start + FLIGHT_GUARD if start else start
            last = stop - FLIGHT_GUARD if stop < len(motion) else stop
            if last - first > LEAST_FRAMES:
                found.append(Flight(motion.part(first, last), number))
    return found


def edge_contacts(motions: Sequence[BodyMotion]) -> list[Contact]:
    """Edge contacts: stretches of tosses in which the table touches two ends of one edge, no other corner.

    They are in the order of the tosses. Each has the cube's poses, the edge in the cube's frame, and the
    number of its toss. The ends are within `TOUCH_M` of the table, the others above `LIFTED_M`.
    `CONTACT_GUARD` frames are cut off at both ends; a contact has at least `LEAST_FRAMES` frames left.

    Args:
        motions: motions of the tosses [m].
    """
    pairs = [(a, b) for a, b in combinations(range(8), 2) if np.count_nonzero(CORNERS[a] != CORNERS[b]) == 1]
    found: list[Contact] = []
    for number, motion in enumerate(motions):
        heights = _heights(motion)
        for a, b in pairs:
            others = np.delete(heights, [a, b], axis=1).min(axis=1)
            on_edge = (np.abs(heights[:, [a, b]]).max(axis=1) < TOUCH_M) & (others > LIFTED_M)
            along = (CORNERS[b] - CORNERS[a]) / EDGE_M
            inward = -np.sign(CORNERS[a]) * (along == 0)
            found += [
                Contact(part, 0.5 * (CORNERS[a] + CORNERS[b]), inward, along, number)
                for part in _parts(motion, on_edge)
            ]
    return found


def corner_contacts(motions: Sequence[BodyMotion]) -> list[Contact]:
    """Corner contacts: stretches in which one corner touches the table and all others are lifted.

    The corner is below `CORNER_TOUCH_M`, the others are above `CORNER_LIFTED_M`. `CONTACT_GUARD` frames are
    cut off at both ends; a contact has at least `LEAST_FRAMES` frames left.

    Args:
        motions: motions of the tosses [m].
    """
    found: list[Contact] = []
    for number, motion in enumerate(motions):
        heights = _heights(motion)
        for a in range(8):
            on_corner = (heights[:, a] < CORNER_TOUCH_M) & (
                np.delete(heights, a, axis=1).min(axis=1) > CORNER_LIFTED_M
            )
            found += [
                Contact(part, CORNERS[a], -np.sign(CORNERS[a]), None, number)
                for part in _parts(motion, on_corner)
            ]
    return found


def _wider(contact: Contact, by: float) -> Contact:
    """Copy of a contact for a cube with edges longer by `by` [m]: its corner moves outwards only."""
    return replace(contact, corner=contact.corner * (1.0 + by / EDGE_M))


def _entries(body: BalancedBody) -> Array:
    """Ten numbers (10,) of a fitted body in the cube's frame O, in the order of its covariance.

    They are the centre of mass [m], the inertia per mass about it as xx, yy, zz, xy, xz, yz [m^2], and the
    radius of the edges' rounding [m].
    """
    inertia = body.inertia
    off = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return np.array([*body.com, *np.diag(inertia), *off, body.rounding])


def _heights(motion: BodyMotion) -> Array:
    """Heights (n, 8) of the cube's corners above the table in n frames, in the motion's unit of length.

    The cube's width is taken as `EDGE_M` of that unit, which the file's "metre" meets to a few per cent.
    """
    return motion.position[:, 2:] + motion.R_world_object[:, 2, :] @ CORNERS.T


def _parts(motion: BodyMotion, touching: Array) -> list[BodyMotion]:
    """Parts of a motion of n frames in which the body keeps touching the table, as motions of their own.

    Each part is a run of True in `touching` (n,), without `CONTACT_GUARD` frames at both ends. Parts with
    fewer than `LEAST_FRAMES` frames left are omitted.
    """
    runs = [(start + CONTACT_GUARD, stop - CONTACT_GUARD) for start, stop in _runs(touching)]
    return [motion.part(start, stop) for start, stop in runs if stop - start >= LEAST_FRAMES]


def _runs(true: Array) -> list[tuple[int, int]]:
    """Ranges [start, stop) of indices in which a mask (n,) is True without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(int), [0]])))
    return [(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
