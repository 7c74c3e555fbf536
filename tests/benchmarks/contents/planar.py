"""Planar simulation of many struck containers at once, each with a mass that moves inside.

Newton's equations in the plane across the pivot edge, by a semi-implicit Euler method. The container is a
rigid body that touches the table with its two edges, rounded by circles: a stiff damped spring along the
vertical, on which an edge hops, and dry friction with a tangential spring, so that it sticks or slides. What
moves inside is a point mass on a curve in the container (liquid's centroid as its surface tilts, a pendulum,
a lump on the floor), with viscous damping, dry friction and stops. Nothing of the estimators is used: no
energy integral, no hinge.

What the model leaves out: air, motion out of the plane, liquid that splashes, and a lump that leaves the
floor. Coordinates: x along the table in the direction of the tip, z up; theta is positive as the body tips
towards +x. Body frame: x and z of the resting pose, from the centre of mass of what does not move.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.interpolate import CubicSpline

G = 9.80665
STEP = 1e-4
"""time step [s]"""
KEPT = 10
"""steps per kept row: one in a millisecond"""
SETTLING = 0.08
"""time to settle before the push [s]"""
NODES = 41
"""number of points of a curve"""
STOP_STIFFNESS, STOP_DAMPING = 4e5, 250.0
"""of the stops at a curve's ends, per kilogram of what hits them [1/s^2, 1/s]"""
CREEP = 2e-3
"""speed [m/s] from which dry friction inside is the full one"""
LIES = 1.25
"""tipping angle [rad] beyond which a body lies, and is not followed"""


@dataclass(frozen=True)
class Lanes:
    """Containers and strikes, one per entry of every array (n,); lengths in m, angles in rad, SI."""

    mass: np.ndarray
    """mass of what does not move"""
    inertia: np.ndarray
    """its moment of inertia about its centre of mass"""
    back: np.ndarray
    """distance of its centre of mass behind the centre line of the pivot edge"""
    up: np.ndarray
    """height of its centre of mass over the table"""
    width: np.ndarray
    """distance of the other edge of the resting face behind the pivot edge, between their centre lines"""
    radius: np.ndarray
    """radius of both edges"""
    friction: np.ndarray
    """between edges and table"""
    table_rate: np.ndarray
    """angular frequency of the container on one edge's spring [rad/s]"""
    table_damping: np.ndarray
    """damping ratio on that spring"""
    moving: np.ndarray
    """mass of what moves inside"""
    inner_friction: np.ndarray
    """coefficient of dry friction of what moves"""
    inner_damping: np.ndarray
    """viscous damping of what moves, over its mass [1/s]"""
    lean: np.ndarray
    """angle by which the table is higher towards the tip"""
    impulse: np.ndarray
    """impulse of the push"""
    height: np.ndarray
    """its height over the table"""
    seconds: np.ndarray
    """its duration"""

    def __len__(self) -> int:
        return len(self.mass)


