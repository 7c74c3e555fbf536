"""Independent simulation of bodies that roll on a curved flank, by Newton's equations.

The table's two forces are unknowns. The section is a quarter ellipse (or circle) between a flat bottom and a
wall; the contact is the ellipse's own point, and rolling is the condition that the body's point there stands
still. Nothing of the estimator is used: no support function, no energy, no facets. Models no sliding and no
lifting, but gives the friction and the load that the motion requires. Coordinates as in sliding.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from analyze.motion.strike_task import StrikeTask
from analyze.motion.support_function import SupportFunction, support_of_outline
from analyze.motion.tip_angle import PlanarMotion
from analyze.types import TipAngle
from tests.analyze.motion.tipping import planned

G = 9.80665


@dataclass(frozen=True)
class RollingBody:
    """Body with an elliptic flank; positions are relative to the ellipse's centre, at rest."""

    a: float
    """half axis of the ellipse along the table [m]"""
    b: float
    """half axis of the ellipse across the table [m]"""
    com: tuple[float, float]
    """centre of mass c: along the table in the direction of tipping, and up [m]"""
    inertia: float
    """moment of inertia about c, per mass [m^2]"""
    top: float = 0.15
    """height of the body over the table [m]"""
    back: float = 0.06
    """extent of the body against the direction of tipping, from the ellipse's centre [m]"""

    def touching(self, theta: float) -> tuple[float, float, float]:
        """Contact with the table at angle theta [rad]: x and z in W relative to c, and its radius [m].

        The radius is that of curvature.
        """
        sin, cos = math.sin(theta), math.cos(theta)
        reach = math.hypot(self.a * sin, self.b * cos)
        x, z = self.a**2 * sin / reach - self.com[0], -(self.b**2) * cos / reach - self.com[1]
        return x * cos + z * sin, z * cos - x * sin, (self.a * self.b) ** 2 / reach**3

    @cached_property
    def phi(self) -> float:
        """Balance angle [rad], at which c stands above the contact."""
        return float(brentq(lambda theta: self.touching(theta)[0], 0.0, 1.4, xtol=1e-13))

    @cached_property
    def R(self) -> float:
        """Distance of c from the centre of curvature at the balance angle [m]."""
        _, z, radius = self.touching(self.phi)
        return -z - radius

    @property
    def k(self) -> float:
        """Rate constant of the motion near balance [rad/s^2]."""
        _, z, _ = self.touching(self.phi)
        return G * self.R / (self.inertia + z * z)

    def omega_for(self, energy: float) -> float:
        """Angular speed at theta = 0 [rad/s] with `energy` times the energy that reaching balance needs."""
        x, z, _ = self.touching(0.0)
        need = -self.touching(self.phi)[1] + z
        return math.sqrt(2 * G * need * energy / (self.inertia + x * x + z * z))

    def outline(self, facets: int) -> np.ndarray:
        """Corners (n, 2) [m] of the section as a mesh with so many facets on its flank has them."""
        t = np.linspace(0, math.pi / 2, facets + 1)
        arc = np.stack([self.a * np.sin(t), -self.b * np.cos(t)], axis=-1)
        return np.vstack(
            [[-self.back, -self.b], arc, [self.a, self.top - self.b], [-self.back, self.top - self.b]]
        )


@dataclass(frozen=True)
class Rolled:
    """Simulated motion, with the contact forces that it requires."""

    theta: np.ndarray
    friction: float
    """largest ratio of friction to normal force"""
    load: float
    """smallest normal force, over the weight"""


