"""Tips of a box on a sloping table, by Lagrange's equation in space; independent of the estimators.

Models: gravity as a vector, the object's pose at its heading, an edge's rounding that rolls without slip,
frames with noise. Does not model: slip, air, the striker (a tip starts with an angular rate).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.types import Array, TipAngle
from schemas.strike_plan import PlannedStrike
from tests.analyze.estimation.bodies import GRAVITY, Body

FRAME_S = 1 / 120
SUBSTEPS = 3
REST = 30
FRAMES = 170
PAST = np.radians(25.0)
"""angle [rad] past balance at which a fit ends"""
ENERGY = 1.1
REVERSED = np.pi


@dataclass(frozen=True)
class PlacedStrike:
    """One strike with the true pose of the object on the table."""

    body: Body
    strike: PlannedStrike
    slope: Array
    """(2,) slope of the table towards W's x and y"""
    moved: Array
    """(3,) true minus planned place of the centre line [m], in O"""
    radius: float
    turned: float
    """error [rad] of the object's rest angle about the edge"""


def reversed_strike(strike: PlannedStrike, repeat: int = 0) -> PlannedStrike:
    """Strike over the same edge as `strike`, with the object turned by 180 degrees on the table."""
    return strike.model_copy(update={"id": f"{strike.axis_id}#r{repeat}", "heading_rad": REVERSED})


def measured_tips(
    laid: list[PlacedStrike], noise: float, rng: np.random.Generator
) -> list[tuple[TipAngle, tuple[int, int]]]:
    """Measured tip angle of each strike with `noise` [rad] per frame, and the frames of its free motion."""
    line, tip, start = _placed(laid)
    n = len(laid)
    radius = np.array([each.radius for each in laid])
    slope = np.array([each.slope for each in laid])
    down = -np.column_stack([slope, np.ones(n)])
    mass = np.array([each.body.mass for each in laid])
    pull = mass[:, None] * GRAVITY * down / np.linalg.norm(down, axis=1, keepdims=True)
    in_body = np.array([each.strike.pivot.direction for each in laid])
    about_c = np.einsum("ni,nij,nj->n", in_body, np.array([each.body.inertia for each in laid]), in_body)

    # Rodrigues' formula for all angles: the component that turns, and the same turned by 90 degrees.
    along = line * np.sum(start * line, axis=1, keepdims=True)
    across, later, rolled = start - along, np.cross(line, start), radius[:, None] * tip

    def course(theta: Array) -> Array:
        """Displacement (n, 3) of c from its start at angles `theta` (n,)."""
        return (
            rolled * theta[:, None]
            + np.cos(theta)[:, None] * across
            + np.sin(theta)[:, None] * later
            - across
        )

    def acceleration(theta: Array, rate: Array) -> Array:
        cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
        by_theta = rolled + cos * later - sin * across
        bend = -(cos * across + sin * later)
        moment = about_c + mass * np.sum(by_theta**2, axis=1)
        by_moment = 2 * mass * np.sum(by_theta * bend, axis=1)
        return (np.sum(pull * by_theta, axis=1) - 0.5 * by_moment * rate**2) / moment

    grid = np.linspace(0, 1.4, 701)
    work = np.array([np.sum(pull * course(np.full(n, each)), axis=1) for each in grid])
    balance = grid[np.argmin(work, axis=0)]
    moment = about_c + mass * np.sum((rolled + later) ** 2, axis=1)
    theta, rate = np.zeros(n), np.sqrt(2 * ENERGY * -work.min(axis=0) / moment)
    h, path = FRAME_S / SUBSTEPS, [theta]
    for _ in range(FRAMES):
        for _ in range(SUBSTEPS):
            a1 = acceleration(theta, rate)
            a2 = acceleration(theta + h / 2 * rate, rate + h / 2 * a1)
            a3 = acceleration(theta + h / 2 * rate + h * h / 4 * a1, rate + h / 2 * a2)
            a4 = acceleration(theta + h * rate + h * h / 2 * a2, rate + h * a3)
            theta, rate = (
                theta + h * rate + h * h / 6 * (a1 + a2 + a3),
                rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
            )
        path.append(theta)
    courses = np.array(path)
    seen: list[tuple[TipAngle, tuple[int, int]]] = []
    for i in range(n):
        free = int(np.argmax(courses[:, i] > balance[i] + PAST)) or len(courses)
        true = np.concatenate([np.zeros(REST), courses[: free + 1, i]])
        many = len(true)
        time_ns = (1_000_000_000 + np.arange(many) * FRAME_S * 1e9).astype(np.int64)
        measured = true + rng.normal(0, noise, many)
        measured -= measured[:REST].mean()
        angle = TipAngle(
            time_ns, measured, np.full(many, noise), np.zeros(many), np.zeros(many), noise / np.sqrt(REST)
        )
        seen.append((angle, (REST + 1, REST + free)))
    return seen


def _placed(laid: list[PlacedStrike]) -> tuple[Array, Array, Array]:
    """Pivot lines and tip directions (n, 3), and c from the true centre line at rest (n, 3) [m], in W."""
    lines, tips, arms = [], [], []
    for each in laid:
        heading = each.strike.heading_rad
        on_table = np.array(
            [[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1.0]]
        )
        R = on_table @ np.array(each.strike.R_world_object)
        line = R @ np.array(each.strike.pivot.direction)
        arm = R @ (each.body.com - np.array(each.strike.pivot.point) - each.moved)
        lines.append(line)
        tips.append(on_table @ np.array([1.0, 0.0, 0.0]))
        arms.append(_turned(arm[None], line[None], np.array([each.turned]))[0])
    return np.array(lines), np.array(tips), np.array(arms)


def _turned(arm: Array, line: Array, theta: Array) -> Array:
    """Vectors `arm` (n, 3) turned about unit `line` (n, 3) by `theta` (n,) [rad]: Rodrigues' formula."""
    along = line * np.sum(arm * line, axis=-1, keepdims=True)
    cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
    return along + cos * (arm - along) + sin * np.cross(line, arm)


@dataclass(frozen=True)
class ErrorSds:
    """1 sigma of errors drawn per session, per axis and heading, and per strike."""

    tilt: float
    edge: float = 2e-4
    radius: float = 1e-4
    axis_angle: float = 2e-4
    strike_angle: float = 5e-4


def placed_session(
    body: Body, strikes: list[PlannedStrike], drawn: ErrorSds, rng: np.random.Generator
) -> list[PlacedStrike]:
    """Strikes of a session with drawn errors."""
    slope, more_radius = rng.normal(0, drawn.tilt, 2), rng.normal(0, drawn.radius)
    moved: dict[str, Array] = {}
    angle: dict[tuple[str, float], float] = {}
    found: list[PlacedStrike] = []
    for strike in strikes:
        tip, _, up = np.array(strike.R_world_object)
        if strike.axis_id not in moved:
            moved[strike.axis_id] = (
                rng.normal(0, drawn.edge) * tip + rng.normal(0, drawn.edge) * up + more_radius * (up - tip)
            )
        key = (strike.axis_id, strike.heading_rad)
        angle.setdefault(key, rng.normal(0, drawn.axis_angle))
        turned = angle[key] + rng.normal(0, drawn.strike_angle)
        found.append(
            PlacedStrike(body, strike, slope, moved[strike.axis_id], body.edge_radius + more_radius, -turned)
        )
    return found
