"""Independent simulation of struck, tipping, sliding bodies in the plane across the edge.

Newton's equations with dry friction. A body with a circular edge rounding of radius rho stands on a face, is
pushed by a half-sine force of some milliseconds, and turns about its edge, which sticks (rolls on its
rounding) or slides. Nothing of the estimators is used: no energy integral, no pendulum. Coordinates: x along
the table in the direction of tipping, z up; theta is positive as the body tips.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

G = 9.80665
STEP = 1e-4


@dataclass(frozen=True)
class Body:
    """Body in the plane across its edge: place of its centre of mass c, inertia, rounding, friction.

    c lies at the distance R [m] from the rounding's centre line, at the angle phi [rad] behind the vertical;
    the moment of inertia is about c, per mass [m^2]; rho is the rounding's radius [m].
    """

    R: float = 0.103
    phi: float = 0.28
    inertia: float = 0.0036
    rho: float = 0.001
    friction: float = 0.5
    height: float = 0.2
    """height of the body [m], the highest place at which it can be struck"""

    @property
    def k(self) -> float:
        """Rate constant m g R / I_contact of the tip [rad/s^2]."""
        return G * self.R / (self.inertia + (self.R + self.rho) ** 2)


@dataclass(frozen=True)
class Push:
    """Horizontal force at a height over the table: half a sine over time."""

    impulse: float
    """impulse per mass of the body [N s/kg]"""
    height: float
    """height over the table [m]"""
    seconds: float = 0.003
    at: float = 0.0
    """time at which it begins [s]"""


@dataclass
class Course:
    """Simulated motion, sampled at the camera's times."""

    time: np.ndarray
    """(n,) times of the frames [s]; 0 is the beginning of the first push"""
    theta: np.ndarray
    slip: np.ndarray
    """(n,) displacement of the contact beyond rolling [m]"""
    lift: np.ndarray
    """(n,) height of the rounding over the table [m]"""
    slid: float = 0.0
    """largest slip until 5 degrees past phi [m]"""
    flown: float = 0.0
    """largest lift until 5 degrees past phi [m]"""
    over: bool = False
    events: list[str] = field(default_factory=list)


def push_for(body: Body, energy: float, height: float | None = None) -> Push:
    """Push that gives `energy` times the energy that tipping needs, if the edge held."""
    height = 0.75 * body.height if height is None else height
    edge = body.inertia + body.R**2 + body.rho**2 + 2 * body.rho * body.R * math.cos(body.phi)
    need = G * body.R * (1 - math.cos(body.phi))
    return Push(math.sqrt(2 * need * energy * edge) / height, height)


def simulate(
    body: Body,
    pushes: list[Push],
    rate: float = 120.0,
    seconds: float = 1.2,
    phase: float = 0.3,
    land: float = math.pi / 2,
) -> Course:
    """Integrate until the body lies at angle `land` [rad], or `seconds` have passed.

    The frames begin 0.25 s before the push.
    """
    x, z, th, vx, vz, om = 0.0, body.rho, 0.0, 0.0, 0.0, 0.0
    frames = np.arange(-round(0.25 * rate), round(seconds * rate)) / rate + phase / rate
    log: list[tuple[float, float, float, float]] = []
    t, contact, landed = 0.0, True, False
    slip0 = 0.0
    stick = True
    pushed = max(push.at + push.seconds for push in pushes)
    while t < seconds:
        log.append((t, th, x - body.rho * th - slip0, z - body.rho))
        if landed:
            break  # and lies there
        force = height = 0.0
        if t <= pushed:
            force = sum(_force(push, t) for push in pushes)
            height = next((push.height for push in pushes if push.at <= t <= push.at + push.seconds), 0.0)
        acceleration = _acceleration(
            body, (x, z, th, vx, vz, om), force, height, contact=contact, stick=stick
        )
        ax, az, alpha, normal, stick = acceleration
        if contact and normal < 0:
            contact, stick = False, False
            ax, az, alpha, normal, stick = _acceleration(
                body, (x, z, th, vx, vz, om), force, height, contact=False, stick=False
            )
        relative = vx - body.rho * om
        vx, vz, om = vx + STEP * ax, vz + STEP * az, om + STEP * alpha
        if contact:
            vz = 0.0
            if not stick and relative * (vx - body.rho * om) < 0:
                stick = True  # it may stop here; the next step says whether it does
                vx = body.rho * om
        x, z, th = x + STEP * vx, z + STEP * vz, th + STEP * om
        if not contact and z < body.rho:
            # It comes down on its edge: the vertical speed of the contact is taken out by an impulse there,
            # with friction.
            contact, z = True, body.rho
            vx, vz, om = _impact(body, th, vx, vz, om)
        if th < 0 and om < 0:
            th = 0.0
            if abs(om) < 0.3:
                om = vx = vz = 0.0
                landed = True
            else:
                om, vx = -0.3 * om, 0.0
                stick = True
        landed = landed or th >= land
        t += STEP
    return _course(body, np.array(log), frames)