def roll_on(body: RollingBody, time: np.ndarray, theta0: float, omega0: float) -> Rolled:
    """Rolling motion at times `time` (n,) [s], from theta0 [rad] and omega0 [rad/s] at time[0]."""

    def forces(theta: float, omega: float) -> tuple[float, float, float]:
        x, z, radius = body.touching(theta)
        # The body's point at r = (x, z) from c stands still: v_c = -omega (z, -x). The touching point runs
        # ahead by radius * omega.
        vx, vz = -omega * z, omega * x
        bend_x, bend_z = -omega * (-vz), omega * (radius * omega - vx)
        # a_c = alpha (-z, x) + bend, F = a_x, N = a_z + G, inertia alpha = F z - N x.
        alpha = (bend_x * z - (bend_z + G) * x) / (body.inertia + z * z + x * x)
        return alpha, -alpha * z + bend_x, alpha * x + bend_z + G

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [y[1], forces(*y)[0]]

    out = solve_ivp(
        rate, (time[0], time[-1]), [theta0, omega0], t_eval=time, rtol=1e-10, atol=1e-12, method="DOP853"
    )
    along = np.array([forces(*y) for y in out.y.T])
    return Rolled(out.y[0], float(np.max(np.abs(along[:, 1] / along[:, 2]))), float(np.min(along[:, 2])) / G)


@dataclass(frozen=True)
class SeenRoll:
    """Noisy measurement of one rolling strike, from the release to 25 degrees past phi.

    It ends earlier if the body falls back.
    """

    body: RollingBody
    time: np.ndarray
    clean: np.ndarray
    angle: TipAngle
    noise: float
    omega0: float
    """angular speed [rad/s] at time[0], where theta is clean[0]"""

    @property
    def window(self) -> tuple[int, int]:
        return 0, len(self.time)

    def bound(self, com_sd: float, inertia_sd: float = 0.5) -> tuple[float, float]:
        """Cramer-Rao bounds, 1 sigma, of phi [rad] and of k (relative).

        Of the body itself c is known to `com_sd` [m], and its inertia about the contact to `inertia_sd`
        (relative).
        """
        steps = np.array([1e-6, 1e-6, 1e-7, 1e-6, 1e-5])
        scale = np.array([1e-2, 1e-2, 1e-3, 0.02, 0.2])

        def body_at(x: np.ndarray) -> RollingBody:
            return replace(
                self.body,
                com=(self.body.com[0] + x[0], self.body.com[1] + x[1]),
                inertia=self.body.inertia + x[2],
            )

        def theta_at(x: np.ndarray) -> np.ndarray:
            return roll_on(body_at(x), self.time, float(self.clean[0]) + x[3], self.omega0 + x[4]).theta

        def wanted(x: np.ndarray) -> np.ndarray:
            body = body_at(x)
            return np.array(
                [
                    body.phi,
                    body.k / self.body.k,
                    *body.com,
                    math.log(body.inertia + float(np.hypot(*body.com)) ** 2),
                ]
            )

        both = [
            [(f(e * h) - f(-e * h)) / (2 * h) for e, h in zip(np.eye(5), steps, strict=True)]
            for f in (theta_at, wanted)
        ]
        rows, by = (np.array(each).T * scale for each in both)
        information = (
            rows.T @ rows / self.noise**2
            + by[2:].T @ np.diag([com_sd**-2, com_sd**-2, inertia_sd**-2]) @ by[2:]
        )
        covariance = by @ np.linalg.inv(information) @ by.T
        return math.sqrt(covariance[0, 0]), math.sqrt(covariance[1, 1])


def seen_roll(
    body: RollingBody, energy: float, noise: float, rng: np.random.Generator, rate: float = 120.0
) -> SeenRoll | None:
    """Strike at an energy ratio, with noise [rad]; None if it would slide (friction above 0.8) or lift."""
    time = rng.uniform(2.0, 3.0) / rate + np.arange(round(1.2 * rate)) / rate
    fine = roll_on(body, np.concatenate([[0.0], time]), 0.0, body.omega_for(energy))
    theta = fine.theta[1:]
    stop = len(theta)
    for ended in (theta > body.phi + math.radians(25), theta < math.radians(0.7)):
        if ended.any():
            stop = min(stop, int(np.argmax(ended)))
    if stop < 12:
        return None
    used = roll_on(body, np.concatenate([[0.0], time[:stop]]), 0.0, body.omega_for(energy))
    if used.friction > 0.8 or used.load < 0.1:
        return None
    near = roll_on(body, np.array([0.0, time[0] - 1e-4, time[0] + 1e-4]), 0.0, body.omega_for(energy)).theta
    sd = np.full(stop, noise)
    time_ns = np.rint(time[:stop] * 1e9).astype(np.int64) + 10**18
    angle = TipAngle(time_ns, theta[:stop] + rng.normal(0, noise, stop), sd, np.zeros(stop), np.zeros(stop))
    return SeenRoll(body, time[:stop], theta[:stop], angle, noise, float(near[2] - near[1]) / 2e-4)