@dataclass(frozen=True)
class Curves:
    """Path of the moving mass in every container: cubic splines of its place over a parameter."""

    low: np.ndarray
    """(n,) least value of the parameter"""
    high: np.ndarray
    """(n,) greatest value"""
    start: np.ndarray
    """(n,) value at rest"""
    table: np.ndarray
    """(n, NODES - 1, 8) coefficients of x, then z, the cubic term first"""

    @staticmethod
    def through(parameter: np.ndarray, places: np.ndarray, start: np.ndarray) -> Curves:
        """Curves through places (n, NODES, 2) [m] in the body frame at even parameters (n, NODES)."""
        rows = []
        for each, place in zip(parameter, places, strict=True):
            found = CubicSpline(each, place).c
            rows.append(np.concatenate([found[:, :, 0], found[:, :, 1]]).T)
        return Curves(parameter[:, 0], parameter[:, -1], start, np.array(rows))

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place, and first and second derivative by the parameter, each (2, n)."""
        spacing = (self.high - self.low) / (NODES - 1)
        node = np.clip(((q - self.low) / spacing).astype(np.int64), 0, NODES - 2)
        t = q - self.low - node * spacing
        c = self.table.reshape(-1, 8)[np.arange(len(q)) * (NODES - 1) + node].T.reshape(2, 4, -1)
        place = ((c[:, 0] * t + c[:, 1]) * t + c[:, 2]) * t + c[:, 3]
        first = (3 * c[:, 0] * t + 2 * c[:, 1]) * t + c[:, 2]
        return place, first, 6 * c[:, 0] * t + 2 * c[:, 1]


@dataclass(frozen=True)
class Courses:
    """Simulated motions of all lanes, one row a millisecond; time 0 is the beginning of the push."""

    time: np.ndarray
    """(t,) [s]"""
    theta: np.ndarray
    """(t, n) tipping angle [rad]"""
    slip: np.ndarray
    """(t, n) displacement of the pivot edge along the table beyond rolling [m]"""
    lift: np.ndarray
    """(t, n) height of the pivot edge over its place at rest [m]"""
    inside: np.ndarray
    """(t, n) parameter of the moving mass on its curve"""


def simulate(lanes: Lanes, curves: Curves, seconds: float = 1.2) -> Courses:
    """Motions of all lanes from rest on the table until `seconds` after the push begins."""
    state = _State.resting(lanes, curves)
    rows: list[np.ndarray] = []
    steps = round((SETTLING + seconds) / STEP)
    for step in range(steps):
        time = step * STEP - SETTLING
        if step % KEPT == 0:
            rows.append(state.seen())
            if time > 0.3 and np.all((state.th > LIES) | (np.abs(state.om) + np.abs(state.th) < 2e-3)):
                break
        state.advance(time)
    kept = np.array(rows)
    time = np.arange(len(kept)) * KEPT * STEP - SETTLING
    first = int(np.argmax(time >= 0))
    kept = kept - np.where(np.arange(4) == 3, 0.0, 1.0)[:, None] * kept[first]
    return Courses(time[first:], *np.moveaxis(kept[first:], 1, 0))


class _State:
    """Places and speeds of all lanes."""

    def __init__(self, lanes: Lanes, curves: Curves) -> None:
        self.lanes, self.curves = lanes, curves
        n = len(lanes)
        self.x, self.th, self.vx, self.vz, self.om = (np.zeros(n) for _ in range(5))
        self.z = lanes.up.copy()
        self.q, self.qd = curves.start.copy(), np.zeros(n)
        self.stretch = np.zeros((2, n))
        self.press = lanes.moving * G
        total = lanes.mass + lanes.moving
        self.stiffness = total * lanes.table_rate**2
        self.damping = 2 * lanes.table_damping * total * lanes.table_rate
        self.edges = np.stack(
            [
                np.stack([lanes.back, lanes.radius - lanes.up]),
                np.stack([lanes.back - lanes.width, lanes.radius - lanes.up]),
            ]
        )

    @staticmethod
    def resting(lanes: Lanes, curves: Curves) -> _State:
        """State at rest: both edges pressed into the table as the weight on each requires."""
        state = _State(lanes, curves)
        place = curves.at(curves.start)[0]
        share = lanes.moving * place[0] / (lanes.mass + lanes.moving)
        front = (lanes.width - lanes.back + share) / lanes.width
        weight = (lanes.mass + lanes.moving) * G
        sunk = np.stack([front, 1 - front]) * weight / state.stiffness
        state.th = (sunk[0] - sunk[1]) / lanes.width
        state.z = lanes.up - sunk[0] + state.th * lanes.back
        return state

    def seen(self) -> np.ndarray:
        """Rows (4, n): theta, slip and lift of the pivot edge, and the parameter of the moving mass."""
        s, c = np.sin(self.th), np.cos(self.th)
        edge = self.edges[0]
        x, z = self.x + c * edge[0] + s * edge[1], self.z - s * edge[0] + c * edge[1]
        return np.stack([self.th, x - self.lanes.radius * self.th, z, self.q])

    def advance(self, time: float) -> None:
        """One time step; bodies that lie on their side stay there."""
        lanes = self.lanes
        s, c = np.sin(self.th), np.cos(self.th)
        force_x, force_z, moment = self._contacts(s, c)
        push = np.where(
            (time >= 0) & (time <= lanes.seconds),
            lanes.impulse * np.pi / (2 * lanes.seconds) * np.sin(np.pi * time / lanes.seconds),
            0.0,
        )
        force_x = force_x + push
        moment = moment + push * (lanes.height - self.z)
        # In the body frame from here on.
        fx, fz = c * force_x - s * force_z, s * force_x + c * force_z
        level = -G * lanes.lean
        ax, az, alpha, qdd = self._accelerations(fx, fz, moment, c * level + s * G, s * level - c * G)
        ax, az = c * ax + s * az, -s * ax + c * az
        alive = self.th < LIES
        self.vx = np.where(alive, self.vx + STEP * ax, 0.0)
        self.vz = np.where(alive, self.vz + STEP * az, 0.0)
        self.om = np.where(alive, self.om + STEP * alpha, 0.0)
        self.qd = np.where(alive, self.qd + STEP * qdd, 0.0)
        self.x, self.z = self.x + STEP * self.vx, self.z + STEP * self.vz
        self.th, self.q = self.th + STEP * self.om, self.q + STEP * self.qd

    def _contacts(self, s: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Force on the container along x and z, and moment about its centre of mass, by both edges."""
        lanes = self.lanes
        total = [np.zeros(len(lanes)) for _ in range(3)]
        for number, edge in enumerate(self.edges):
            rx, rz = c * edge[0] + s * edge[1], -s * edge[0] + c * edge[1]
            deep = lanes.radius - (self.z + rz)
            # Turning clockwise by om moves a point at (rx, rz) by om (rz, -rx).
            vz = self.vz - self.om * rx
            vx = self.vx + self.om * rz - lanes.radius * self.om
            normal = np.where(deep > 0, np.maximum(self.stiffness * deep - self.damping * vz, 0.0), 0.0)
            most = lanes.friction * normal
            stretch = np.where(deep > 0, self.stretch[number] + STEP * vx, 0.0)
            pull = -self.stiffness * stretch - 0.5 * self.damping * vx
            held = np.clip(pull, -most, most)
            self.stretch[number] = np.where(
                pull == held, stretch, -(held + 0.5 * self.damping * vx) / self.stiffness
            )
            total[0] += held
            total[1] += normal
            # The contact lies one radius below the centre line.
            total[2] += held * (rz - lanes.radius) - normal * rx
        return total[0], total[1], total[2]

    def _accelerations(
        self, fx: np.ndarray, fz: np.ndarray, moment: np.ndarray, gx: np.ndarray, gz: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations of container and moving mass, in the body frame, and of the parameter."""
        lanes, ml = self.lanes, self.lanes.moving
        (px, pz), (tx, tz), (hx, hz) = self.curves.at(self.q)
        long = np.maximum(np.hypot(tx, tz), 1e-9)
        ux, uz = tx / long, tz / long
        # Acceleration of the place without those of the unknowns, less gravity.
        om, qd = self.om, self.qd
        bx = -om * om * px + 2 * om * qd * tz + hx * qd * qd - gx
        bz = -om * om * pz - 2 * om * qd * tx + hz * qd * qd - gz
        nx, nz = -uz, ux
        # Arms of the unknown turn: a turn alpha moves the place by alpha (pz, -px).
        turn = nx * pz - nz * px
        along = ux * pz - uz * px
        speed = long * qd
        drag = (
            ml * lanes.inner_damping * speed
            + np.clip(speed / CREEP, -1, 1) * lanes.inner_friction * self.press
        )
        over, under = self.q - self.curves.high, self.curves.low - self.q
        drag += np.where(over > 0, ml * (STOP_STIFFNESS * over * long + STOP_DAMPING * speed), 0.0)
        drag += np.where(under > 0, ml * (-STOP_STIFFNESS * under * long + STOP_DAMPING * speed), 0.0)
        bias = nx * bx + nz * bz
        # (m I + ml n n^T) A + ml n turn alpha = m g + F - ml n bias + u drag, and the like for the turn.
        a11, a12, a22 = lanes.mass + ml * nx * nx, ml * nx * nz, lanes.mass + ml * nz * nz
        b1, b2, d = ml * nx * turn, ml * nz * turn, lanes.inertia + ml * turn * turn
        r1 = lanes.mass * gx + fx - ml * nx * bias + ux * drag
        r2 = lanes.mass * gz + fz - ml * nz * bias + uz * drag
        r3 = moment - ml * turn * bias + along * drag
        det = a11 * a22 - a12 * a12
        i11, i12, i22 = a22 / det, -a12 / det, a11 / det
        e1, e2 = i11 * b1 + i12 * b2, i12 * b1 + i22 * b2
        alpha = (r3 - e1 * r1 - e2 * r2) / (d - e1 * b1 - e2 * b2)
        ax, az = i11 * r1 + i12 * r2 - e1 * alpha, i12 * r1 + i22 * r2 - e2 * alpha
        self.press = np.abs(ml * (nx * ax + nz * az + turn * alpha + bias))
        ahead = ux * (ax + bx) + uz * (az + bz) + along * alpha
        qdd = np.where(ml > 0, -(ahead + drag / np.maximum(ml, 1e-12)) / long, 0.0)
        return ax, az, alpha, qdd


def joined(parts: list[Lanes]) -> Lanes:
    """All lanes of several sets as one."""
    return Lanes(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Lanes)))
