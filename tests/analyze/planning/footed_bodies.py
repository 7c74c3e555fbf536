"""Bodies whose resting face ends before the widest part: chamfers, feet, ring feet, rims and bevels."""

from __future__ import annotations

import numpy as np

from analyze.planning.hypothesis import Region
from schemas.strike_plan import PlannedStrike
from tests.analyze.planning.random_bodies import convex_triangles

KINDS = ("chamfer", "shallow", "feet", "ring", "rim", "bevel")
_THETA = np.radians(np.arange(0.1, 120, 0.1))


def footed_body(kind: str, seed: int) -> np.ndarray:
    """Triangles (f, 3, 3) [mm] of a random body of a kind."""
    rng = np.random.default_rng((seed, KINDS.index(kind), 77))
    height = rng.uniform(80, 160)
    if kind in ("ring", "rim"):
        radius = rng.uniform(25, 40)
        inset, rise = (rng.uniform(3, 8), rng.uniform(1, 4)) if kind == "ring" else _bevel(rng, 1, 5, 15, 60)
        sides = 48 if kind == "ring" else int(rng.choice([8, 12, 16]))
        profile = [(0.0, radius - inset), (rise, radius), (height - rise, radius), (height, radius - inset)]
        return convex_triangles(
            _rings(sides, [*profile[:2], (height, radius)] if kind == "ring" else profile)
        )
    inset, rise = {
        "chamfer": lambda: _bevel(rng, 2, 8, 12, 45),
        "shallow": lambda: _bevel(rng, 1, 6, 3, 25),
        "feet": lambda: (rng.uniform(3, 12), rng.uniform(1, 4)),
        "bevel": lambda: _bevel(rng, 0.1, 1, 5, 45),
    }[kind]()
    half = rng.uniform([25, 20], [45, 40])
    levels = [(0.0, inset), (rise, 0.0), (height - rise, 0.0), (height, inset)]
    if kind in ("feet", "shallow"):
        levels = [*levels[:2], (height, 0.0)]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return convex_triangles(
        np.vstack([np.column_stack([corners * (half - less), np.full(4, z)]) for z, less in levels])
    )


def _bevel(
    rng: np.random.Generator, low: float, high: float, flat: float, steep: float
) -> tuple[float, float]:
    """Inset and rise [mm] of a bevel of random width, `low` to `high` [mm], and angle to the table.

    The angle is between `flat` and `steep` [deg].
    """
    width, angle = rng.uniform(low, high), np.radians(rng.uniform(flat, steep))
    return float(width * np.cos(angle)), float(width * np.sin(angle))


def _rings(sides: int, profile: list[tuple[float, float]]) -> np.ndarray:
    turn = 2 * np.pi * np.arange(sides) / sides
    return np.vstack(
        [np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(sides, z)]) for z, r in profile]
    )


def drawn_com(region: Region, rng: np.random.Generator) -> np.ndarray:
    """Centre of mass (3,) [m] drawn evenly from a region."""
    while True:
        u = rng.uniform(-1, 1, 3)
        groups = [[i for i in range(3) if region.groups[i] == group] for group in set(region.groups)]
        if all(np.linalg.norm(u[members]) <= 1 for members in groups):
            return region.centre + region.axes.T @ (u * region.half)


def off_at_balance(vertices: np.ndarray, strike: PlannedStrike, com: np.ndarray) -> float:
    """Horizontal distance [m] from the planned pivot to the true contact at balance, of a sharp rigid hull.

    The hull turns over its lowest corner; it balances at the first angle at which the centre of mass is no
    longer behind that corner.
    """
    across = np.array(strike.R_world_object)[[0, 2]]
    seen, c = ((each - np.array(strike.pivot.point)) @ across.T for each in (vertices, com))
    down = np.stack([np.sin(_THETA), -np.cos(_THETA)])
    forward = np.stack([np.cos(_THETA), np.sin(_THETA)])
    ahead = np.einsum("ni,in->n", seen[np.argmax(seen @ down, axis=0)], forward)
    return float(ahead[np.argmax(c @ forward >= ahead)])
