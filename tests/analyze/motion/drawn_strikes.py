"""Strikes of all kinds, drawn at random and simulated in the plane, as cameras see them.

For tests and `make bench-motion`; the simulation is sliding.py. The kind of a strike follows from its
simulated motion, by the limits that the manual states. Between "clearly" and "clearly not" lies a range in
which either verdict is right; such strikes are drawn again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import PlanarMotion
from analyze.types import TipAngle, TipMotion
from schemas.strike_result import Verdict
from tests.analyze.motion.sliding import Body, Course, Push, push_for, simulate
from tests.analyze.motion.tipping import planned

PLACE_SD = 5e-4
"""standard deviation of the edge's place, as a known place of the marker on the object gives it [m]"""
T0 = 10**18
LEVER = 0.1
"""distance from the edge to the marker [m], over which an error of the angle moves the edge's place"""
KINDS = (
    "good",
    "rocked back",
    "slid",
    "airborne",
    "struck twice",
    "twisted",
    "rolled",
    "marker lost",
    "not moved",
    "outside the window",
)
EXPECTED = {
    "good": {Verdict.GOOD},
    "rocked back": {Verdict.ROCKED_BACK},
    "slid": {Verdict.SLID},
    "airborne": {Verdict.AIRBORNE},
    "struck twice": {Verdict.STRUCK_TWICE},
    "twisted": {Verdict.TWISTED},
    "rolled": {Verdict.ROLLED},
    "marker lost": {Verdict.MARKER_LOST},
    "not moved": {Verdict.NOT_MOVED},
    "outside the window": {Verdict.UNREADABLE, Verdict.MARKER_LOST},
}


@dataclass(frozen=True)
class Strike:
    """Simulated strike: the truth and its noisy measurement."""

    kind: str
    body: Body
    course: Course
    motion: PlanarMotion
    task: StrikeTask
    noise: float
    """1 sigma of the measured angle in one frame [rad]"""
    energy: float

    def analysed(self) -> TipMotion:
        """Motion of the strike, analysed by the code under test."""
        return analyse_motion(self.motion, self.task, MotionSettings())


def draw_body(rng: np.random.Generator) -> Body:
    """Random body of 80 to 260 mm that tips at 12 to 50 degrees."""
    height = rng.uniform(0.08, 0.26)
    phi = math.radians(rng.uniform(12, 50))
    R = 0.5 * height / math.cos(phi) * rng.uniform(0.8, 1.2)
    return Body(
        R=R,
        phi=phi,
        inertia=R * R * rng.uniform(0.25, 0.5),
        rho=rng.choice([0.0, 0.0005, 0.001, 0.002, 0.005]),
        friction=rng.uniform(0.2, 0.8),
        height=height,
    )


def holding_height(body: Body) -> float:
    """Height of a push [m] at which the edge slides neither forwards nor backwards.

    It is the centre of percussion, or the top of the body.
    """
    return min(0.98 * body.height, (body.inertia + body.R**2) / (body.R * math.cos(body.phi)))


def seen(
    course: Course,
    body: Body,
    rng: np.random.Generator,
    noise: float,
    rolls: bool = False,
    contact_known: bool = True,
) -> tuple[PlanarMotion, StrikeTask]:
    """Simulated motion with noise in every frame, as a camera would measure it, and its task.

    The noise of the angle (`noise` [rad]) also moves the edge's place, as seen at a marker LEVER above it.
    """
    n = len(course.time)
    error = rng.normal(0, noise, n)
    time_ns = np.rint(course.time * 1e9).astype(np.int64) + T0
    place = math.hypot(LEVER * noise, 1e-5)
    angle = TipAngle(
        time_ns,
        course.theta + error,
        np.full(n, noise),
        np.abs(rng.normal(0, 2 * noise, n)),
        course.slip - LEVER * error * np.cos(course.theta) + rng.normal(0, 1e-5, n),
        zero_sd=noise / math.sqrt(np.count_nonzero(course.time < 0)),
    )
    # The zero is the mean of the resting frames, as tip_angle takes it.
    rest = course.time < 0
    angle = replace(
        angle, theta=angle.theta - angle.theta[rest].mean(), slip=angle.slip - angle.slip[rest].mean()
    )
    lift = course.lift + LEVER * error * np.sin(course.theta) + rng.normal(0, 1e-5, n)
    by_error = noise * np.stack(
        [np.ones(n), -LEVER * np.cos(course.theta), LEVER * np.sin(course.theta)], axis=-1
    )
    covariance = by_error[:, :, None] * by_error[:, None, :] + np.diag([0.0, 1e-10, 1e-10])
    motion = PlanarMotion(
        angle,
        lift - lift[rest].mean(),
        np.full(n, place),
        np.full(n, 2 * noise),
        0.0,
        covariance,
        PLACE_SD,
    )
    off = math.radians(rng.normal(0, 3))
    plan = planned(body.rho, body.phi + off, rolls)
    return motion, StrikeTask("s1.1", plan, T0 if contact_known else 0)


