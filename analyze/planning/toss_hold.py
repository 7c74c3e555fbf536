"""How to hold an object for a toss: its turn in the hand, so that the camera can follow it at every moment.

Frames: W (world, z up; the camera looks along +y) and O (object).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.rotations import matrix_from_vector
from analyze.planning.followed_squares import FollowedSquare
from analyze.types import Array

SPIN_WORLD = np.array([1.0, 0.0, 0.0])
"""direction of the spin in W: level and across the camera's view, as two hands of a person facing the camera
spin an object; its top moves towards the camera"""
STEEPEST_RAD = np.radians(65.0)
"""largest angle between a tag's normal and the line to the camera at which it is read"""
PHASES = 72
"""number of turns about the spin axis that are tried, and at which the tags in view are counted"""


@dataclass(frozen=True)
class Hold:
    """Turn of the object when it leaves the hands, and the tags that the camera sees from there on."""

    axis: Array
    """(3,) spin axis in O, unit vector"""
    R_world_object: Array
    """(3, 3) rotation from O to W"""
    seen: float
    """fraction of a turn in which the camera sees a tag"""
    facing: str
    """name of the tag or side that faces the camera most at the release"""


def best_hold(squares: Sequence[FollowedSquare], axis: Array) -> Hold:
    """Turn of an object with its spin axis along `SPIN_WORLD`, with a tag facing the camera.

    Args:
        squares: tags or printed sides of the object, at least one.
        axis: (3,) spin axis in O, unit vector.
    """
    normals = np.array([square.T_object_square[:3, 2] for square in squares])
    level = _turned_to(axis, SPIN_WORLD)
    turns = 2 * np.pi * np.arange(PHASES) / PHASES
    rotations = np.array([matrix_from_vector(turn * SPIN_WORLD) @ level for turn in turns])
    towards = -(rotations @ normals.T)[:, 1]
    phase, tag = np.unravel_index(int(np.argmax(np.round(towards, 6))), towards.shape)
    seen = float((towards.max(axis=1) >= np.cos(STEEPEST_RAD)).mean())
    return Hold(axis, rotations[int(phase)], seen, squares[int(tag)].name)


def _turned_to(direction: Array, target: Array) -> Array:
    """Smallest rotation (3, 3) that turns a unit vector (3,) to another one."""
    across = np.cross(direction, target)
    sine, cosine = float(np.linalg.norm(across)), float(direction @ target)
    if sine < 1e-9:
        other = np.cross(target, np.eye(3)[int(np.argmin(np.abs(target)))])
        half_turn = np.asarray(np.pi * other / np.linalg.norm(other), dtype=float)
        return np.eye(3) if cosine > 0 else matrix_from_vector(half_turn)
    return matrix_from_vector(across / sine * np.arctan2(sine, cosine))
