"""Truth file (TOML) of the virtual rig: hidden masses, friction, edge radius of a user's object."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from acquire.errors import ConfigError
from acquire.virtual.given_contents import GivenContents
from schemas.document import Document, DocumentError, Vector3, read_text, validate


class TruthLump(Document):
    """Ball of mass inside a virtual object."""

    by_hand: ClassVar[bool] = True

    centre_m: Vector3 = Field(description="centre in O, the object's frame, in metres")
    radius_m: float = Field(gt=0, description="radius, in metres; what lies outside the object is cut off")
    mass_kg: float = Field(gt=0, description="mass, in kilograms")


class GivenTruth(Document):
    """Hidden properties of a virtual object; most that are left out are drawn from the seed.

    A shell thickness or edge radius that is left out is taken from the object file if stated there. If any
    mass is given, those left out are 0, and the rest of the object's mass is spread uniformly over the
    interior.
    """

    by_hand: ClassVar[bool] = True

    shell_kg: float | None = Field(default=None, ge=0, description="mass of the shell, in kilograms")
    shell_thickness_m: float | None = Field(
        default=None, gt=0, le=0.1, description="thickness of the shell, in metres"
    )
    upper_kg: float | None = Field(
        default=None, ge=0, description="mass of the interior on the side of plane_normal, in kilograms"
    )
    lower_kg: float | None = Field(
        default=None, ge=0, description="mass of the interior on the other side, in kilograms"
    )
    plane_normal: Vector3 | None = Field(
        default=None, description="normal of the plane that divides the interior, of any length"
    )
    plane_offset_m: float | None = Field(
        default=None, description="offset of that plane along its normal from O's origin, in metres"
    )
    lump: list[TruthLump] = Field(default=[], description="balls of mass inside")
    contents: GivenContents | None = Field(
        default=None, description="table [truth.contents]: what moves inside; left out: nothing"
    )
    edge_radius_m: float | None = Field(
        default=None, ge=0, le=0.1, description="radius of the rounding of all edges, in metres"
    )
    friction: float | None = Field(
        default=None, gt=0, le=2, description="coefficient of friction between object and table"
    )

    @property
    def gives_masses(self) -> bool:
        """True if a mass of shell, interior or lump is given."""
        return bool(self.lump) or any(
            mass is not None for mass in (self.shell_kg, self.upper_kg, self.lower_kg)
        )


class _TruthFile(Document):
    """Content of a truth file: its one table."""

    by_hand: ClassVar[bool] = True

    truth: GivenTruth = Field(description="table [truth]: hidden masses, friction, edge radius")


def read_given_truth(path: Path | None) -> GivenTruth:
    """Read and validate a truth file (TOML); without a file (None) no property is given.

    Raises:
        ConfigError: the file is missing, is not TOML, or holds an entry that cannot be used.
    """
    if path is None:
        return GivenTruth()
    try:
        return validate(_TruthFile, tomllib.loads(read_text(path)), str(path)).truth
    except DocumentError as error:
        raise ConfigError(str(error)) from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
