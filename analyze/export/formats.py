"""The formats, and how exactly each keeps a number."""

from __future__ import annotations

import enum
from pathlib import Path


class Format(enum.Enum):
    """A format that simulators read."""

    URDF = "urdf"
    SDF = "sdf"
    MJCF = "mjcf"
    USD = "usd"

    @property
    def suffixes(self) -> tuple[str, ...]:
        """How its files are named, the usual name first; USD's say which of its encodings is meant."""
        return {
            "urdf": (".urdf",),
            "sdf": (".sdf",),
            "mjcf": (".xml", ".mjcf"),
            "usd": (".usda", ".usd", ".usdc"),
        }[self.value]

    @property
    def tolerance(self) -> float:
        """Relative difference up to which a number is the same after reading: text keeps double precision, UsdPhysics has single."""
        return 1e-6 if self is Format.USD else 1e-9


def why_misnamed(output: Path, wanted: Format) -> str | None:
    """One line that says why no reader would take `output` for a file of format `wanted`; None where it is well named."""
    suffix = output.suffix.lower()
    if wanted is Format.USD and suffix not in wanted.suffixes:
        return f"{output}: USD goes by the name's ending: .usda (text), .usd or .usdc (binary): name it {output.stem}.usda"
    for other in Format:
        if other is not wanted and suffix in other.suffixes and suffix not in wanted.suffixes:
            name = f"{output.stem}{wanted.suffixes[0]}"
            return f"{output}: would be read as {other.value.upper()}, and is to be {wanted.value.upper()}: name it {name}"
    return None
