"""The formats, with their suffixes and numerical precision."""

from __future__ import annotations

import enum
from pathlib import Path


class Format(enum.Enum):
    """Format of a simulator's file."""

    URDF = "urdf"
    SDF = "sdf"
    MJCF = "mjcf"
    USD = "usd"

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its files, the usual one first; USD's select one of its encodings."""
        return {
            "urdf": (".urdf",),
            "sdf": (".sdf",),
            "mjcf": (".xml", ".mjcf"),
            "usd": (".usda", ".usd", ".usdc"),
        }[self.value]

    @property
    def tolerance(self) -> float:
        """Relative error of a number that was written and read.

        Text keeps double precision, UsdPhysics single.
        """
        return 1e-6 if self is Format.USD else 1e-9


def why_misnamed(output: Path, wanted: Format) -> str | None:
    """Line on why readers would not take `output` for a file of format `wanted`; None if it is well named."""
    suffix = output.suffix.lower()
    if wanted is Format.USD and suffix not in wanted.suffixes:
        kinds = ".usda (text), .usd or .usdc (binary)"
        return f"{output}: USD is recognised by its suffix, {kinds}: name it {output.stem}.usda"
    for other in Format:
        if other is not wanted and suffix in other.suffixes and suffix not in wanted.suffixes:
            name = f"{output.stem}{wanted.suffixes[0]}"
            formats = f"{other.value.upper()}, not to {wanted.value.upper()}"
            return f"{output}: its suffix belongs to {formats}: name it {name}"
    return None
