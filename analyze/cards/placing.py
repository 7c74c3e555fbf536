"""Instructions for placing an object on the table, and for the change from the previous placement.

Directions are named by the striker (at -x of the world frame W) and the camera (at -y), because right and
left depend on the reader's place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.geometry.rotations import matrix_from_vector
from analyze.tags.side_names import side_name
from analyze.types import Array
from schemas.object_spec import ObjectSpec

CHANGE_SIDES = "move striker and object to the other side of the line, both turned by 180°"
MIN_ROTATION = np.radians(1.0)
"""Rotation [rad] below which no instruction is given."""

TOWARDS = {
    "away from the striker": np.array([1.0, 0.0, 0.0]),
    "towards the striker": np.array([-1.0, 0.0, 0.0]),
    "away from the camera": np.array([0.0, 1.0, 0.0]),
    "towards the camera": np.array([0.0, -1.0, 0.0]),
}
"""Directions on the table, as unit vectors (3,) in W."""


@dataclass(frozen=True)
class Turn:
    """Turn of an object about the vertical by `angle` [rad], positive anticlockwise seen from above."""

    angle: float

    def matrix(self) -> Array:
        """Rotation matrix (3, 3) of the turn by `angle` about z (up) of the world frame."""
        return matrix_from_vector(np.array([0.0, 0.0, self.angle]))

    def instruction(self) -> str:
        """Instruction in words for the turn on the table, in whole degrees, starting with a small letter."""
        degrees = round(abs(np.degrees(self.angle)))
        if degrees == 180:
            return "turn it by 180° on the table"
        return f"turn it by {degrees}° {'anticlockwise' if self.angle > 0 else 'clockwise'}, seen from above"


@dataclass(frozen=True)
class Tilt:
    """Tilt of an object by an angle [rad] about a horizontal axis.

    The axis is given by the direction in which the object's top moves: towards or away from the striker or
    the camera (`TOWARDS`).
    """

    towards: str
    """Direction in which the top moves: a key of `TOWARDS`."""
    angle: float
    """Angle [rad], positive."""

    def matrix(self) -> Array:
        """Rotation matrix (3, 3) of the object's tilt about a horizontal axis, in the world frame."""
        return matrix_from_vector(np.cross(np.array([0.0, 0.0, 1.0]), TOWARDS[self.towards]) * self.angle)

    def instruction(self) -> str:
        """Instruction in words to tilt the object: whole degrees, and the direction that its top moves in."""
        degrees = round(np.degrees(self.angle))
        if degrees == 180:
            return f"turn it upside down, moving its top {self.towards}"
        if degrees == 90:
            faces = self.towards.removeprefix("towards ")
            return f"tip it by 90°, moving its top {self.towards}: the former top then faces {faces}"
        return f"tip it by {degrees}°, moving its top {self.towards}"


Move = Turn | Tilt


def placement_moves(R_before: Array, R_now: Array) -> list[Move]:
    """Turns and tilts of an object, in the order of execution, from one placement to the next.

    A turn is about the vertical, a tilt about a horizontal axis of the world frame, each by an angle [rad].
    There are as few turns as possible; of equal numbers, those with the smallest sum of angles are taken. A
    turn or tilt by less than `MIN_ROTATION` is left out.

    Args:
        R_before: (3, 3) rotation from object to world frame on the previous card.
        R_now: (3, 3) rotation from object to world frame on this card.

    Returns:
        At most turn, tilt, turn; the tilt is towards or away from the striker or the camera. Empty if the
        placements are equal to within `MIN_ROTATION`.
    """
    change = R_now @ R_before.T
    rises = change.T @ np.array([0.0, 0.0, 1.0])
    angle = float(np.arccos(np.clip(rises[2], -1, 1)))
    if angle < MIN_ROTATION:
        turn = float(np.arctan2(change[1, 0], change[0, 0]))
        return [Turn(turn)] if abs(turn) > MIN_ROTATION else []
    choices: list[tuple[int, float, int, list[Move]]] = []
    for rank, (towards, direction) in enumerate(TOWARDS.items()):
        tilt = Tilt(towards, angle)
        # The future top must first face opposite to the tilt's direction; for 180 degrees any direction
        # serves.
        first = 0.0 if angle > np.pi - MIN_ROTATION else _between(-rises[:2], direction[:2])
        rest = change @ Turn(first).matrix().T @ tilt.matrix().T
        last = float(np.arctan2(rest[1, 0], rest[0, 0]))
        turns = [each for each in (first, last) if abs(each) > MIN_ROTATION]
        moves: list[Move] = [Turn(first), tilt, Turn(last)]
        steps = [move for move in moves if move is tilt or abs(move.angle) > MIN_ROTATION]
        choices.append((len(turns), round(sum(map(abs, turns)), 6), rank, steps))
    return min(choices, key=lambda choice: choice[:3])[3]


def placement_change(R_before: Array, R_now: Array) -> str:
    """Instruction, in words, for moving the object from one placement on the table to the next.

    It is empty if both placements are equal within `MIN_ROTATION`.

    Args:
        R_before: (3, 3) rotation from object to world frame on the previous card.
        R_now: (3, 3) rotation from object to world frame on this card.
    """
    steps = [move.instruction() for move in placement_moves(R_before, R_now)]
    text = "; then ".join(steps)
    return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class Sides:
    """Names of the object's six sides in its placement on the table.

    A side is named by the tag on it ("tag 3") if there is one, else by an axis of the object frame ("the +x
    side").
    """

    under: str
    """Side on the table."""
    top: str
    """Side on top."""
    camera: str
    """Side that faces the camera."""
    striker: str
    """Side that faces the striker."""
    away: str
    """Side opposite the striker."""
    behind: str
    """Side opposite the camera."""


def side_names(spec: ObjectSpec, R_world_object: Array) -> Sides:
    """Names of the six sides of an object in its placement on the table.

    Args:
        spec: Object file, with the tags.
        R_world_object: (3, 3) rotation from object to world frame.

    Returns:
        Names of the sides on the table, on top, towards and opposite the camera, towards and opposite the
        striker. A name is that of the tag on the side ("tag 3"), else of an axis ("the +x side").
    """

    def side(direction: list[float]) -> str:
        return side_name(spec, R_world_object.T @ np.array(direction))

    return Sides(
        side([0, 0, -1]),
        side([0, 0, 1]),
        side([0, -1, 0]),
        side([-1, 0, 0]),
        side([1, 0, 0]),
        side([0, 1, 0]),
    )


def _between(start: Array, end: Array) -> float:
    """Angle [rad] from vector `start` (2,) to `end` (2,), from -pi to pi, anticlockwise positive."""
    return float(np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end))
