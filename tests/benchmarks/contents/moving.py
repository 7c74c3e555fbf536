"""Paths of what moves inside a container's cavity, in the plane across the pivot edge.

A liquid's centroid moves on a curve as its surface tilts: exactly, for a plane surface in a rectangle. Powder
has the same path, with the friction of its angle of repose. The pendulum of linear sloshing theory has the
first mode's mass and length (acquire/virtual/sloshing.py); the rest of the liquid moves with the container. A
lump slides on the floor from wall to wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquire.virtual.sloshing import first_mode
from tests.benchmarks.contents.planar import NODES

STEEPEST = 1.45
"""greatest slope angle of a surface against the cavity's floor [rad]"""
COLUMNS = 240
BISECTIONS = 40


@dataclass(frozen=True)
class Path:
    """Path of the moving mass in a cavity, with the share of the contents that moves on it."""

    parameter: np.ndarray
    """(NODES,) evenly spaced"""
    places: np.ndarray
    """(NODES, 2) place from the middle of the cavity's floor [m]: horizontal, up"""
    start: float
    """parameter at rest"""
    share: float = 1.0
    """share of the contents' mass on the path; the rest stays at `still`"""
    still: tuple[float, float] = (0.0, 0.0)
    """place of the rest [m]"""


def level_path(width: float, height: float, filled: float) -> Path:
    """Path of the centroid of a liquid with a plane surface that fills a share of a rectangular cavity.

    Args:
        width: width of the cavity [m].
        height: its height [m].
        filled: share of the cavity that is filled.
    """
    slope = np.tan(np.linspace(-STEEPEST, STEEPEST, NODES))[:, None]
    x = width * ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5)
    reach = 0.5 * width * np.abs(slope[:, 0])
    low, high = -reach, height + reach
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        depth = np.clip(middle[:, None] + slope * x, 0, height)
        full = depth.mean(axis=1) > filled * height
        low, high = np.where(full, low, middle), np.where(full, middle, high)
    depth = np.clip(0.5 * (low + high)[:, None] + slope * x, 0, height)
    area = depth.sum(axis=1)
    places = np.stack([(depth @ x) / area, 0.5 * np.sum(depth**2, axis=1) / area], axis=-1)
    return Path(np.linspace(-STEEPEST, STEEPEST, NODES), places, 0.0)


def pendulum_path(width: float, depth: float) -> Path:
    """Path of the pendulum of the first sloshing mode of a liquid of this depth in a rectangular tank."""
    mode = first_mode(width, depth)
    length, share, at = mode.length, mode.share, mode.height
    angle = np.linspace(-STEEPEST, STEEPEST, NODES)
    places = np.stack([length * np.sin(angle), at + length * (1 - np.cos(angle))], axis=-1)
    still = (0.5 * depth - share * at) / (1 - share)
    return Path(angle, places, 0.0, share, (0.0, float(still)))


def floor_path(width: float, size: float, start: float) -> Path:
    """Path of a lump of this size [m] on the floor, from wall to wall.

    Args:
        width: width of the cavity [m].
        size: width and height of the lump [m].
        start: place at rest, as a share of the way from the wall behind to the wall ahead.
    """
    room = 0.5 * (width - size)
    x = np.linspace(-room, room, NODES)
    return Path(x, np.stack([x, np.full(NODES, 0.5 * size)], axis=-1), float(room * (2 * start - 1)))
