"""Closed boxes with something inside that stays or moves, drawn at random, and the strikes that test them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from tests.benchmarks.contents.moving import Path, floor_path, level_path, pendulum_path
from tests.benchmarks.contents.planar import G

PHI_RANGE = (math.radians(13), math.radians(47))
"""balance angles of edges that are struck"""
LIQUID_DENSITY, POWDER_DENSITY = 1000.0, 700.0
MOST_FILLED = 0.85
"""largest filled share of a cavity"""
REPOSE = (math.radians(25), math.radians(35))
"""range of the angle of repose of powder"""
LOG_DAMPING = (-0.9, 0.6)
"""range of the decimal logarithm of a liquid's damping [1/s]: half a percent to a fifth of the critical"""
ATTEMPTS = 400


class Kind(Enum):
    """What a box holds besides what is fixed to it; the value is its name in tables."""

    NOTHING = "nothing moves"
    LIQUID = "liquid, level"
    PENDULUM = "liquid, pendulum"
    POWDER = "powder"
    LUMP = "loose lump"


@dataclass(frozen=True)
class Contents:
    """What moves inside, and how much of it."""

    kind: Kind
    share: float = 0.0
    """its mass over the whole mass"""
    friction: tuple[float, float] = (0.1, 0.3)
    """range of the dry friction of a lump on the floor"""


@dataclass(frozen=True)
class Edge:
    """Edge of a box: face on which it rests and side to which it tips; axes are numbered 0 to 2 (x, y, z)."""

    face: int
    """axis that points down"""
    sign: int
    """its sense"""
    third: int
    """axis along which the box tips"""
    side: int
    """its sense"""

    @property
    def along(self) -> int:
        """Axis parallel to the edge."""
        return 3 - self.face - self.third

    @property
    def pose(self) -> tuple[int, int]:
        """Face on which the box rests."""
        return self.face, self.sign


EDGES = tuple(
    Edge(face, sign, third, side)
    for face in range(3)
    for sign in (-1, 1)
    for third in range(3)
    if third != face
    for side in (-1, 1)
)


@dataclass(frozen=True)
class Box:
    """Box centred on O with its masses; SI."""

    size: np.ndarray
    """(3,)"""
    wall: float
    mass: float
    """whole mass"""
    fixed: float
    """mass of what does not move"""
    com: np.ndarray
    """(3,) centre of mass of what does not move"""
    inertia: np.ndarray
    """(3, 3) moment tensor of it about that"""
    radius: float
    """radius of all edges"""
    friction: float
    table_rate: float
    table_damping: float
    contents: Contents
    inner_friction: float
    inner_damping: float
    place: float
    """place of a lump at rest, as a share of the way from wall to wall"""
    lump_size: float

    @property
    def cavity(self) -> np.ndarray:
        """Inner size (3,)."""
        return self.size - 2 * self.wall

    def path(self, edge: Edge) -> Path | None:
        """Path of what moves, across the edge; None if nothing moves or it does not fit."""
        width, height = self.cavity[edge.third], self.cavity[edge.face]
        kind, moving = self.contents.kind, self.mass - self.fixed
        if kind is Kind.NOTHING:
            return None
        if kind is Kind.LUMP:
            return floor_path(width, self.lump_size, self.place if edge.side > 0 else 1 - self.place)
        density = POWDER_DENSITY if kind is Kind.POWDER else LIQUID_DENSITY
        filled = moving / density / float(np.prod(self.cavity))
        if kind is Kind.PENDULUM:
            return pendulum_path(width, filled * height)
        return level_path(width, height, filled)

    def resting_com(self, pose: tuple[int, int]) -> np.ndarray:
        """Centre of mass (3,) of all when it rests on a face."""
        face, sign = pose
        place = np.zeros(3)
        if self.contents.kind is Kind.LUMP:
            # It lies at the same share of the way along both directions of the floor.
            place = (self.place - 0.5) * (self.cavity - self.lump_size)
            deep = 0.5 * self.lump_size
        else:
            density = POWDER_DENSITY if self.contents.kind is Kind.POWDER else LIQUID_DENSITY
            filled = (self.mass - self.fixed) / density / float(np.prod(self.cavity))
            deep = 0.5 * filled * self.cavity[face]
        place[face] = sign * (0.5 * self.cavity[face] - deep)
        return (self.fixed * self.com + (self.mass - self.fixed) * place) / self.mass

    def balance(self, edge: Edge) -> float:
        """Angle [rad] at which the body would balance if all stayed where it rests."""
        com = self.resting_com(edge.pose)
        back = 0.5 * self.size[edge.third] - self.radius - edge.side * com[edge.third]
        up = 0.5 * self.size[edge.face] - self.radius - edge.sign * com[edge.face]
        return math.atan2(back, up)


