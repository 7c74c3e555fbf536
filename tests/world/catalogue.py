"""Catalogue of world shapes: `names()`, and `make(name, seed)` for one of them.

Seed 0 gives nominal dimensions and mass with z up. Other seeds change each dimension by up to 4 % and the
mass by up to 6 %, and lay the object's frame as different programs do (y up, turned about z, origin aside).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

from tests.world.shapes import RECIPES, Built, MassPart, WorldShape

for _file in sorted((Path(__file__).parent / "families").glob("*.py")):
    import_module(f"tests.world.families.{_file.stem}")


def names() -> list[str]:
    """Names of all shapes, sorted."""
    return sorted(RECIPES)


def make(name: str, seed: int = 0) -> WorldShape:
    """World shape of the given name.

    Args:
        name: one of `names()`.
        seed: seed of dimensions, mass, frame and of what the generator itself draws; 0 for nominal values.
    """
    recipe = RECIPES[name]
    rng = np.random.default_rng([seed, *name.encode()])
    built = recipe.build(rng)
    built = built if isinstance(built, Built) else Built(built)
    parts = built.parts or (MassPart("body", 1.0, built.solid),)
    x0, y0, z0, x1, y1, _ = built.solid.bounding_box()
    shift, scale, mass, turn = (-(x0 + x1) / 2, -(y0 + y1) / 2, -z0), np.ones(3), recipe.mass_kg, np.eye(3)
    offset = np.zeros(3)
    if seed:
        scale = 1 + rng.uniform(-0.04, 0.04, 3)
        mass *= 1 + rng.uniform(-0.06, 0.06)
        angle = rng.uniform(0, 2 * np.pi)
        about_z = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        y_up = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        turn = [np.eye(3), y_up, about_z][seed % 3]
        offset = rng.uniform(-100, 100, 3)

    pose = np.column_stack([turn @ np.diag(scale), turn @ (scale * shift) + offset])
    placed = tuple(
        MassPart(part.name, part.share, part.solid.transform(pose), part.on_surface) for part in parts
    )
    return WorldShape(
        name, recipe.category, built.solid.transform(pose), round(mass, 4), placed, seed, turn[:, 2]
    )
