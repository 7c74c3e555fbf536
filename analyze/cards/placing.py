"""How the object lies for a strike, and how it gets there from where it lay before, as words that cannot be misread.

Directions are named by what stands there (the striker at -x of W, the camera at -y): right and left depend on where the reader stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.geometry.rotations import matrix_from_vector
from analyze.types import Array
from schemas.object_spec import ObjectSpec

CHANGE_SIDES = "set striker and object on the other side of the line, both turned half round (180°)"
SAME = np.radians(1.0)
"""rotations smaller than this are no instruction"""
ON_SIDE = np.radians(15.0)
"""between a side's direction and the normal of the tag that names it"""

TOWARDS = {
    "away from the striker": np.array([1.0, 0.0, 0.0]),
    "towards the striker": np.array([-1.0, 0.0, 0.0]),
    "away from the camera": np.array([0.0, 1.0, 0.0]),
    "towards the camera": np.array([0.0, -1.0, 0.0]),
}
"""directions on the table, in W"""


@dataclass(frozen=True)
class Turn:
    """About the vertical; + is anticlockwise seen from above [rad]."""

    angle: float

    def matrix(self) -> Array:
        """(3, 3) in W."""
        return matrix_from_vector(np.array([0.0, 0.0, self.angle]))

    def words(self) -> str:
        """As an instruction."""
        degrees = round(abs(np.degrees(self.angle)))
        if degrees == 180:
            return "turn it half round on the table (180°)"
        return f"turn it {degrees}° {'anticlockwise' if self.angle > 0 else 'clockwise'}, seen from above"


@dataclass(frozen=True)
class Tilt:
    """Over a horizontal axis, its top going in a direction of `TOWARDS` by an angle [rad]."""

    towards: str
    angle: float

    def matrix(self) -> Array:
        """(3, 3) in W."""
        return matrix_from_vector(np.cross(np.array([0.0, 0.0, 1.0]), TOWARDS[self.towards]) * self.angle)

    def words(self) -> str:
        """As an instruction."""
        degrees = round(np.degrees(self.angle))
        if degrees == 180:
            return f"turn it upside down, its top going over {self.towards}"
        if degrees == 90:
            return f"tip it over 90°, its top going {self.towards}: what was on top then faces {_faces(self.towards)}"
        return f"tip it {degrees}°, its top going {self.towards}"


Move = Turn | Tilt


def moves(R_before: Array, R_now: Array) -> list[Move]:
    """Fewest turns and tilts, carried out one after the other in W, from one placement to the next.

    Args:
        R_before: (3, 3) R_world_object of the card before.
        R_now: (3, 3) the same of this card.

    Returns:
        At most turn, tilt, turn; tilts are towards or away from striker or camera. Nothing where both are the same.
    """
    change = R_now @ R_before.T
    rises = change.T @ np.array([0.0, 0.0, 1.0])
    angle = float(np.arccos(np.clip(rises[2], -1, 1)))
    if angle < SAME:
        turn = float(np.arctan2(change[1, 0], change[0, 0]))
        return [Turn(turn)] if abs(turn) > SAME else []
    choices: list[tuple[int, float, int, list[Move]]] = []
    for rank, (towards, direction) in enumerate(TOWARDS.items()):
        tilt = Tilt(towards, angle)
        # What shall come on top must first lie opposite to where the top goes; upside down it is there anyway.
        first = 0.0 if angle > np.pi - SAME else _between(-rises[:2], direction[:2])
        rest = change @ Turn(first).matrix().T @ tilt.matrix().T
        last = float(np.arctan2(rest[1, 0], rest[0, 0]))
        turns = [each for each in (first, last) if abs(each) > SAME]
        steps: list[Move] = [tilt]
        if abs(first) > SAME:
            steps.insert(0, Turn(first))
        if abs(last) > SAME:
            steps.append(Turn(last))
        choices.append((len(turns), round(sum(map(abs, turns)), 6), rank, steps))
    return min(choices, key=lambda choice: choice[:3])[3]


def change_in_words(R_before: Array, R_now: Array) -> str:
    """The moves as one sentence; empty where the object lies as before."""
    steps = [move.words() for move in moves(R_before, R_now)]
    text = "; then ".join(steps)
    return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class Sides:
    """What of the object faces where: a tag where one is on that side, O's axis otherwise."""

    under: str
    top: str
    camera: str
    striker: str
    away: str
    behind: str


def sides(spec: ObjectSpec, R_world_object: Array) -> Sides:
    """The five sides that matter at the table."""

    def side(direction: list[float]) -> str:
        return side_name(spec, R_world_object.T @ np.array(direction))

    return Sides(side([0, 0, -1]), side([0, 0, 1]), side([0, -1, 0]), side([-1, 0, 0]), side([1, 0, 0]), side([0, 1, 0]))


def side_name(spec: ObjectSpec, direction: Array) -> str:
    """Name of the side that looks along `direction` (3,) of O."""
    best, least = None, ON_SIDE
    for marker in spec.marker:
        if marker.T_object_marker is None:
            continue
        angle = float(np.arccos(np.clip(np.array(marker.T_object_marker)[:3, 2] @ direction, -1, 1)))
        if angle < least - 1e-9:
            best, least = marker.name, angle
    return axis_name(direction) if best is None else f"tag {best}"


def axis_name(direction: Array) -> str:
    """The axis of O nearest to `direction` (3,), as the side of the shape's frame; between two axes both are named."""
    order = np.argsort(-np.abs(direction))
    names = [f"{'+' if direction[i] > 0 else '−'}{'xyz'[i]}" for i in order if abs(direction[i]) > 0.5]
    return f"the {'/'.join(sorted(names, key=lambda name: name[1]))} side"


def _faces(towards: str) -> str:
    return towards.removeprefix("towards ")


def _between(start: Array, end: Array) -> float:
    """Angle [rad] that turns the plane vector `start` (2,) into the direction of `end` (2,)."""
    return float(np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end))
