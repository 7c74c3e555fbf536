"""Corners of a thrown body's tags in the images as a function of body, air, tag places and starts.

c moves under gravity and the air's force; the body rotates by Euler's equations with the air's moment:

    x(t) = x0 + v0 t + g t^2 / 2 + drag,    J w' = T - w x J w,    X_W = x + R (X_O - c)

The tensor J enters by five numbers without its size (`second_moments.scale_free`); its size, which only the
air's moment knows, is taken from the shape. Frames: O (object), W (world), C (camera).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from analyze.flight.air_drag import AIR_DENSITY, HullPanels
from analyze.flight.attitude import cross
from analyze.flight.tumbling import STEP, Air, tumble
from analyze.geometry.rotations import hat, matrix_from_vector, matrix_from_wxyz, wxyz_from_matrix
from analyze.geometry.second_moments import unit_inertia, with_size
from analyze.tracking.camera_model import project_ideal, project_jacobian, world_to_camera

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel, IntArray

COM, SHAPE, GRAVITY, DRAG = slice(0, 3), slice(3, 8), slice(8, 11), slice(11, 13)
"""places among the unknowns: c [m, in O], five numbers of the tensor's shape, gravity [m/s^2, in W],
coefficients of the air's force and moment"""
PRESSURE, TAG_SIZE, LINE_TIME = slice(13, 16), 16, 17
"""places of the shift of the air's force against where the law has it [m, in O], of the size of the tags over
the stated one, and of the delay from image row to row beyond that of the calibration [s]"""
FIRST_TAG, TAG_TERMS = 18, 6
"""place of the first tag's unknowns; of each tag: shift of the centre [m] and turn [rad], in O"""
TURN, SPIN, PLACE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
"""places among a toss's own unknowns, at its first frame: turn against the first guess [rad, in W], angular
velocity [rad/s, in O], place of c [m, in W] and its velocity [m/s, in W]"""
TOSS_TERMS = 12
"""number of a toss's own unknowns"""
_DRAG_STEPS, _DRAG_POWERS = 15, 5
"""steps of the integration of a flight's slowing, and number of powers of its polynomial in time"""
_INTO_POWERS = np.linalg.pinv(np.linspace(0.0, 1.0, _DRAG_STEPS + 1)[:, None] ** np.arange(_DRAG_POWERS))
"""(powers, steps + 1) least-squares coefficients of the polynomial from its values over a flight"""


@dataclass(frozen=True)
class ThrownBody:
    """Body as known before its flights: hull, mass, size of the tensor, and gravity."""

    panels: HullPanels
    """panels of its hull"""
    mass: float
    """mass [kg]"""
    log_size: float
    """first log-Cholesky number of the tensor per kilogram, by the shape"""


@dataclass(frozen=True)
class TossStart:
    """First guess of a toss's motion, at its first frame."""

    R_world_object: Array
    """(3, 3) attitude: rotation from O to W"""
    spin: Array
    """(3,) angular velocity in O [rad/s]"""
    place: Array
    """(3,) place of c in W [m]"""
    velocity: Array
    """(3,) velocity of c in W [m/s]"""

    @property
    def numbers(self) -> Array:
        """Unknowns (12,) of the toss at this start."""
        return np.concatenate([np.zeros(3), self.spin, self.place, self.velocity])

    @staticmethod
    def at(path: FlightPath, frame: int) -> TossStart:
        """Start at a frame of a fitted motion."""
        return TossStart(
            path.R_world_object[frame], path.spin[frame], path.place[frame], path.velocity[frame]
        )

    def moved(self, own: Array) -> TossStart:
        """Start with the unknowns (12,) of a fit that began here."""
        attitude = matrix_from_vector(own[TURN]) @ self.R_world_object
        return TossStart(attitude, own[SPIN], own[PLACE], own[VELOCITY])


