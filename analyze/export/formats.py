"""File formats of simulators and ROS, with their suffixes and numerical precision."""

from __future__ import annotations

import enum
import re
from pathlib import Path


class Format(enum.Enum):
    """Format of an export: URDF, SDF, MJCF (MuJoCo), USD, a ROS 2 message, or a folder for Gazebo."""

    URDF = "urdf"
    SDF = "sdf"
    MJCF = "mjcf"
    USD = "usd"
    ROS = "ros"
    GAZEBO = "gazebo"

    @property
    def suffixes(self) -> tuple[str, ...]:
        """File suffixes of this format, with their dot, the usual one first.

        USD's suffix selects text (.usda) or binary, that of a ROS message YAML or JSON. Gazebo's is a folder,
        without a suffix.
        """
        return {
            "urdf": (".urdf",),
            "sdf": (".sdf",),
            "mjcf": (".xml", ".mjcf"),
            "usd": (".usda", ".usd", ".usdc"),
            "ros": (".yaml", ".yml", ".json"),
            "gazebo": (),
        }[self.value]

    @property
    def tolerance(self) -> float:
        """Largest relative error accepted of a number that was written to a file and read back.

        Text formats keep double precision, UsdPhysics single precision.
        """
        return 1e-6 if self is Format.USD else 1e-9


WITH_CONTACT = {Format.SDF, Format.MJCF, Format.GAZEBO, Format.URDF}
"""formats in which a body has friction and restitution of its own; URDF as an extension for Gazebo"""


def why_misnamed(output: Path, wanted: Format) -> str | None:
    """One-line reason why the name of `output` is wrong for the format `wanted`; None if it is right.

    The line proposes a name. A suffix is wrong if it belongs to another format only. Files of USD and ROS
    must have one of their suffixes; those of other formats may have an unknown suffix or none. The name of a
    Gazebo folder, part of the addresses in it, consists of letters, digits, underscores and hyphens.
    """
    suffix = output.suffix.lower()
    if wanted is Format.GAZEBO:
        if re.fullmatch("[A-Za-z0-9_-]+", output.name):
            return None
        name = re.sub("[^A-Za-z0-9_-]+", "_", output.stem).strip("_") or "model"
        return f"{output}: a Gazebo model is a folder named with letters, digits, _ and -: name it {name}"
    if wanted is Format.ROS and suffix not in wanted.suffixes:
        return f"{output}: a ROS message is .yaml or .json, by its suffix: name it {output.stem}.yaml"
    if wanted is Format.USD and suffix not in wanted.suffixes:
        kinds = ".usda (text), .usd or .usdc (binary)"
        return f"{output}: USD is recognised by its suffix, {kinds}: name it {output.stem}.usda"
    for other in Format:
        if other is not wanted and suffix in other.suffixes and suffix not in wanted.suffixes:
            name = f"{output.stem}{wanted.suffixes[0]}"
            formats = f"{other.value.upper()}, not to {wanted.value.upper()}"
            return f"{output}: its suffix belongs to {formats}: name it {name}"
    return None