def draw_box(contents: Contents, rng: np.random.Generator) -> Box:
    """Random box that holds these contents and can be tested: two poses, one of them with two directions."""
    for _ in range(ATTEMPTS):
        box = _drawn(contents, rng)
        if box is not None and chosen_edges(box, rng) is not None:
            return box
    raise ValueError(f"no box holds {contents}")


def _drawn(contents: Contents, rng: np.random.Generator) -> Box | None:
    size = np.sort(rng.uniform([0.05, 0.06, 0.09], [0.09, 0.11, 0.18]))
    size = size[[1, 0, 2]]
    wall, mass = rng.uniform(0.0015, 0.004), rng.uniform(0.08, 0.6)
    cavity = size - 2 * wall
    density = POWDER_DENSITY if contents.kind is Kind.POWDER else LIQUID_DENSITY
    if contents.share * mass / density > MOST_FILLED * float(np.prod(cavity)):
        return None
    fixed = mass * (1 - contents.share)
    wall_share = rng.uniform(0.3, 0.9)
    lump = rng.uniform(-0.3, 0.3, 3) * cavity
    # Wall: that of a box of uniform thickness; fixed part: a ball.
    outer, inner = float(np.prod(size)), float(np.prod(cavity))
    second = (size**2 * outer - cavity**2 * inner) / 12 / (outer - inner)
    reach = rng.uniform(0.008, 0.02)
    com = (1 - wall_share) * lump
    about = wall_share * np.diag(second) + (1 - wall_share) * (
        0.2 * reach**2 * np.eye(3) + np.outer(lump, lump)
    )
    about = fixed * (about - np.outer(com, com))
    friction = {Kind.LUMP: rng.uniform(*contents.friction), Kind.POWDER: math.tan(rng.uniform(*REPOSE))}
    damping = rng.uniform(*LOG_DAMPING) if contents.kind in (Kind.LIQUID, Kind.PENDULUM) else -math.inf
    return Box(
        size,
        wall,
        mass,
        fixed,
        com,
        np.trace(about) * np.eye(3) - about,
        radius=float(rng.choice([1e-4, 3e-4, 1e-3, 2e-3])),
        friction=rng.uniform(0.3, 0.8),
        table_rate=rng.uniform(700, 2500),
        table_damping=rng.uniform(0.1, 0.35),
        contents=contents,
        inner_friction=friction.get(contents.kind, 0.0),
        inner_damping=10**damping,
        place=rng.uniform(0.2, 0.8),
        lump_size=min(0.03, 0.4 * float(cavity.min())),
    )


def chosen_edges(box: Box, rng: np.random.Generator) -> list[Edge] | None:
    """Edges of a test: two across each other in one pose, one or two in another; None if there are none."""
    good = [
        edge for edge in EDGES if PHI_RANGE[0] < box.balance(edge) < PHI_RANGE[1] and _stands(box, edge.pose)
    ]
    order = [good[i] for i in rng.permutation(len(good))]
    for first in order:
        second = next((e for e in order if e.pose == first.pose and e.third != first.third), None)
        third = next((e for e in order if e.pose != first.pose), None)
        if second is None or third is None:
            continue
        fourth = next((e for e in order if e.pose == third.pose and e.third != third.third), None)
        fourth = fourth or next((e for e in order if e.pose == third.pose and e.side != third.side), None)
        return [first, second, third, *([fourth] if fourth else [])]
    return None


def _stands(box: Box, pose: tuple[int, int]) -> bool:
    """True if the box stands firmly on a face: it balances by 8 degrees or more over each of its edges."""
    return all(box.balance(edge) > math.radians(8) for edge in EDGES if edge.pose == pose)


def needed_energy(box: Box, edge: Edge) -> tuple[float, float]:
    """Moment of inertia [kg m^2] about the edge and energy [J] to balance, if all stayed where it rests."""
    com, mass = box.resting_com(edge.pose), box.mass
    moving = mass - box.fixed
    axis = edge.along
    about = float(box.inertia[axis, axis]) + box.fixed * _across(box.com - com, axis)
    if moving > 0:
        place = (mass * com - box.fixed * box.com) / moving
        about += moving * _across(place - com, axis)
    back = 0.5 * box.size[edge.third] - box.radius - edge.side * com[edge.third]
    up = 0.5 * box.size[edge.face] - box.radius - edge.sign * com[edge.face]
    distance = math.hypot(back, up)
    inertia = about + mass * (back**2 + (up + box.radius) ** 2)
    return inertia, mass * G * (distance - up)


def _across(arm: np.ndarray, axis: int) -> float:
    return float(arm @ arm - arm[axis] ** 2)