@dataclass(frozen=True)
class FlightPath:
    """Motion of a thrown body at n times, with derivatives by the unknowns that have no closed form."""

    R_world_object: Array
    """(n, 3, 3) attitudes"""
    spin: Array
    """(n, 3) angular velocity in O [rad/s]"""
    place: Array
    """(n, 3) place of c in W [m]"""
    velocity: Array
    """(n, 3) its velocity in W [m/s]"""
    turns: Array
    """(n, 3, 12) turn in W [rad] by spin (3), shape (5), coefficient of the air's moment, its shift (3)"""
    drag: Array
    """(n, 3) displacement of c in W [m] by the air, for a coefficient of 1"""


def fly(
    body: ThrownBody, bases: Array, shared: Array, own: Array, times: Sequence[Array]
) -> list[FlightPath]:
    """Motions of a body in f tosses with given unknowns.

    Args:
        body: hull, mass and size.
        bases: (f, 3, 3) attitudes of the first guesses at the first times.
        shared: unknowns of the body, at least (16,), in the order of `COM` to `PRESSURE`.
        own: (f, 12) unknowns of the tosses.
        times: times (n,) of each toss, from the first on [s].
    """
    attitudes = wxyz_from_matrix(matrix_from_vector(own[:, TURN]) @ bases)
    shape = np.tile(shared[SHAPE], (6, 1))
    shape[1:] += STEP * np.eye(5)
    inertia = np.array([unit_inertia(with_size(each, body.log_size))[0] for each in shape])
    load = body.panels.load_about(shared[COM], body.mass)
    velocity = _slowed(body, shared, own, np.array([time[-1] for time in times]))
    paths: list[FlightPath] = []
    for i, time in enumerate(times):
        air = Air(load, partial(velocity, i), float(shared[DRAG][1]), shared[PRESSURE])
        path, spin, turns = tumble(attitudes[i], own[i, SPIN], inertia, time, air)
        paths.append(_path(shared, own[i], time, path, spin, turns, air))
    return paths


def _path(
    shared: Array, own: Array, time: Array, attitudes: Array, spin: Array, turns: Array, air: Air
) -> FlightPath:
    """Motion of one toss, from its attitudes.

    Args:
        shared: unknowns of the body.
        own: (12,) unknowns of the toss.
        time: (n,) times [s].
        attitudes: (n, 4) quaternions wxyz from O to W.
        spin: (n, 3) angular velocity in O [rad/s].
        turns: (n, 3, 12) derivatives of the attitudes, as in `FlightPath`.
        air: the air's load.
    """
    R = matrix_from_wxyz(attitudes)
    in_object = np.einsum("nji,nj->ni", R, air.velocity(time))
    force = np.einsum("nij,nj->ni", R, air.load(np.hstack([in_object, spin]))[:, :3])
    once, twice = _integrals(time.tobytes())
    drag = twice @ force
    place = own[PLACE] + np.outer(time, own[VELOCITY]) + 0.5 * np.outer(time**2, shared[GRAVITY])
    speed = own[VELOCITY] + np.outer(time, shared[GRAVITY]) + shared[DRAG][0] * (once @ force)
    return FlightPath(R, spin, place + shared[DRAG][0] * drag, speed, turns, drag)


@lru_cache(maxsize=16)
def _integrals(key: bytes) -> tuple[Array, Array]:
    """Matrices (n, n) that integrate the cubic spline through values at n times once and twice.

    Args:
        key: bytes of the times (n,) [s]; a fit asks for those of its tosses at every step.
    """
    time = np.frombuffer(key)
    once = CubicSpline(time, np.eye(len(time))).antiderivative()
    return once(time), once.antiderivative()(time)


