"""Object that is struck in a fixture: its mass and place there, and the fixture's bodies of known mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry.bodies import Body, bodies_of
from analyze.geometry.polyhedron import merged_solid
from analyze.types import Array, IntArray
from schemas.object_spec import FixtureBody, ObjectSpec


@dataclass(frozen=True)
class KnownBody:
    """Body of a fixture with known mass, centre of mass and inertia, in the object frame O.

    Standard deviations of its centre hold in every direction, those of its moments are relative.
    """

    name: str
    """Name in the object file."""
    mass: float
    """Mass [kg]."""
    mass_sd: float
    """1 sigma of the mass [kg]."""
    com: Array
    """(3,) centre of mass [m], in O."""
    com_sd: float
    """1 sigma of the centre of mass in every direction [m]."""
    unit_inertia: Array
    """(3, 3) inertia about its centre of mass per kilogram [m^2], along the axes of O."""
    unit_inertia_sd: float
    """Relative 1 sigma of its moments."""


@dataclass(frozen=True)
class HeldObject:
    """Object in a fixture: its mass without it, the fixture's bodies, and errors of its place."""

    fixture: tuple[KnownBody, ...]
    """Bodies of the fixture."""
    mass: float
    """Mass of the object alone [kg]."""
    place_sd: float
    """1 sigma of the object's place in the fixture in every direction [m]."""
    turn_sd: Array
    """(3,) 1 sigma of the object's rotation in the fixture about the axes of O [rad]."""
    about: Array
    """(3,) point about which it may be turned [m], in O."""

    @property
    def fixture_mass(self) -> float:
        """Mass of the fixture [kg]."""
        return sum(body.mass for body in self.fixture)

    def com_struck(self, com: Array) -> Array:
        """Centre of mass (3,) [m] of object and fixture in O, from that of the object alone, `com` (3,)."""
        first = self.mass * com + sum(body.mass * body.com for body in self.fixture)
        return np.asarray(first / (self.mass + self.fixture_mass), dtype=np.float64)

    def com_alone(self, com: Array) -> Array:
        """Centre of mass (3,) [m] of the object alone in O, from that of object and fixture, `com` (3,)."""
        first = (self.mass + self.fixture_mass) * com - sum(body.mass * body.com for body in self.fixture)
        return np.asarray(first / self.mass, dtype=np.float64)

    def unit_inertia_struck(self, com: Array, unit_inertia: Array) -> Array:
        """Inertia (3, 3) of object and fixture about their centre of mass, per kilogram [m^2].

        Args:
            com: (3,) centre of mass of the object alone [m], in O.
            unit_inertia: (3, 3) inertia of the object alone about `com`, per kilogram [m^2].
        """
        middle = self.com_struck(com)
        total = self.mass * (unit_inertia + point_inertia(com - middle))
        for body in self.fixture:
            total = total + body.mass * (body.unit_inertia + point_inertia(body.com - middle))
        return np.asarray(total / (self.mass + self.fixture_mass), dtype=np.float64)


def point_inertia(place: Array) -> Array:
    """Inertia per kilogram (3, 3) [m^2] about the origin of a point mass at `place` (3,) [m]."""
    return float(place @ place) * np.eye(3) - np.outer(place, place)


def held_object(centroid: Array, fixture: tuple[KnownBody, ...], spec: ObjectSpec) -> HeldObject:
    """Object in its fixture, as the object file states it.

    Args:
        centroid: (3,) centroid of the object without its fixture [m], in the object frame O: point about
            which it may be turned if the object file states none.
        fixture: Bodies of the fixture.
        spec: Object file, with the mass of both together and the errors of the object's place.

    Raises:
        ShapeError: the object file does not state these errors.
    """
    if spec.held is None:
        raise ShapeError(
            f"{spec.name}: [held] is missing: state place_sd_m and turn_sd_rad, the "
            "errors of the object's place and rotation in its fixture"
        )
    about = centroid if spec.held.about_m is None else np.array(spec.held.about_m)
    mass = spec.mass_kg - sum(body.mass for body in fixture)
    turn_sd = np.broadcast_to(np.array(spec.held.turn_sd_rad, dtype=np.float64), 3)
    return HeldObject(fixture, mass, spec.held.place_sd_m, turn_sd, about)


def separate_bodies(
    spec: ObjectSpec, shape_bytes: bytes | None, shape_name: str
) -> tuple[Array, IntArray, tuple[KnownBody, ...]]:
    """Mesh of the object without its fixture, and the fixture's bodies, from their common shape file.

    Args:
        spec: Object file with `fixture`.
        shape_bytes: Content of the shape file.
        shape_name: Name of the shape file, for messages.

    Returns:
        Vertices (n, 3) [m] and faces (f, 3) of the object's own bodies, in the object frame O, and the
        fixture's bodies.

    Raises:
        ShapeError: the shape is no mesh, the fixture names a body that it does not have or that is open, or
            no body is left for the object.
    """
    bodies = bodies_of(spec, shape_bytes, shape_name)
    named = {number for body in spec.fixture or [] for number in body.bodies}
    if beyond := sorted(number for number in named if number < 1 or number > len(bodies)):
        raise ShapeError(
            f"{shape_name}: has {len(bodies)} bodies, the object file's fixture names number {beyond[0]}: "
            "correct it, `analyze parts` lists the bodies"
        )
    if torn := sorted(number for number in named if bodies[number - 1].open_edges):
        raise ShapeError(
            f"{shape_name}: body {torn[0]} of the fixture is not closed: export it as one closed solid"
        )
    own = [body for number, body in enumerate(bodies, 1) if number not in named]
    if not own:
        raise ShapeError(f"{shape_name}: all its bodies belong to the fixture: add the object's own mesh")
    vertices, faces = _merged(own)
    return vertices, faces, tuple(_known(body, bodies) for body in spec.fixture or [])


def _merged(bodies: Sequence[Body]) -> tuple[Array, IntArray]:
    """Vertices (n, 3) [m] and faces (f, 3) of several bodies as one mesh, without unused vertices."""
    vertices: list[Array] = []
    faces: list[IntArray] = []
    count = 0
    for body in bodies:
        used, local = np.unique(body.faces, return_inverse=True)
        vertices.append(body.vertices[used])
        faces.append(local.reshape(-1, 3).astype(np.int64) + count)
        count += len(used)
    return np.concatenate(vertices), np.concatenate(faces)


def _known(stated: FixtureBody, bodies: Sequence[Body]) -> KnownBody:
    """Body of a fixture with the stated mass properties, or those of a uniform solid where none are stated.

    Args:
        stated: Entry of the object file.
        bodies: All bodies of the shape file, in the order of their numbers.
    """
    com, unit_inertia = stated.com_m, stated.unit_inertia_m2
    if com is None or unit_inertia is None:
        solid = merged_solid([bodies[number - 1].properties for number in stated.bodies])
        com = solid.centroid.tolist() if com is None else com
        unit_inertia = solid.unit_inertia.tolist() if unit_inertia is None else unit_inertia
    return KnownBody(
        stated.name,
        stated.mass_kg,
        stated.mass_sd_kg,
        np.array(com),
        stated.com_sd_m,
        np.array(unit_inertia),
        stated.unit_inertia_sd,
    )