def draw(kind: str, rng: np.random.Generator, noise: float | None = None) -> Strike:
    """Random strike of this kind."""
    while True:
        strike = _drawn(kind, rng, noise)
        if strike is not None:
            return strike


def _energy_and_height(kind: str, body: Body, rng: np.random.Generator) -> tuple[float, float]:
    """Energy ratio and height of the push [m] of a strike of this kind."""
    energy = rng.uniform(0.35, 0.97) if kind == "rocked back" else 1 + rng.exponential(0.25) + 0.02
    height = holding_height(body) * rng.uniform(0.9, 1.05)
    if kind == "slid":
        height *= rng.uniform(0.5, 0.75)
        energy = rng.uniform(1.2, 3.0)
    if kind == "not moved":
        energy = rng.uniform(0.0, 0.003)
    if kind == "airborne":
        return rng.uniform(4.0, 9.0), height
    return min(energy, 3.0), height


def _drawn(kind: str, rng: np.random.Generator, noise: float | None) -> Strike | None:
    body = draw_body(rng)
    noise = math.radians(0.01 * 10 ** rng.uniform(0, 1)) if noise is None else noise
    energy, height = _energy_and_height(kind, body, rng)
    pushes = [push_for(body, energy, min(height, 0.98 * body.height))]
    if kind == "struck twice":
        first = pushes[0]
        pushes.append(
            Push(
                first.impulse * rng.uniform(0.15, 0.5),
                first.height,
                first.seconds,
                at=rng.uniform(0.065, 0.12),
            )
        )
    course = simulate(body, pushes, phase=rng.uniform(0, 1))
    if not _is(kind, course, body):
        return None
    n = len(course.time)
    motion, task = seen(course, body, rng, noise, rolls=kind == "rolled", contact_known=rng.random() < 0.7)
    if kind in ("twisted", "rolled"):
        turn = math.radians(rng.uniform(8, 25)) * np.clip((course.time - 0.01) / rng.uniform(0.1, 0.4), 0, 1)
        before = course.theta < body.phi + math.radians(4)
        if turn[before & (course.time > 0)].max(initial=0.0) < math.radians(7):
            return None
        motion = replace(
            motion, angle=replace(motion.angle, off_axis=np.abs(turn + rng.normal(0, 2 * noise, n)))
        )
    if kind == "marker lost":
        first = int(np.searchsorted(course.time, rng.uniform(0.02, 0.15)))
        if course.theta[first] > body.phi + math.radians(15):
            return None
        motion = _without(motion, np.r_[0:first, first + int(rng.integers(8, 30)) : n])
    if kind == "outside the window":
        end = rng.uniform(-0.1, 0.12)
        motion = _without(motion, np.flatnonzero(course.time < end))
        task = replace(task, contact_time_ns=T0, images_end_ns=T0 + round(1e9 * end))
    return Strike(kind, body, course, motion, task, noise, energy)


def draw_free(rng: np.random.Generator, slides: bool) -> Strike:
    """Random strike whose edge slides by 0.2 to 6 mm, or does not slide.

    Energy ratio 0.8 to 3, friction 0.2 to 0.8, rounding 0 to 5 mm, noise 0.05 to 0.5 degrees.
    """
    while True:
        body = draw_body(rng)
        noise, energy = math.radians(0.05 * 10 ** rng.uniform(0, 1)), rng.uniform(0.8, 3.0)
        height = holding_height(body) * (rng.uniform(0.6, 0.9) if slides else rng.uniform(0.92, 1.02))
        course = simulate(
            body, [push_for(body, energy, min(height, 0.98 * body.height))], phase=rng.uniform(0, 1)
        )
        held = course.slid < 1e-4 if not slides else 2e-4 < course.slid < 6e-3
        if held and course.flown < 1e-4 and float(course.theta.max()) > 0.3 * body.phi:
            return Strike("free", body, course, *seen(course, body, rng, noise), noise, energy)


def _is(kind: str, course: Course, body: Body) -> bool:
    """True if the simulated motion is clearly of this kind."""
    peak = float(course.theta.max())
    if kind == "slid":
        return course.slid > 0.006 and peak > math.radians(3) and course.flown < 0.001
    if kind == "airborne":
        return course.flown > 0.004
    if kind == "not moved":
        return peak < math.radians(0.4)
    held = course.slid < 0.002 and course.flown < 0.001
    if kind == "rocked back":
        # Less than a fifth of the way says next to nothing of phi; it is called unreadable or rocked back,
        # either is right.
        return held and not course.over and peak > max(0.2 * body.phi, math.radians(2))
    return held and course.over


def _without(motion: PlanarMotion, kept: np.ndarray) -> PlanarMotion:
    angle = motion.angle
    cut = TipAngle(
        angle.time_ns[kept],
        angle.theta[kept],
        angle.sd[kept],
        angle.off_axis[kept],
        angle.slip[kept],
        angle.zero_sd,
    )
    return replace(
        motion,
        angle=cut,
        lift=motion.lift[kept],
        position_sd=motion.position_sd[kept],
        off_axis_sd=motion.off_axis_sd[kept],
        covariance=motion.covariance[kept],
    )
