"""Struck prisms on a table in MuJoCo, as a camera sees them: edges that hop, creep and change.

A prism's corners carry contact spheres of the radius of its edges; contacts are hard or soft. A half-sine
push tips it, and the edge may be thrown up at its end. Nothing of the estimators is used: MuJoCo integrates
Newton's equations of a free body. Places in the plane across the edge are relative to the planned edge's
centre line at rest: x in the direction of tipping, z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from analyze.motion.landing import landing_angle
from analyze.motion.strike_task import StrikeTask
from analyze.motion.support_function import support_of_outline
from analyze.motion.supports import support_lines
from analyze.motion.tip_angle import PlanarMotion
from tests.analyze.motion.drawn_strikes import seen
from tests.analyze.motion.sliding import Body, Course

G = 9.80665
STEP = 2e-4
MASS = 0.05
DEPTH = 0.06
CONTACTS = {
    "hard": ("0.001 1", "0.995 0.9995 0.0001"),
    "springy": ("-400000 -30", "0.3 0.3 0.001"),
    "soft": ("0.02 1", "0.9 0.95 0.001"),
}
"""MuJoCo's parameters solref and solimp of three contacts: nearly rigid; one that bounces by 0.1 mm; MuJoCo's
default, which creeps by 0.2 mm"""


@dataclass(frozen=True)
class Prism:
    """Prism whose section's corners (centres of their rounding) begin with the planned edge, at (0, 0)."""

    corners: np.ndarray
    """(n, 2) corners of the section without its rounding [m]"""
    rho: float
    com: np.ndarray
    """(2,) centre of mass [m]"""
    inertia: float
    """moment of inertia about the centre of mass, per mass [m^2]"""
    friction: float = 0.6

    @property
    def height(self) -> float:
        """Height of the prism at rest [m]."""
        return float(np.max(self.corners[:, 1])) + 2 * self.rho

    def about(self, corner: np.ndarray) -> Body:
        """Body that turns about one corner, with the true R, phi and k."""
        arm = self.com - corner
        R = float(np.hypot(*arm))
        return Body(R, math.atan2(-arm[0], arm[1]), self.inertia, self.rho, self.friction, self.height)

    def outline(self) -> np.ndarray:
        """Corners (n, 2) [m] of the outline as if sharp, without its rounding."""
        middle = self.corners.mean(axis=0)
        return self.corners + self.rho * np.sign(self.corners - middle)


def chamfered(rng: np.random.Generator) -> Prism:
    """Random prism with a chamfer of 1.5 to 7 mm beyond the planned edge, at 3 to 40 degrees.

    It tips over the planned edge at 8 to 38 degrees.
    """
    while True:
        width, height = rng.uniform(0.05, 0.09), rng.uniform(0.09, 0.2)
        slope, length = math.radians(rng.uniform(3, 40)), rng.uniform(0.0015, 0.007)
        ahead, up = length * math.cos(slope), length * math.sin(slope)
        corners = np.array([[0, 0], [ahead, up], [ahead, height], [-width, height], [-width, 0]])
        com = np.array([-0.5 * width * rng.uniform(0.7, 1.2), height * rng.uniform(0.35, 0.6)])
        inertia = (width**2 + height**2) / 12 * rng.uniform(0.9, 1.2)
        prism = Prism(corners, float(rng.choice([3e-4, 1e-3])), com, inertia, rng.uniform(0.4, 0.8))
        if math.radians(8) < prism.about(corners[0]).phi < math.radians(38):
            return prism


@dataclass(frozen=True)
class Struck:
    """Simulated strike: frames, and the corner over which it stood at balance."""

    prism: Prism
    course: Course
    carried: int | None
    """index of the corner that was lowest at balance; None if it did not pass balance"""