def draw_rolling(rng: np.random.Generator, a: float, b: float) -> RollingBody:
    """Random body on a flank with half axes a and b [m] that tips at 12 to 45 degrees."""
    while True:
        phi, R = math.radians(rng.uniform(12, 45)), rng.uniform(0.05, 0.12)
        flank = RollingBody(a, b, (0.0, 0.0), 0.0)
        x, z, radius = flank.touching(phi)
        # c stands R + radius over the touching point, which is at (x, z) from the centre in W; turned back.
        z += R + radius
        com = (x * math.cos(phi) - z * math.sin(phi), z * math.cos(phi) + x * math.sin(phi))
        # c lies within a fifth of the body's size of its middle.
        top, back = (com[1] + b) / rng.uniform(0.35, 0.65), (a - com[0]) / rng.uniform(0.35, 0.65) - a
        if back > 0 and top > b:
            return RollingBody(a, b, com, rng.uniform(0.25, 0.5) * R * R + 0.2 * radius**2, top, back)


def section_of_body(body: RollingBody, facets: int = 24) -> SupportFunction:
    """Support function of the faceted flank about the ellipse's centre."""
    return support_of_outline(body.outline(facets), np.zeros(2))


def as_tracked(
    body: RollingBody, energy: float, noise: float, rng: np.random.Generator, slide: float = 0.0
) -> tuple[PlanarMotion, StrikeTask]:
    """Whole strike, of which a camera follows the ellipse's centre, and its task.

    `slide` is the distance [m] that the body slides, in addition to rolling, in 0.2 s.
    """
    rate = 120.0
    time = (np.arange(round(1.45 * rate)) - round(0.25 * rate) + 0.3) / rate
    after = time > 0
    moved = roll_on(body, np.concatenate([[0.0], time[after]]), 0.0, body.omega_for(energy)).theta[1:]
    stopped = (moved > math.radians(80)) | (
        np.minimum.accumulate(np.where(np.arange(len(moved)) > 3, moved, 1.0)) < 0
    )
    first = int(np.argmax(stopped)) if stopped.any() else len(moved)
    theta = np.zeros_like(time)
    theta[after] = np.where(
        np.arange(len(moved)) < first, moved, np.clip(moved[min(first, len(moved) - 1)], 0.0, None)
    )
    centre = replace(body, com=(0.0, 0.0))
    fine = np.linspace(0.0, max(float(theta.max()), 0.01), 2000)
    touching = np.array([centre.touching(each) for each in fine])
    travel = np.concatenate([[0.0], np.cumsum(0.5 * (touching[1:, 2] + touching[:-1, 2]) * np.diff(fine))])
    slip = np.interp(theta, fine, travel - touching[:, 0] + touching[0, 0]) + slide * np.clip(
        time / 0.2, 0.0, 1.0
    )
    lift = np.interp(theta, fine, touching[0, 1] - touching[:, 1])
    n = len(time)
    angle = TipAngle(
        np.rint(time * 1e9).astype(np.int64) + 10**18,
        theta + rng.normal(0, noise, n),
        np.full(n, noise),
        np.abs(rng.normal(0, noise, n)),
        slip + rng.normal(0, 2e-5, n),
        zero_sd=noise / math.sqrt(np.count_nonzero(~after)),
    )
    angle = replace(angle, theta=angle.theta - angle.theta[~after].mean())
    covariance = np.broadcast_to(np.diag([noise**2, 4e-10, 4e-10]), (n, 3, 3)).copy()
    motion = PlanarMotion(
        angle,
        lift + rng.normal(0, 2e-5, n),
        np.full(n, 2e-5),
        np.full(n, noise),
        0.0,
        covariance,
    )
    plan = planned(0.0, body.phi + math.radians(float(rng.normal(0, 2))), rolls=True)
    return motion, StrikeTask("s1.1", plan, 10**18, None, section_of_body(body))
