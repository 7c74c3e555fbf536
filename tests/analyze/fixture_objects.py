"""Household and workshop objects, made of solids of several materials, for which fixtures are designed.

Lengths are in millimetres. Each part has a density of its own, so that no object is uniform.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import manifold3d
import numpy as np

from analyze.geometry import polyhedron
from analyze.geometry.held_object import point_inertia
from analyze.types import Array, IntArray
from tests.analyze.geometry.shapes import stl

Solid = manifold3d.Manifold
STEEL, WOOD, PLASTIC, RUBBER, CERAMIC, FOAM = 7800.0, 700.0, 1100.0, 1150.0, 2300.0, 250.0


@dataclass(frozen=True)
class MadeObject:
    """Object made of parts: surface [mm] of all together, and true mass properties in SI units."""

    name: str
    vertices: Array
    faces: IntArray
    mass: float
    com: Array
    inertia: Array

    @property
    def stl(self) -> bytes:
        return stl(self.vertices[self.faces])


def _box(x: float, y: float, z: float, at: tuple[float, float, float] = (0, 0, 0)) -> Solid:
    return Solid.cube((x, y, z), True).translate(at)


def _rod(
    radius: float, length: float, at: tuple[float, float, float], along: str, other: float = -1
) -> Solid:
    rod = Solid.cylinder(length, radius, other, 48, True)
    turned = {"x": (0, 90, 0), "y": (90, 0, 0), "z": (0, 0, 0)}[along]
    return rod.rotate(turned).translate(at)


def _ball(radius: float, scale: tuple[float, float, float] = (1, 1, 1)) -> Solid:
    return Solid.sphere(radius, 48).scale(scale)


def _hammer() -> list[tuple[Solid, float]]:
    head = _rod(14, 60, (10, 0, 0), "x") + _box(45, 12, 22, (-35, 0, 0))
    handle = _rod(12, 260, (0, 0, -125), "z", 15).scale((1, 0.8, 1))
    return [(head, STEEL), (handle - head, WOOD)]


def _pliers() -> list[tuple[Solid, float]]:
    jaws = Solid.hull_points(
        [
            [0, -14, -5],
            [0, 14, -5],
            [70, -5, -4],
            [70, 5, -4],
            [0, -14, 5],
            [0, 14, 5],
            [70, -5, 4],
            [70, 5, 4],
        ]
    )
    pivot = _rod(15, 12, (0, 0, 0), "z")
    arms = [
        _box(120, 11, 12).translate((-65, 0, 0)).rotate((0, 0, turn)).translate((0, side, 0))
        for turn, side in ((10, -4), (-10, 4))
    ]
    steel = jaws + pivot
    return [(steel, STEEL), (arms[0] + arms[1] - steel, 1800.0)]


def _mug() -> list[tuple[Solid, float]]:
    cup = _rod(41, 95, (0, 0, 0), "z") - _rod(37, 95, (0, 0, 5), "z")
    ring = (
        manifold3d.CrossSection.circle(5, 24)
        .translate((24, 0))
        .revolve(48)
        .rotate((90, 0, 0))
        .translate((46, 0, 0))
    )
    return [(cup + (ring - _rod(38, 120, (0, 0, 0), "z")), CERAMIC)]


def _scissors() -> list[tuple[Solid, float]]:
    blades = Solid.hull_points(
        [[0, -9, -2], [0, 9, -2], [95, -2, -1], [95, 2, -1], [0, -9, 2], [0, 9, 2], [95, -2, 1], [95, 2, 1]]
    )
    rings = [
        (_rod(24, 9, (-55, side, 0), "z").scale((1, 1, 1)) - _rod(16, 20, (-55, side, 0), "z"))
        + _box(45, 9, 8).rotate((0, 0, -side * 0.9)).translate((-18, side * 0.45, 0))
        for side in (-22, 22)
    ]
    handles = rings[0] + rings[1]
    return [(blades, STEEL), (handles - blades, PLASTIC)]


def _shoe() -> list[tuple[Solid, float]]:
    sole = Solid.batch_hull([_rod(44, 14, (80, 4, 0), "z"), _rod(32, 14, (-95, 0, 0), "z")])
    upper = Solid.batch_hull(
        [
            _rod(38, 4, (80, 4, 9), "z"),
            _rod(30, 4, (-95, 0, 9), "z"),
            _rod(26, 4, (-95, 0, 85), "z"),
            _rod(24, 4, (0, 2, 70), "z"),
            _rod(24, 4, (90, 4, 35), "z"),
        ]
    )
    hollow = Solid.batch_hull(
        [
            _rod(26, 4, (-90, 0, 16), "z"),
            _rod(22, 4, (-90, 0, 120), "z"),
            _rod(20, 4, (-5, 2, 110), "z"),
            _rod(28, 4, (60, 4, 16), "z"),
        ]
    )
    return [(sole, RUBBER), (upper - hollow - sole, FOAM)]


def _spoon() -> list[tuple[Solid, float]]:
    bowl = (_ball(22, (1.4, 1, 0.55)) - _ball(20, (1.4, 1, 0.55)).translate((0, 0, 2.5))).trim_by_plane(
        (0, 0, -1), -2
    )
    handle = Solid.batch_hull([_rod(5, 3, (28, 0, 0), "z"), _rod(9, 3, (140, 0, 12), "z")])
    return [(bowl + handle, STEEL)]


def _ball_object() -> list[tuple[Solid, float]]:
    core = _ball(14).translate((9, 4, 2))
    return [(core, 2500.0), (_ball(34) - core, 600.0)]


def _screwdriver() -> list[tuple[Solid, float]]:
    blade = _rod(3.5, 110, (95, 0, 0), "x")
    grip = Solid.batch_hull([_rod(15, 60, (-20, 0, 0), "x"), _rod(9, 6, (40, 0, 0), "x")])
    return [(blade, STEEL), (grip - blade, PLASTIC)]


def _wrench() -> list[tuple[Solid, float]]:
    bar = _box(140, 18, 7)
    heads = _rod(20, 9, (-75, 0, 0), "z") + (_rod(19, 9, (75, 0, 0), "z") - _rod(10, 20, (75, 0, 0), "z"))
    return [(bar + heads - _box(24, 15, 20, (-86, 0, 0)), STEEL)]


def _duck() -> list[tuple[Solid, float]]:
    body = _ball(35, (1.25, 0.95, 0.85))
    head = _ball(21).translate((32, 0, 38))
    beak = _ball(10, (1.3, 1, 0.5)).translate((56, 0, 36))
    weight = _ball(9).translate((-12, 0, -14))
    return [(weight, STEEL), (body + head + beak - weight, 350.0)]


def _plate() -> list[tuple[Solid, float]]:
    dish = _rod(70, 18, (0, 0, 0), "z", 125) - _rod(66, 18, (0, 0, 5), "z", 120)
    return [(dish, CERAMIC)]


def _board() -> list[tuple[Solid, float]]:
    board = _box(320, 220, 16) - _rod(12, 30, (0, 90, 0), "z")
    edge = _box(320, 20, 16, (0, -100, 0))
    return [(edge, 1200.0), (board - edge, WOOD)]


def _post() -> list[tuple[Solid, float]]:
    foot = _box(30, 20, 30, (0, 0, -30))
    return [(foot, 2000.0), (_box(30, 20, 90) - foot, 500.0)]


SIMPLE: dict[str, Callable[[], list[tuple[Solid, float]]]] = {"post": _post}
"""Objects of a dozen triangles, for quick tests."""
OBJECTS: dict[str, Callable[[], list[tuple[Solid, float]]]] = {
    "hammer": _hammer,
    "pliers": _pliers,
    "mug": _mug,
    "scissors": _scissors,
    "shoe": _shoe,
    "spoon": _spoon,
    "ball": _ball_object,
    "screwdriver": _screwdriver,
    "wrench": _wrench,
    "duck": _duck,
    "plate": _plate,
    "board": _board,
}
"""Parts with their densities [kg/m^3] by the object's name; frames are far from any fixture's."""


@lru_cache(maxsize=16)
def made(name: str, seed: int = 0) -> MadeObject:
    """Object turned and moved at random by `seed`; 0 leaves it in the frame that it was made in."""
    parts = {**OBJECTS, **SIMPLE}[name]()
    if seed:
        rng = np.random.default_rng(seed)
        turn, shift = rng.uniform(-180, 180, 3).tolist(), rng.uniform(-50, 50, 3).tolist()
        parts = [(solid.rotate(turn).translate(shift), density) for solid, density in parts]
    total, first = 0.0, np.zeros(3)
    found = []
    for solid, density in parts:
        mesh = solid.to_mesh64()
        vertices = np.asarray(mesh.vert_properties)[:, :3] / 1000
        solid_properties = polyhedron.mass_properties(vertices, np.asarray(mesh.tri_verts).astype(np.int64))
        mass = density * solid_properties.volume
        found.append((mass, solid_properties))
        total, first = total + mass, first + mass * solid_properties.centroid
    com = first / total
    inertia = np.sum(
        [mass * (each.unit_inertia + point_inertia(each.centroid - com)) for mass, each in found], axis=0
    )
    whole = manifold3d.Manifold.batch_boolean(
        [solid for solid, _ in parts], manifold3d.OpType.Add
    ).to_mesh64()
    return MadeObject(
        name,
        np.asarray(whole.vert_properties)[:, :3].copy(),
        np.asarray(whole.tri_verts).astype(np.int64),
        total,
        com,
        inertia,
    )


def write_object_file(folder: Path, thing: MadeObject, **more: float) -> Path:
    """Write an object's mesh (STL, in mm) and its object file, with one tag without place.

    Args:
        folder: where to write `NAME.stl` and `NAME.toml`.
        thing: the object.
        more: further entries of the object file, by key.

    Returns:
        Path of the object file.
    """
    (folder / f"{thing.name}.stl").write_bytes(thing.stl)
    path = folder / f"{thing.name}.toml"
    rows = "".join(f"{name} = {value}\n" for name, value in more.items())
    path.write_text(
        f'name = "{thing.name}"\nmass_kg = {thing.mass:.6f}\nmass_sd_kg = 0.0001\n{rows}'
        f'[shape]\nfile = "{thing.name}.stl"\nunit = "mm"\n[[marker]]\nid = 0\nsize_m = 0.03\n'
    )
    return path
