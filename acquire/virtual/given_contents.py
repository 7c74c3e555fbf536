"""Contents of a virtual object as a user states them: kind, share of the mass, and how they move."""

from __future__ import annotations

import enum
import math
from typing import ClassVar

from pydantic import Field

from acquire.errors import ConfigError
from schemas.document import Document, DocumentError, validate


class ContentsKind(enum.Enum):
    """What moves inside an object; the value is its name in options and files."""

    LIQUID = "liquid"
    POWDER = "powder"
    LUMP = "lump"


class GivenContents(Document):
    """Contents that move in a virtual object."""

    by_hand: ClassVar[bool] = True

    kind: ContentsKind = Field(description="liquid, powder or lump")
    share: float = Field(ge=0.01, le=0.8, description="mass of the contents over that of the whole object")
    filled: float | None = Field(
        default=None,
        gt=0,
        le=0.95,
        description="share of the cavity that liquid or powder fills; left out: by a density of 1000 kg/m3, "
        "or 700 kg/m3 for powder",
    )
    friction: float | None = Field(
        default=None, ge=0, le=2, description="coefficient of friction of a lump on the walls; usually 0.2"
    )
    repose_deg: float | None = Field(
        default=None, gt=0, le=60, description="angle of repose of powder, in degrees; usually 30"
    )
    damping_per_s: float | None = Field(
        default=None, ge=0, le=50, description="damping of a liquid's motion, in 1/s; usually 1"
    )
    size_m: float | None = Field(
        default=None,
        gt=0,
        le=0.5,
        description="diameter of a lump, in metres; usually 0.03, or 0.4 of the cavity's smallest size",
    )

    @property
    def lump_friction(self) -> float:
        """Coefficient of friction of a lump on the walls."""
        return 0.2 if self.friction is None else self.friction

    @property
    def surface_friction(self) -> float:
        """Coefficient of friction of what has a surface: that of powder's angle of repose, 0 for a liquid."""
        if self.kind is ContentsKind.LIQUID:
            return 0.0
        return math.tan(math.radians(30.0 if self.repose_deg is None else self.repose_deg))

    @property
    def liquid_damping_per_s(self) -> float:
        """Viscous damping of a liquid's motion over its mass [1/s]; 0 for other contents."""
        if self.kind is not ContentsKind.LIQUID:
            return 0.0
        return 1.0 if self.damping_per_s is None else self.damping_per_s


_THIRD = {ContentsKind.LIQUID: "filled", ContentsKind.POWDER: "repose_deg", ContentsKind.LUMP: "friction"}
"""entry that the third value of `KIND:SHARE:VALUE` is"""
FORM = "KIND:SHARE or KIND:SHARE:VALUE, such as liquid:0.2:0.5, powder:0.2 or lump:0.1:0.2"


def parse_contents(text: str) -> GivenContents:
    """Contents by the text of an option, `KIND:SHARE` or `KIND:SHARE:VALUE`.

    The value is the filled share for a liquid, the angle of repose [deg] for powder, the coefficient of
    friction for a lump.

    Raises:
        ConfigError: the text has another form, or a value is out of range.
    """
    kind, *values = text.split(":")
    names = [each.value for each in ContentsKind]
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        numbers = []
    if kind not in names or len(numbers) not in {1, 2}:
        raise ConfigError(f"contents {text!r}: give {FORM}")
    entries: dict[str, object] = {"kind": ContentsKind(kind), "share": numbers[0]}
    if len(numbers) == 2:
        entries[_THIRD[ContentsKind(kind)]] = numbers[1]
    try:
        return validate(GivenContents, entries, f"contents {text!r}")
    except DocumentError as error:
        raise ConfigError(str(error)) from None
