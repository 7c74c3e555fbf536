"""Reader of the rig file, and the rig's limits that a session needs from the daemon.

The file's schema is in schemas/rig.py, because `analyze plan` reads it too.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.errors import ConfigError
from schemas.document import DocumentError, validate
from schemas.input_file import read_text
from schemas.rig import RigConfig
from schemas.rig_limits import TipSpeeds


def read_rig(path: Path) -> RigConfig:
    """Read and validate a rig file (TOML).

    Returns:
        Settings of camera, striker, recorder and daemon, with gravity and table.

    Raises:
        ConfigError: the file is missing, is not TOML, or holds an entry that cannot be used.
    """
    try:
        data = tomllib.loads(read_text(path))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be read: {error.strerror}: check that it is a file you may read"
        ) from None
    except (ValueError, RecursionError) as error:  # not UTF-8, not TOML, nested too deep
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    try:
        return validate(RigConfig, data, str(path))
    except DocumentError as error:
        raise ConfigError(str(error)) from None


@dataclass(frozen=True)
class RigLimits:
    """Tip speeds and impact heights that a rig's striker can reach, and the camera's pose.

    The pose is in W, the world frame.
    """

    speeds: TipSpeeds | None
    """range of tip speeds [m/s]; None if a person strikes by hand, which has no fixed limits"""
    reach_m: tuple[float, float] | None
    """lowest and highest impact point over the table [m]; None if a person strikes by hand"""
    T_world_camera: list[list[float]]
    """(4, 4) pose of the camera in W [m]"""
    arm_length_m: float | None = None
    """length of the servo's arm [m]; None without one"""

    @classmethod
    def from_config(cls, config: RigConfig) -> RigLimits:
        """Limits of tip speed and impact height, and the camera's pose, from a rig file's content."""
        striker, pose = config.striker, config.camera.calibration.T_world_camera
        if not striker.traits.has_limits:
            return cls(None, None, pose)
        arm_m = striker.arm_length_m if striker.traits.has_servo else None
        return cls(striker.tip_speeds(), striker.reach_m, pose, arm_m)

    def as_dict(self) -> dict[str, Any]:
        """Tip speeds, impact heights and camera pose as a JSON object: the answer to a request `rig`.

        Its entries: `speeds_m_s` (slowest, fastest), `reach_m` (lowest, highest) and `arm_length_m`, all None
        for strikes by hand, and `T_world_camera` (4, 4) [m].
        """
        speeds = None if self.speeds is None else [self.speeds.slowest_m_s, self.speeds.fastest_m_s]
        return {
            "speeds_m_s": speeds,
            "reach_m": self.reach_m,
            "T_world_camera": self.T_world_camera,
            "arm_length_m": self.arm_length_m,
        }

    @classmethod
    def from_dict(cls, answer: Mapping[str, Any]) -> RigLimits:
        """Limits of a rig (tip speeds, heights, camera pose) from the daemon's answer to the request `rig`.

        The answer is a JSON object; a limit that it gives as None stays None.
        """
        speeds, reach = answer["speeds_m_s"], answer["reach_m"]
        return cls(
            None if speeds is None else TipSpeeds(*speeds),
            None if reach is None else (reach[0], reach[1]),
            answer["T_world_camera"],
            answer.get("arm_length_m"),
        )