def struck(
    prism: Prism,
    energy: float,
    contact: str = "hard",
    hop: float = 0.0,
    rate: float = 120.0,
    phase: float = 0.3,
    push_s: float = 0.003,
    over: int = 0,
) -> Struck:
    """Simulate a strike with `energy` times the energy that tipping over corner `over` needs.

    `hop` [m/s] throws the edge up at the end of the push.
    """
    model = mujoco.MjModel.from_xml_string(_xml(prism, contact))
    data = mujoco.MjData(model)
    first, last = prism.about(prism.corners[0]), prism.about(prism.corners[over])
    edge = prism.inertia + first.R**2
    need = G * (last.R + prism.corners[over, 1] - prism.com[1])
    if over == 0:
        need = G * first.R * (1 - math.cos(first.phi))
    height = min(0.95 * prism.height, edge / prism.com[1])
    impulse = math.sqrt(2 * need * energy * edge) / height * MASS
    steps = round(1.1 / STEP)
    log = np.zeros((steps, 4))
    for i in range(steps):
        t = i * STEP - 0.1
        pushing = 0 <= t < push_s
        force = impulse * math.pi / (2 * push_s) * math.sin(math.pi * t / push_s) if pushing else 0.0
        data.xfrc_applied[1, 0] = force
        data.xfrc_applied[1, 4] = force * (height - data.qpos[2])
        if hop and i == round((0.1 + push_s) / STEP):
            data.qvel[2] += hop
        mujoco.mj_step(model, data)
        theta = 2 * math.atan2(data.qpos[5], data.qpos[3])
        cos, sin = math.cos(theta), math.sin(theta)
        x = data.qpos[0] - cos * prism.com[0] - sin * prism.com[1]
        z = data.qpos[2] + sin * prism.com[0] - cos * prism.com[1]
        log[i] = (t + STEP, theta, x, z)
    # The angle counts from the table, which a soft face that carries unevenly is 0.02 deg off.
    log[:, 2:] -= log[round(0.095 / STEP), 2:]
    frames = np.arange(-round(0.25 * rate), round(rate) - 2) / rate + phase / rate
    seen_at = np.stack([np.interp(frames, log[:, 0], column) for column in log[:, 1:].T], axis=-1)
    seen_at[frames < 0] = 0.0
    theta = seen_at[:, 0]
    course = Course(frames, theta, seen_at[:, 1] - prism.rho * theta, seen_at[:, 2])
    return Struck(prism, course, _carried(prism, float(log[:, 1].max())))


def _carried(prism: Prism, reached: float) -> int | None:
    """Index of the lowest corner when the centre of mass first stands above it; None if it never does."""
    for theta in np.arange(0.0, reached, math.radians(0.02)):
        cos, sin = math.cos(theta), math.sin(theta)
        low = int(np.argmin(-sin * prism.corners[:, 0] + cos * prism.corners[:, 1]))
        arm = prism.com - prism.corners[low]
        if cos * arm[0] + sin * arm[1] >= 0:
            return low
    return None


def filmed(
    strike: Struck,
    rng: np.random.Generator,
    noise: float,
    offset_sd: float = 0.0,
    place_sd: float | None = None,
    shape: bool = False,
) -> tuple[PlanarMotion, StrikeTask]:
    """Motion with noise [rad] of each frame, the followed point beside the edge by `offset_sd` [m]."""
    prism, course = strike.prism, strike.course
    body = prism.about(prism.corners[0])
    motion, task = seen(course, body, rng, noise)
    off = rng.normal(0, offset_sd, 2) if offset_sd else np.zeros(2)
    cos, sin = np.cos(course.theta) - 1, np.sin(course.theta)
    angle = replace(motion.angle, slip=motion.angle.slip + cos * off[0] + sin * off[1])
    lift = motion.lift - sin * off[0] + cos * off[1]
    motion = replace(motion, angle=angle, lift=lift, place_sd=place_sd)
    if shape:
        section = support_of_outline(prism.outline(), np.zeros(2), prism.rho)
        lines = support_lines(prism.outline(), prism.rho, 1e-4)
        task = replace(task, supports=lines, landing_angle_rad=landing_angle(section, task.planned))
    return motion, task


def _xml(prism: Prism, contact: str) -> str:
    reference, impedance = CONTACTS[contact]
    friction = f'friction="{prism.friction} 0.005 0.0001"'
    spheres = "".join(
        f'<geom type="sphere" size="{prism.rho}" pos="{x - prism.com[0]} {y} {z - prism.com[1]}"'
        f' contype="0" conaffinity="1" {friction}/>'
        for x, z in prism.corners
        for y in (-DEPTH / 2, DEPTH / 2)
    )
    inertia = prism.inertia * MASS
    return f"""<mujoco><option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="50"
 gravity="0 0 {-G}" tolerance="1e-12" iterations="50"/><worldbody>
 <geom type="plane" size="2 2 0.1" contype="1" conaffinity="0" priority="1" {friction}
  solref="{reference}" solimp="{impedance}"/>
 <body name="body" pos="0 0 {prism.com[1] + prism.rho}"><freejoint/>
 <inertial pos="0 0 0" mass="{MASS}" diaginertia="{inertia} {inertia} {inertia}"/>{spheres}</body>
 </worldbody></mujoco>"""
