"""A labelled part of an object, as the user writes it in the object file."""

from __future__ import annotations

from pydantic import Field, model_validator

from schemas.document import Document, Vector3

MIN_DENSITY_KG_M3, MAX_DENSITY_KG_M3 = 5.0, 25_000.0
"""Range of densities that a filling can have: from foam to above any metal."""
LABEL_KEYS_AFTER_1_0 = ("fills", "density_kg_m3", "density_sd_kg_m3")
"""Keys of a label added after version 1.0: the object's hash includes them only if they are given."""


class PartLabel(Document):
    """A part of the object, of uniform density, whose mass is estimated.

    A part is one of four kinds, given by exactly one entry: `bodies` (closed surfaces of the mesh), `wall`
    (everything near the surface), `between_m` (a layer inside the wall) or `fills` (a filling up to an
    unknown level).
    """

    name: str = Field(min_length=1, description="name of the part")
    bodies: list[int] = Field(
        default=[], description="numbers of the mesh's closed bodies, from 1: `analyze parts` lists them"
    )
    wall: bool = Field(default=False, description="true: everything within shell_thickness_m of the surface")
    between_m: list[float] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="lower and upper end of a layer inside the wall, along `along`, in metres",
    )
    fills: bool = Field(
        default=False,
        description="true: fills the inside of the wall from below, up to a level along `along` that is "
        "estimated too",
    )
    along: Vector3 = Field(
        default=[0.0, 0.0, 1.0],
        description="direction in O along which `between_m` is measured from O, or along which the filling "
        "rises",
    )
    density_kg_m3: float | None = Field(default=None, gt=0, description="density of the filling, if known")
    density_sd_kg_m3: float | None = Field(
        default=None, gt=0, description="1 sigma of density_kg_m3; 5 % if left out"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> PartLabel:
        given = [name for name in ("bodies", "wall", "between_m", "fills") if getattr(self, name)]
        if len(given) != 1:
            raise ValueError(
                f"part {self.name!r}: give exactly one of bodies, wall, between_m, fills (found "
                f"{', '.join(given) or 'none'})"
            )
        if not self.fills and (self.density_kg_m3 is not None or self.density_sd_kg_m3 is not None):
            raise ValueError(
                f"part {self.name!r}: density_kg_m3 belongs to a filling with an unknown level (fills = true)"
            )
        if self.density_sd_kg_m3 is not None and self.density_kg_m3 is None:
            raise ValueError(f"part {self.name!r}: density_sd_kg_m3 needs density_kg_m3")
        if self.density_kg_m3 is not None and not MIN_DENSITY_KG_M3 < self.density_kg_m3 < MAX_DENSITY_KG_M3:
            raise ValueError(
                f"part {self.name!r}: {self.density_kg_m3:g} kg/m^3 is not the density of a filling: water "
                "has 1000 kg/m^3"
            )
        if min(self.bodies, default=1) < 1 or len(set(self.bodies)) < len(self.bodies):
            raise ValueError(f"part {self.name!r}: bodies are numbers from 1, each once")
        if self.between_m is not None and self.between_m[0] >= self.between_m[1]:
            raise ValueError(f"part {self.name!r}: between_m is the lower end, then the upper one")
        if not any(self.along):
            raise ValueError(f"part {self.name!r}: along needs a direction that is not 0")
        return self


def check_labels(labels: list[PartLabel]) -> None:
    """Check the labelled parts of an object: unique names and bodies, and kinds that go together.

    Raises:
        ValueError: a name or body is used twice, bodies of the mesh are mixed with wall and layers, two parts
            are the wall, or a filling is not one of exactly two parts with the wall as the other.
    """
    names = [label.name for label in labels]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"two parts are called {twice[0]!r}: every part needs a name of its own")
    numbers = [number for label in labels for number in label.bodies]
    if shared := [number for number in numbers if numbers.count(number) > 1]:
        raise ValueError(f"body {shared[0]} is in two parts: a body belongs to one")
    if any(label.bodies for label in labels) and not all(label.bodies for label in labels):
        raise ValueError("parts are either bodies of the mesh, or wall and layers: not both")
    if sum(label.wall for label in labels) > 1:
        raise ValueError("two parts are the wall: mark only one with wall = true")
    if any(label.fills for label in labels) and (len(labels) != 2 or not any(label.wall for label in labels)):
        raise ValueError("a filling (fills = true) needs the wall as the only other part: label these two")