def _slowed(body: ThrownBody, shared: Array, own: Array, ends: Array) -> Callable[[int, Array], Array]:
    """Velocity of c in W [m/s] in f tosses, for the air's load: slowed as by a mean shadow's drag.

    A body that tumbles shows its mean shadow; Newton's law presses it on average with half the coefficient.

    Args:
        body: hull and mass.
        shared: unknowns of the body.
        own: (f, 12) unknowns of the tosses.
        ends: (f,) last times [s].

    Returns:
        Function from the number of a toss and times (n,) [s] to velocities (n, 3).
    """
    slowing = 0.25 * AIR_DENSITY * float(shared[DRAG][0]) * body.panels.mean_shadow / body.mass
    gx, gy, gz = shared[GRAVITY].tolist()
    powers = np.empty((_DRAG_POWERS, len(own), 3))
    for toss, end in enumerate(ends.tolist()):
        step = end / _DRAG_STEPS
        x, y, z = own[toss, VELOCITY].tolist()
        path = [(x, y, z)]
        for _ in range(_DRAG_STEPS):
            factor = slowing * math.hypot(x, y, z)
            a, b, c = (
                x + 0.5 * step * (gx - factor * x),
                y + 0.5 * step * (gy - factor * y),
                z + 0.5 * step * (gz - factor * z),
            )
            factor = slowing * math.hypot(a, b, c)
            x += step * (gx - factor * a)
            y += step * (gy - factor * b)
            z += step * (gz - factor * c)
            path.append((x, y, z))
        powers[:, toss] = _INTO_POWERS @ np.array(path)

    def at(toss: int, t: Array) -> Array:
        return (t / ends[toss])[:, None] ** np.arange(_DRAG_POWERS) @ powers[:, toss]

    return at


