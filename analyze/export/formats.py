"""File formats of simulators, with their suffixes and numerical precision."""

from __future__ import annotations

import enum
from pathlib import Path


class Format(enum.Enum):
    """File format of a simulator: URDF (ROS), SDF (Gazebo), MJCF (MuJoCo) or USD."""

    URDF = "urdf"
    SDF = "sdf"
    MJCF = "mjcf"
    USD = "usd"

    @property
    def suffixes(self) -> tuple[str, ...]:
        """File suffixes of this format, with their dot, the usual one first.

        USD's suffix selects text (.usda) or binary.
        """
        return {
            "urdf": (".urdf",),
            "sdf": (".sdf",),
            "mjcf": (".xml", ".mjcf"),
            "usd": (".usda", ".usd", ".usdc"),
        }[self.value]

    @property
    def tolerance(self) -> float:
        """Largest relative error accepted of a number that was written to a file and read back.

        Text formats keep double precision, UsdPhysics single precision.
        """
        return 1e-6 if self is Format.USD else 1e-9


def why_misnamed(output: Path, wanted: Format) -> str | None:
    """One-line reason why the suffix of `output` is wrong for the format `wanted`; None if it is right.

    The line proposes a name. A suffix is wrong if it belongs to another format only. A USD file must have one
    of USD's suffixes; files of other formats may have an unknown suffix or none.
    """
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
