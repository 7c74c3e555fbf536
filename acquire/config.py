"""The rig file (TOML): cameras, striker, recorder, daemon. SI units; unknown keys are refused; every default works."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from acquire.errors import ConfigError
from schemas.documents import CameraCalibrationSpec, DocumentError, validate


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class CameraConfig(_Section):
    """A GigE Vision camera and its calibration (intrinsics of the region below, pose in W)."""

    name: str = Field(default="main", pattern=r"^[a-z][a-z0-9_]*$")
    address: str = Field(description="IP address, or the device id that `acquire discover` prints")
    width: int = Field(default=656, gt=0)
    height: int = Field(default=492, gt=0)
    offset_x: int = Field(default=0, ge=0)
    offset_y: int = Field(default=0, ge=0)
    pixel_format: Literal["Mono8"] = Field(default="Mono8", description="the only one that recorder and tracking take")
    frame_rate_hz: float = Field(default=120.0, gt=0, description="with a trigger: the rate of its pulses")
    exposure_us: float = Field(default=1500.0, gt=0)
    gain_db: float = Field(default=0.0, ge=0)
    trigger: str = Field(
        default="off",
        pattern=r"^(off|Line[0-9]+)$",
        description="off: the camera times itself; else its input whose rising edge is a frame",
    )
    packet_size: int = Field(default=8192, ge=576, le=9000)
    receive_buffer_bytes: int = Field(default=16 << 20, gt=0)
    buffers: int = Field(default=64, ge=8)
    stall_s: float = Field(default=1.0, gt=0)
    calibration: CameraCalibrationSpec


class StrikerConfig(_Section):
    """A Dynamixel that swings an arm. Angle 0 = arm hangs vertical, its face touching the impact point; + swings to the object."""

    kind: Literal["dynamixel", "manual"] = "dynamixel"
    port: str = "/dev/ttyUSB0"
    baud_rate: int = 1_000_000
    id: int = Field(default=1, ge=0, le=252)
    zero_position: int = Field(default=2048, description="ticks at angle 0")
    direction: Literal[1, -1] = 1
    arm_length_m: float = Field(default=0.12, gt=0)
    effective_mass_kg: float = Field(default=0.2, gt=0, description="I_arm / r^2, as felt at the tip")
    effective_mass_sd_kg: float = Field(default=0.05, ge=0)
    restitution: float = Field(default=0.4, ge=0, le=1)
    restitution_sd: float = Field(default=0.15, ge=0, le=1)
    reach_m: tuple[float, float] = Field(
        default=(0.015, 0.4), description="heights over the table that the tip can be set to; for `analyze plan`"
    )
    cocked_angle_rad: float = Field(default=-0.6, lt=0)
    current_limit_a: float = Field(default=1.0, gt=0)
    velocity_limit_rad_s: float = Field(default=8.0, gt=0)
    temperature_limit_c: int = Field(default=70, gt=0)
    arming_expires_s: float = Field(default=20.0, gt=0)


class RecorderConfig(_Section):
    """What is kept: every frame of a strike window and previews outside it, or every frame; every frame's meta always."""

    directory: str = "recordings"
    mode: Literal["windows", "continuous"] = "windows"
    rotate_bytes: int = Field(default=2 << 30, ge=0, description="continuous: size at which the next numbered file is begun; 0: never")
    keep_files: int = Field(default=0, ge=0, description="continuous: files kept, the oldest is deleted; 0: all")
    pre_trigger_s: float = Field(default=0.25, ge=0)
    preview_hz: float = Field(default=4.0, ge=0)
    max_window_s: float = Field(default=6.0, gt=0)
    image_format: Literal["raw", "png"] = "raw"
    disk_reserve_bytes: int = Field(default=1 << 30, ge=0)


class DaemonConfig(_Section):
    """Where the daemon listens. The socket's folder is private to the user."""

    socket: str | None = None

    def socket_path(self) -> Path:
        """The socket's path: as configured, else in the user's run-time folder."""
        if self.socket is not None:
            return Path(self.socket)
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        base = Path(runtime) if runtime else Path(f"/tmp/percuss-{os.getuid()}")  # noqa: S108 - created 0700, ownership checked
        return base / "percuss" / "daemon.sock"


class RigConfig(_Section):
    """A whole rig."""

    name: str = "rig"
    g_m_s2: float = Field(default=9.81, gt=9.7, lt=9.9)
    g_sd_m_s2: float = Field(default=0.005, ge=0)
    gravity_tilt_sd_rad: float = Field(default=0.0035, ge=0, description="1 sigma of the table against the vertical (0.2 deg)")
    table_friction: float = Field(default=0.4, gt=0, description="least friction coefficient between table and object; plans count on it")
    camera: CameraConfig
    striker: StrikerConfig = StrikerConfig()
    recorder: RecorderConfig = RecorderConfig()
    daemon: DaemonConfig = DaemonConfig()


def read_rig(path: Path) -> RigConfig:
    """Read and validate a rig file.

    Raises:
        ConfigError: the file is missing, is not TOML, or holds an entry that cannot be used.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # not UTF-8, not TOML, nested too deep
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    try:
        return validate(RigConfig, data, str(path))
    except DocumentError as error:
        raise ConfigError(str(error)) from None