class FlightModel:
    """Expected corners of all tosses' views, in order, and their derivatives by all unknowns.

    The unknowns x (count,) are those of the body and the tags, `FIRST_TAG` + 6 per tag, then 12 per toss.
    The newest result is kept, as a fit begins where the model was asked before.

    Args:
        body: hull, mass and size of the body.
        camera: camera that took all frames.
        tags: the object's tags.
        tosses: views of each toss, with the first guess of its start.
    """

    def __init__(
        self,
        body: ThrownBody,
        camera: CameraModel,
        tags: TagSet,
        tosses: Sequence[tuple[TossViews, TossStart]],
    ) -> None:
        self.body = body
        self.tosses = tosses
        self.tags = tags
        self.shared = FIRST_TAG + TAG_TERMS * len(tags.names)
        self.count = self.shared + TOSS_TERMS * len(tosses)
        self.camera = camera
        self._newest: tuple[Array, tuple[Array, Array]] | None = None

    def own(self, toss: int) -> slice:
        """Places of a toss's own unknowns among all, by its number."""
        start = self.shared + TOSS_TERMS * toss
        return slice(start, start + TOSS_TERMS)

    def paths(self, x: Array) -> list[FlightPath]:
        """Motion in each toss, at the times of its frames, with the unknowns x (count,)."""
        bases = np.array([start.R_world_object for _, start in self.tosses])
        own = x[self.shared :].reshape(-1, TOSS_TERMS)
        return fly(self.body, bases, x, own, [views.seconds for views, _ in self.tosses])

    def corners(self, x: Array) -> Array:
        """Corners (k, 4, 3) of the tags in the object frame O [m], with the unknowns x (count,)."""
        terms = x[FIRST_TAG : self.shared].reshape(-1, TAG_TERMS)
        centres = self.tags.centres[:, None, :]
        arms = x[TAG_SIZE] * (self.tags.corners - centres)
        turned = np.einsum("kij,kcj->kci", matrix_from_vector(terms[:, 3:]), arms)
        return centres + terms[:, None, :3] + turned

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Expected corners (rows,) [ideal px] and derivatives (rows, count); a view has 8 rows, x and y."""
        if self._newest is None or not np.array_equal(self._newest[0], x):
            self._newest = x.copy(), self._computed(x)
        return self._newest[1]

    def _computed(self, x: Array) -> tuple[Array, Array]:
        expected: list[Array] = []
        derivatives: list[Array] = []
        # A step too far gives no finite corners, and the fit takes it back.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for number, path in enumerate(self.paths(x)):
                pixels, by = self._toss(x, number, path)
                expected.append(pixels)
                derivatives.append(by)
        return np.concatenate(expected), np.concatenate(derivatives)

    def _toss(self, x: Array, number: int, path: FlightPath) -> tuple[Array, Array]:
        views, _ = self.tosses[number]
        R_camera_world, p_camera_world = world_to_camera(self.camera)
        time = views.seconds[views.frame]
        corners = self.corners(x)
        R = path.R_world_object[views.frame]
        arms = np.einsum("mij,mcj->mci", R, corners[views.tag] - x[COM])
        velocity, acceleration = _of_corners(path, views, arms, x[GRAVITY])
        late = (x[LINE_TIME] * views.rows)[..., None]
        moved = arms + late * velocity + 0.5 * late**2 * acceleration
        in_camera = (path.place[views.frame][:, None, :] + moved) @ R_camera_world.T + p_camera_world
        pixels = project_ideal(self.camera, in_camera)
        into = np.einsum("mcij,jk->mcik", project_jacobian(self.camera, in_camera), R_camera_world)
        by = np.zeros((*pixels.shape, self.count))
        by_turn = cross(arms[:, :, None, :], into)
        own = self.own(number)
        by[..., own][..., TURN] = by_turn @ _left_jacobian(x[own][TURN])
        by[..., own][..., PLACE] = into
        by[..., own][..., VELOCITY] = time[:, None, None, None] * into
        numeric = np.einsum("mcij,mjk->mcik", by_turn, path.turns[views.frame])
        by[..., own][..., SPIN] = numeric[..., :3]
        by[..., SHAPE] = numeric[..., 3:8]
        by[..., DRAG] = np.stack(
            [np.einsum("mcij,mj->mci", into, path.drag[views.frame]), numeric[..., 8]], axis=-1
        )
        by[..., GRAVITY] = 0.5 * time[:, None, None, None] ** 2 * into
        into_object = np.einsum("mcij,mjk->mcik", into, R)
        by[..., LINE_TIME] = np.einsum(
            "mcij,mcj->mci", into, views.rows[..., None] * (velocity + late * acceleration)
        )
        by[..., PRESSURE] = numeric[..., 9:]
        by[..., COM] = -numeric[..., 9:] - into_object
        self._by_tags(x, corners, views.tag, into_object, by)
        return pixels.ravel(), by.reshape(-1, self.count)

    def _by_tags(self, x: Array, corners: Array, tag: IntArray, into_object: Array, by: Array) -> None:
        """Fill in the derivatives (m, 4, 2, count) of the views' corners by the tags' size, place, turn."""
        terms = x[FIRST_TAG : self.shared].reshape(-1, TAG_TERMS)
        arms = (corners - self.tags.centres[:, None, :] - terms[:, None, :3])[tag]
        by[..., TAG_SIZE] = np.einsum("mcij,mcj->mci", into_object, arms) / x[TAG_SIZE]
        turn = cross(arms[:, :, None, :], into_object) @ _left_jacobian(terms[:, 3:])[tag, None]
        places = FIRST_TAG + TAG_TERMS * tag[:, None] + np.arange(TAG_TERMS)
        moved = np.concatenate([into_object, turn], axis=-1)
        by[np.arange(len(tag))[:, None], :, :, places] = moved.transpose(0, 3, 1, 2)


def _of_corners(path: FlightPath, views: TossViews, arms: Array, gravity: Array) -> tuple[Array, Array]:
    """Velocities and accelerations (m, 4, 3) of the corners of all views in W [m/s, m/s^2].

    The air's force is left out of the acceleration, which counts for a millisecond.

    Args:
        path: motion at the times of the frames.
        views: the views.
        arms: (m, 4, 3) corners less c in W [m].
        gravity: (3,) gravity in W [m/s^2].
    """
    rate = np.einsum("nij,nj->ni", path.R_world_object, path.spin)
    change = np.gradient(rate, views.seconds, axis=0)[views.frame][:, None, :]
    rate = rate[views.frame][:, None, :]
    turning = cross(rate, arms)
    velocity = path.velocity[views.frame][:, None, :] + turning
    return velocity, gravity + cross(rate, turning) + cross(change, arms)


def _left_jacobian(vector: Array) -> Array:
    """Turns (..., 3, 3) in the fixed frame per change of small rotation vectors (..., 3) [rad].

    They are exact to second order.
    """
    K = hat(vector)
    return np.eye(3) + 0.5 * K + K @ K / 6.0
