"""The rig file (TOML), which both commands read: camera, striker, recorder, daemon. SI units; unknown keys are refused; defaults work."""

from __future__ import annotations

import os
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, field_validator

from schemas.document import Document
from schemas.rig_limits import ARM_LENGTH_M, COCKED_ANGLE_RAD, VELOCITY_LIMIT_RAD_S, TipSpeeds, tip_speeds
from schemas.session_manifest import CameraCalibrationSpec, LevelReading


class CameraConfig(Document):
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
    calibration: CameraCalibrationSpec = Field(description="width, height, K, distortion and T_world_camera: docs/guide.md")


class StrikerConfig(Document):
    """A Dynamixel that swings an arm. Angle 0 = arm hangs vertical, its face touching the impact point; + swings to the object."""

    kind: Literal["dynamixel", "manual"] = "dynamixel"
    port: str = "/dev/ttyUSB0"
    baud_rate: int = 1_000_000
    id: int = Field(default=1, ge=0, le=252)
    zero_position: int = Field(default=2048, ge=0, le=4095, description="ticks at angle 0")
    direction: Literal[1, -1] = 1
    arm_length_m: float = Field(default=ARM_LENGTH_M, gt=0, le=2)
    effective_mass_kg: float = Field(default=0.2, gt=0, le=10, description="I_arm / r^2, as felt at the tip")
    effective_mass_sd_kg: float = Field(default=0.05, ge=0, le=10)
    restitution: float = Field(default=0.4, ge=0, le=1)
    restitution_sd: float = Field(default=0.15, ge=0, le=1)
    reach_m: tuple[float, float] = Field(
        default=(0.015, 0.4), description="heights over the table that the tip can be set to; for `analyze plan`"
    )
    cocked_angle_rad: float = Field(default=COCKED_ANGLE_RAD, ge=-2.5, lt=0)
    current_limit_a: float = Field(default=1.0, gt=0, le=3.2, description="the servo's own register ends here, as those below")
    velocity_limit_rad_s: float = Field(default=VELOCITY_LIMIT_RAD_S, gt=0, le=24.5)
    temperature_limit_c: int = Field(default=70, gt=0, le=100)
    arming_expires_s: float = Field(default=20.0, gt=0, le=600, description="an arming that nobody uses is void after this")

    @field_validator("reach_m")
    @classmethod
    def _rising(cls, value: tuple[float, float]) -> tuple[float, float]:
        low, high = value
        if not 0 < low < high < 2:
            raise ValueError(f"reach_m = [{low:g}, {high:g}] is not two rising heights in metres")
        return value

    def tip_speeds(self) -> TipSpeeds:
        """What a strike may be asked for; a hand has no limits of its own and is asked for what the nominal arm can."""
        if self.kind == "manual":
            return tip_speeds()
        return tip_speeds(self.arm_length_m, self.cocked_angle_rad, self.velocity_limit_rad_s)


class RecorderConfig(Document):
    """What is kept: every frame of a strike window and previews outside it, or every frame; every frame's meta always."""

    directory: str = Field(default="recordings", description="whose disk `acquire check` tries; a session records where its -o says")
    mode: Literal["windows", "continuous"] = "windows"
    rotate_bytes: int = Field(default=2 << 30, ge=0, description="continuous: size at which the next numbered file is begun; 0: never")
    keep_files: int = Field(default=0, ge=0, description="continuous: files kept, the oldest is deleted; 0: all")
    pre_trigger_s: float = Field(default=0.25, ge=0)
    preview_hz: float = Field(default=4.0, ge=0)
    max_window_s: float = Field(default=6.0, gt=0)
    image_format: Literal["raw", "png"] = "raw"
    disk_reserve_bytes: int = Field(default=1 << 30, ge=0)


class DaemonConfig(Document):
    """Where the daemon listens. The socket's folder is private to the user."""

    socket: str | None = None

    def socket_path(self) -> Path:
        """The socket's path: as configured, else in the user's run-time folder."""
        if self.socket is not None:
            return Path(self.socket)
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        base = Path(runtime) if runtime else Path(f"/tmp/percuss-{os.getuid()}")  # noqa: S108 - created 0700, ownership checked
        return base / "percuss" / "daemon.sock"


class RigConfig(Document):
    """A whole rig."""

    by_hand: ClassVar[bool] = True

    name: str = "rig"
    g_m_s2: float = Field(default=9.81, gt=9.7, lt=9.9)
    g_sd_m_s2: float = Field(default=0.005, ge=0, le=1)
    gravity_tilt_sd_rad: float = Field(default=0.0035, ge=0, le=1, description="1 sigma of the table against the vertical (0.2 deg)")
    level: LevelReading | None = Field(
        default=None, description="what a level or a plumb line showed, in place of 0 +- gravity_tilt_sd_rad"
    )
    table_friction: float = Field(
        default=0.4, gt=0, le=10, description="least friction coefficient between table and object; plans count on it"
    )
    camera: CameraConfig = Field(description="with address and [camera.calibration]: docs/guide.md shows a whole rig file")
    striker: StrikerConfig = StrikerConfig()
    recorder: RecorderConfig = RecorderConfig()
    daemon: DaemonConfig = DaemonConfig()