def _course(body: Body, table: np.ndarray, frames: np.ndarray) -> Course:
    """Motion at the times of the frames, from rows (t, theta, slip, lift) of every time step."""
    at = np.clip(np.searchsorted(table[:, 0], frames), 0, len(table) - 1)
    seen = np.where(frames[:, None] < 0, 0.0, table[at, 1:])
    near = table[:, 1] < body.phi + math.radians(5)
    first = int(np.argmax(~near)) if np.any(~near) else len(near)
    slid = float(np.max(np.abs(table[:first, 2]), initial=0.0))
    flown = float(np.max(table[:first, 3], initial=0.0))
    return Course(
        frames, seen[:, 0], seen[:, 1], seen[:, 2], slid, flown, bool(np.max(table[:, 1]) > body.phi + 0.3)
    )


def _force(push: Push, t: float) -> float:
    inside = 0.0 <= t - push.at <= push.seconds
    return (
        push.impulse * math.pi / (2 * push.seconds) * math.sin(math.pi * (t - push.at) / push.seconds)
        if inside
        else 0.0
    )


def _acceleration(
    body: Body, state: tuple[float, ...], force: float, height: float, *, contact: bool, stick: bool
) -> tuple[float, float, float, float, bool]:
    """Accelerations ax, az of the centre line and alpha, normal force per mass, and whether it sticks.

    `force` is that of the push per mass, at `height` [m] over the table.
    """
    _, z, th, vx, _, om = state
    s, c = body.R * math.sin(body.phi - th), body.R * math.cos(body.phi - th)
    # c is at (-s, c) from the centre line; its acceleration is (ax + c alpha + s om^2, az + s alpha - c
    # om^2).
    level = z + c
    if not contact:
        # Only gravity and the push.
        alpha = force * (height - level) / body.inertia
        return force - c * alpha - s * om * om, -G - s * alpha + c * om * om, alpha, 0.0, False
    at_rest_on_face = th <= 0.0 and om <= 0.0

    def solve(friction: float | None, sign: float) -> tuple[float, float, float, float]:
        """Acceleration ax, alpha, normal force N and friction F per mass; `friction` None: it rolls."""
        # Unknown alpha; N = G + s alpha - c om^2; F = ax + c alpha + s om^2 - force.
        # inertia alpha = -(c + rho) F - s N + force (height - level)
        if friction is None:
            # ax = rho alpha
            lead = body.inertia + (c + body.rho) ** 2 + s * s
            right = -(c + body.rho) * (s * om * om - force) - s * (G - c * om * om) + force * (height - level)
            alpha = right / lead
            if at_rest_on_face and alpha < 0:
                alpha = 0.0
            return (
                body.rho * alpha,
                alpha,
                G + s * alpha - c * om * om,
                (c + body.rho) * alpha + s * om * om - force,
            )
        # F = -mu sign N
        mu = -friction * sign
        lead = body.inertia + (c + body.rho) * mu * s + s * s
        right = -((c + body.rho) * mu + s) * (G - c * om * om) + force * (height - level)
        alpha = right / lead
        if at_rest_on_face and alpha < 0:
            alpha = 0.0
        normal = G + s * alpha - c * om * om
        pull = mu * normal
        return pull + force - c * alpha - s * om * om, alpha, normal, pull

    if stick:
        ax, alpha, normal, pull = solve(None, 0.0)
        if abs(pull) <= body.friction * normal:
            return ax, 0.0, alpha, normal, True
        sign = -math.copysign(1.0, pull)
    else:
        sign = math.copysign(1.0, vx - body.rho * om)
    ax, alpha, normal, _ = solve(body.friction, sign)
    return ax, 0.0, alpha, normal, False


def _impact(body: Body, th: float, vx: float, vz: float, om: float) -> tuple[float, float, float]:
    """Velocities (vx, vz, angular) after the edge has hit the table without bouncing.

    Friction is limited by Coulomb's law for impulses.
    """
    s, c = body.R * math.sin(body.phi - th), body.R * math.cos(body.phi - th)
    # Impulse (P, N) at the contact: centre of mass gains (P, N), turn gains (-(c + rho) P - s N) / inertia.
    arm = c + body.rho

    def after(p: float, n: float) -> tuple[float, float, float]:
        d_om = (-arm * p - s * n) / body.inertia
        # centre line = c - (-s, c): its speed gains c's, less that of the arm.
        return vx + p - c * d_om, vz + n - s * d_om, om + d_om

    # vz_after = vz + N - s d_om = 0 and vx_after - rho om_after = 0
    matrix = np.array(
        [
            [arm * s / body.inertia, 1 + s * s / body.inertia],
            [1 + arm * arm / body.inertia, arm * s / body.inertia],
        ]
    )
    p, n = np.linalg.solve(matrix, [-vz, -(vx - body.rho * om)])
    if abs(p) > body.friction * n:
        sign = -math.copysign(1.0, vx - body.rho * om)
        mu = body.friction * sign
        n = -vz / (1 + s * (arm * mu + s) / body.inertia)
        p = mu * n
    return after(float(p), float(n))
