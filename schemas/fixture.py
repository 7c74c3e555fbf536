"""Fixture that holds an object while it is struck, as the object file states it: bodies of known mass."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field, field_validator, model_validator

from schemas.document import Document, Matrix3, Vector3

FIXTURE_KEYS = ("fixture", "held")
"""Keys of the object file on its fixture: the object's hash includes them only if they are given."""
MAX_TURN_SD = 1.0
"""Largest 1 sigma of an object's rotation in its fixture [rad]."""


class FixtureBody(Document):
    """Body of known mass that is struck together with the object and subtracted from the answer.

    Examples are a printed base, a box, a strap, or putty. Where `com_m` or `unit_inertia_m2` is left out, it
    is that of a uniform solid of the `bodies`.
    """

    by_hand: ClassVar[bool] = True

    name: str = Field(min_length=1, description="name of the body, for example base, strap")
    bodies: list[int] = Field(
        default=[],
        description="numbers of its closed bodies in the shape file, from 1: `analyze parts` lists them; "
        "empty for a body that is not in the file, such as a strap",
    )
    mass_kg: float = Field(gt=0, description="its mass, in kilograms, as weighed alone with its tags")
    mass_sd_kg: float = Field(gt=0, description="1 sigma of mass_kg, in kilograms")
    com_m: Vector3 | None = Field(default=None, description="its centre of mass in O, in metres")
    com_sd_m: float = Field(
        default=0.001, gt=0, le=0.1, description="1 sigma of com_m in every direction, in metres"
    )
    unit_inertia_m2: Matrix3 | None = Field(
        default=None,
        description="its inertia per kilogram about its centre of mass, along the axes of O, in m^2",
    )
    unit_inertia_sd: float = Field(
        default=0.1, gt=0, lt=1, description="relative 1 sigma of the moments in unit_inertia_m2"
    )

    @model_validator(mode="after")
    def _consistent(self) -> FixtureBody:
        if self.mass_sd_kg >= self.mass_kg:
            raise ValueError(f"{self.name!r}: mass_sd_kg must be below mass_kg: it is the scale's 1 sigma")
        if not self.bodies and (self.com_m is None or self.unit_inertia_m2 is None):
            raise ValueError(
                f"{self.name!r}: give its bodies in the shape file, or com_m and unit_inertia_m2 of a body "
                "that is not in it"
            )
        inertia = self.unit_inertia_m2
        if inertia is not None:
            if any(inertia[i][j] != inertia[j][i] for i in range(3) for j in range(i)):
                raise ValueError(f"{self.name!r}: unit_inertia_m2 is not symmetric: give six numbers, twice")
            if min(inertia[i][i] for i in range(3)) <= 0:
                raise ValueError(f"{self.name!r}: the moments in unit_inertia_m2 must be above 0")
        return self


class HeldObject(Document):
    """Errors of the object's place and rotation in its fixture, against those in the object file's shape."""

    by_hand: ClassVar[bool] = True

    place_sd_m: float = Field(
        gt=0, le=0.1, description="1 sigma of the object's place in the fixture in every direction, in metres"
    )
    turn_sd_rad: float | Vector3 = Field(
        description="1 sigma of its rotation in the fixture, about any axis or about O's x, y, z, in radians"
    )
    about_m: Vector3 | None = Field(
        default=None,
        description="point in O about which it may be turned; if left out, the middle of its volume",
    )

    @field_validator("turn_sd_rad")
    @classmethod
    def _small(cls, value: float | list[float]) -> float | list[float]:
        each = value if isinstance(value, list) else [value]
        if min(each) <= 0 or max(each) > MAX_TURN_SD:
            raise ValueError(f"every turn must be above 0 and at most {MAX_TURN_SD:g}: it is in radians")
        return value


def check_fixture(fixture: list[FixtureBody] | None, held: HeldObject | None, mass_kg: float) -> None:
    """Raise ValueError for a fixture that cannot be subtracted from an object.

    Args:
        fixture: bodies of the fixture; None if the object stands by itself.
        held: how the object sits in it; None if not given.
        mass_kg: mass of object and fixture together, in kilograms.
    """
    if fixture is None and held is None:
        return
    if fixture is None or held is None:
        missing = "[[fixture]]" if fixture is None else "[held]"
        raise ValueError(f"{missing} is missing: a fixture needs both [[fixture]] and [held]")
    names = [body.name for body in fixture]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"fixture {twice[0]!r} is listed twice: give each body a name of its own")
    numbers = [number for body in fixture for number in body.bodies]
    if not numbers:
        raise ValueError(
            "no [[fixture]] names its bodies in the shape file: the file holds object and fixture as separate"
            " bodies"
        )
    if twice := [number for number in numbers if numbers.count(number) > 1]:
        raise ValueError(f"body {twice[0]} of the shape file is listed in two fixtures")
    total = sum(body.mass_kg for body in fixture)
    if total >= mass_kg:
        raise ValueError(
            f"the fixture weighs {total:g} kg, object and fixture together {mass_kg:g} kg: mass_kg is that of"
            " both, weighed together"
        )
