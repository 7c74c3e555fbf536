"""The rig file (TOML), which `acquire` and `analyze` read: camera, striker, recorder, daemon.

SI units; unknown keys are refused.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from schemas.camera_kind import CAMERA_KINDS, CameraKind, CameraKindName, PixelFormatName
from schemas.daemon_config import DaemonConfig
from schemas.document import Document
from schemas.rig_limits import (
    ARM_LENGTH_M,
    COCKED_ANGLE_RAD,
    TABLE_FAR_EDGE_M,
    VELOCITY_LIMIT_RAD_S,
    TipSpeeds,
    tip_speeds,
)
from schemas.servo_models import DEFAULT_MODEL, SERVO_MODELS, UNMEASURED_MASS_SD_KG, ModelName
from schemas.session_manifest import CameraCalibrationSpec, LevelReading
from schemas.striker_kind import STRIKER_KINDS, KindName, StrikerKind

MAX_SENSOR_PX = 100_000
"""Largest width and height of a sensor [px]."""
CURRENT_LIMIT_A = 1.0
"""Current limit unless the rig file gives one or the model takes less [A]."""
SWING_SHARE = 0.6
"""Share of an arm's full acceleration that a swing uses: the rest holds it on the ordered motion."""
MAX_WAIT_S = 3600.0
"""Longest wait and longest window [s]."""
MAX_TIP_SPEED_M_S = 10.0
"""Largest tip speed that a rig file can state [m/s]."""
MAX_BYTES = 1 << 50
"""Largest size of a file or disk reserve [bytes]."""


class CameraConfig(Document):
    """Camera: kind, address, region of interest, stream settings, calibration and pose.

    The calibration is that of the region of interest, with the camera's pose in W, the world frame.
    """

    name: str = Field(default="main", pattern=r"^[a-z][a-z0-9_]*$")
    """name of the camera in the recording's topics"""
    kind: CameraKindName = Field(
        default="gige", description="gige and usb3: GigE and USB3 Vision; v4l2: webcam or other video device"
    )
    address: str = Field(
        description="IP address, device id or path of the device, as `acquire discover` prints it"
    )
    width: int = Field(
        default=656, gt=0, le=MAX_SENSOR_PX, description="width of the region of interest [px]"
    )
    height: int = Field(
        default=492, gt=0, le=MAX_SENSOR_PX, description="height of the region of interest [px]"
    )
    offset_x: int = Field(
        default=0, ge=0, le=MAX_SENSOR_PX, description="first column of the region on the sensor [px]"
    )
    offset_y: int = Field(
        default=0, ge=0, le=MAX_SENSOR_PX, description="first row of the region on the sensor [px]"
    )
    pixel_format: PixelFormatName = Field(
        default="Mono8",
        description="format in which the camera sends images, recorded grey; v4l2: YUYV or MJPG too",
    )
    frame_rate_hz: float = Field(
        default=120.0, ge=0.01, le=1e5, description="frame rate [Hz]; with a trigger the rate of its pulses"
    )
    exposure_us: float = Field(default=1500.0, ge=0.01, le=1e8, description="exposure time [us]")
    gain_db: float | None = Field(
        default=None, ge=-100, le=100, description="gain [dB]; the camera's lowest if neither gain is given"
    )
    gain_raw: int | None = Field(
        default=None, ge=0, le=1_000_000, description="gain in the steps of cameras that do not count in dB"
    )
    timestamp_at: Literal["exposure_start", "exposure_end", "trigger"] = Field(
        default="exposure_start",
        description="instant of a frame that the camera stamps; `acquire check` finds it out",
    )
    trigger: str = Field(
        default="off",
        pattern=r"^(off|Line[0-9]+)$",
        description="off: the camera runs freely; otherwise the input line whose rising edge starts a frame",
    )
    packet_size: int = Field(default=8192, ge=576, le=9000, description="gige: size of GVSP packets [bytes]")
    receive_buffer_bytes: int = Field(
        default=16 << 20, gt=0, lt=1 << 31, description="gige: socket receive buffer [bytes]"
    )
    buffers: int = Field(default=64, ge=8, le=100_000, description="number of frame buffers")
    stall_s: float = Field(
        default=1.0,
        ge=0.001,
        le=MAX_WAIT_S,
        description="time without a frame after which the stream counts as stalled [s]",
    )
    calibration: CameraCalibrationSpec = Field(
        description="width, height, K, distortion and T_world_camera: docs/how-to/rig.md"
    )

    @property
    def traits(self) -> CameraKind:
        """Properties that follow from the kind of camera: network, USB, trigger, formats."""
        return CAMERA_KINDS[self.kind]

    @model_validator(mode="after")
    def _possible_for_the_kind(self) -> Self:
        traits = self.traits
        if self.gain_db is not None and self.gain_raw is not None:
            raise ValueError("gain_db and gain_raw are both given: keep the one that the camera counts in")
        if self.pixel_format not in traits.pixel_formats:
            raise ValueError(
                f'pixel_format = "{self.pixel_format}" is not one of {traits.description}: '
                f"write {' or '.join(traits.pixel_formats)}"
            )
        if self.trigger != "off" and not traits.can_be_triggered:
            raise ValueError(
                f'trigger = "{self.trigger}": {traits.description} has no trigger input: write "off"'
            )
        if (self.offset_x or self.offset_y) and not traits.has_offsets:
            raise ValueError(
                f"offset_x, offset_y = {self.offset_x}, {self.offset_y}: {traits.description} gives whole "
                "images: write 0"
            )
        return self


class StrikerConfig(Document):
    """Striker: a Dynamixel servo that swings an arm, a board that fires one (serial), or a person (manual).

    At angle 0 the arm hangs vertically, with its tip at the impact point; a positive angle is towards the
    object.
    """

    kind: KindName = "dynamixel"
    port: str = Field(default="/dev/ttyUSB0", description="serial port of the servo bus or board")
    baud_rate: int = Field(
        default=1_000_000, ge=1200, le=100_000_000, description="bits per second on the port"
    )
    speed_range_m_s: tuple[float, float] | None = Field(
        default=None,
        description="serial: slowest and fastest tip speed [m/s], within those that the board reports",
    )
    contact_sd_s: float = Field(
        default=0.0005,
        ge=0,
        le=1,
        description="serial: 1 sigma of the time from first touch to the contact sensor's signal [s]",
    )
    id: int = Field(default=1, ge=0, le=252, description="id of the servo on the bus")
    model: ModelName = Field(default=DEFAULT_MODEL, description="model of the servo")
    supply_v: float | None = Field(
        default=None, gt=0, le=30, description="supply voltage of the servo [V]; its nominal one if left out"
    )
    zero_position: int = Field(default=2048, ge=0, le=4095, description="servo ticks at angle 0")
    direction: Literal[1, -1] = Field(
        default=1, description="sign of the servo's rotation towards the object"
    )
    arm_length_m: float = Field(
        default=ARM_LENGTH_M, ge=0.001, le=2, description="distance from the servo's axis to the tip"
    )
    effective_mass_kg: float = Field(
        default=0.2,
        ge=1e-4,
        le=10,
        description="effective mass at the tip [kg]: moment of inertia / arm length^2",
    )
    effective_mass_sd_kg: float = Field(
        default=0.05, ge=0, le=10, description="1 sigma of it; 0.1 kg if neither is stated"
    )
    restitution: float = Field(
        default=0.4, ge=0, le=1, description="coefficient of restitution of tip and object"
    )
    restitution_sd: float = Field(default=0.15, ge=0, le=1, description="1 sigma of it")
    reach_m: tuple[float, float] = Field(
        default=(0.015, 0.4),
        description="lowest and highest setting of the tip above the table, in metres; for `analyze plan`",
    )
    cocked_angle_rad: float = Field(
        default=COCKED_ANGLE_RAD, ge=-2.5, lt=0, description="angle from which the arm is released"
    )
    current_limit_a: float = Field(
        default=CURRENT_LIMIT_A,
        gt=0,
        le=5.5,
        description="current limit [A]; this and the limits below are at most those of the servo's registers",
    )
    velocity_limit_rad_s: float = Field(
        default=VELOCITY_LIMIT_RAD_S, gt=0, le=24.5, description="limit of the arm's angular speed"
    )
    temperature_limit_c: int = Field(default=70, gt=0, le=100, description="limit of the servo's temperature")
    arming_expires_s: float = Field(
        default=20.0, gt=0, le=600, description="time after which an unused arming expires [s]"
    )

    @field_validator("model", mode="before")
    @classmethod
    def _known(cls, value: object) -> object:
        if isinstance(value, str) and value not in SERVO_MODELS:
            raise ValueError(
                f"{value} cannot drive the striker, as it has no current limit, or is unknown here: use one "
                f"of {', '.join(SERVO_MODELS)}"
            )
        return value

    @field_validator("reach_m")
    @classmethod
    def _rising(cls, value: tuple[float, float]) -> tuple[float, float]:
        low, high = value
        if not 0 < low < high < 2:
            raise ValueError(f"reach_m = [{low:g}, {high:g}] must be two increasing heights in metres")
        return value

    @field_validator("speed_range_m_s")
    @classmethod
    def _is_range(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not 0 < value[0] <= value[1] <= MAX_TIP_SPEED_M_S:
            low, high = value
            raise ValueError(
                f"speed_range_m_s = [{low:g}, {high:g}] must be the slowest and the fastest tip speed, "
                f"above 0 and at most {MAX_TIP_SPEED_M_S:g} m/s"
            )
        return value

    @model_validator(mode="after")
    def _states_its_speeds(self) -> StrikerConfig:
        if self.traits.states_speeds and self.speed_range_m_s is None:
            raise ValueError(
                f'kind = "{self.kind}" needs speed_range_m_s, the slowest and the fastest tip speed [m/s]: '
                "add for example speed_range_m_s = [0.1, 0.6]"
            )
        return self

    @property
    def traits(self) -> StrikerKind:
        """Properties that follow from the kind of striker: port, servo, limits."""
        return STRIKER_KINDS[self.kind]

    def tip_speeds(self) -> TipSpeeds:
        """Range of tip speeds [m/s] that a strike can use.

        That is the range in the rig file, for kinds that state one; otherwise that of the arm. For strikes by
        hand it is that of an arm with default length, cocked (raised) angle and speed limit.
        """
        if not self.traits.has_limits:
            return tip_speeds()
        if self.traits.states_speeds and self.speed_range_m_s is not None:
            return TipSpeeds(*self.speed_range_m_s)
        model = SERVO_MODELS[self.model]
        no_load_rad_s = model.no_load_rad_s * (self.supply_v or model.nominal_v) / model.nominal_v
        fastest_rad_s = min(self.velocity_limit_rad_s, no_load_rad_s)
        return tip_speeds(
            self.arm_length_m, self.cocked_angle_rad, fastest_rad_s, self.swing_acceleration_rad_s2
        )

    @property
    def full_acceleration_rad_s2(self) -> float:
        """Angular acceleration of the arm at the motor's current limit, without drag."""
        inertia = self.effective_mass_kg * self.arm_length_m**2
        return SERVO_MODELS[self.model].torque_per_ampere * self.current_limit_a / inertia

    @property
    def swing_acceleration_rad_s2(self) -> float:
        """Angular acceleration that the arm follows in a swing: SWING_SHARE of the full one."""
        return SWING_SHARE * self.full_acceleration_rad_s2

    @model_validator(mode="before")
    @classmethod
    def _what_is_not_stated(cls, data: Any) -> Any:
        """Assume a small model's largest current, and the effective mass of an arm that nobody measured."""
        if not isinstance(data, dict):
            return data
        assumed: dict[str, Any] = {}
        if not data.keys() & {"effective_mass_kg", "effective_mass_sd_kg"}:
            assumed["effective_mass_sd_kg"] = UNMEASURED_MASS_SD_KG
        model = SERVO_MODELS.get(data.get("model", DEFAULT_MODEL))
        if model is not None and model.most_current_a < CURRENT_LIMIT_A:
            assumed["current_limit_a"] = model.most_current_a
        return assumed | data

    @model_validator(mode="after")
    def _current_of_the_model(self) -> Self:
        most_a = SERVO_MODELS[self.model].most_current_a
        if self.current_limit_a > most_a:
            raise ValueError(
                f"current_limit_a = {self.current_limit_a:g} is above the {most_a:.3g} A of an {self.model}: "
                "lower it"
            )
        return self


class RecorderConfig(Document):
    """Settings of the recorder: which frames are kept, format, size and number of files, disk reserve.

    In mode "windows" the frames of strike windows (time spans around strikes) are kept, with previews (single
    images) between them; in mode "continuous" all frames. The metadata of every frame (FrameMeta messages)
    are always recorded.
    """

    directory: str = Field(
        default="recordings",
        description="folder whose disk `acquire check` tests; a session records to its -o path",
    )
    mode: Literal["windows", "continuous"] = "windows"
    """windows: frames of strike windows and previews; continuous: all frames"""
    rotate_bytes: int = Field(
        default=2 << 30,
        ge=0,
        le=MAX_BYTES,
        description="continuous: file size at which the next numbered file begins; 0: never",
    )
    keep_files: int = Field(
        default=0,
        ge=0,
        le=1_000_000,
        description="continuous: number of files kept, older ones are deleted; 0: all",
    )
    pre_trigger_s: float = Field(
        default=0.25,
        ge=0,
        le=MAX_WAIT_S,
        description="time before the opening of a window from which frames are kept [s]",
    )
    preview_hz: float = Field(
        default=4.0, ge=0, le=1e5, description="rate of images kept between windows [Hz]"
    )
    max_window_s: float = Field(
        default=6.0, gt=0, le=MAX_WAIT_S, description="longest window; it is then closed [s]"
    )
    image_format: Literal["raw", "png"] = Field(default="raw", description="raw pixels, or PNG without loss")
    compact: Literal["never", "after-session"] = Field(
        default="never",
        description="after-session: `analyze compact` halves a recording without loss, between sessions",
    )
    disk_reserve_bytes: int = Field(
        default=1 << 30, ge=0, le=MAX_BYTES, description="disk space that recordings leave free [bytes]"
    )


class RigConfig(Document):
    """Camera, striker, recorder and daemon of a rig, with gravity and table."""

    by_hand: ClassVar[bool] = True

    name: str = "rig"
    """name of the rig"""
    g_m_s2: float = Field(default=9.81, gt=9.7, lt=9.9, description="local gravity [m/s^2]")
    g_sd_m_s2: float = Field(default=0.005, ge=0, le=1, description="1 sigma of it")
    gravity_tilt_sd_rad: float = Field(
        default=0.0035,
        ge=0,
        le=1,
        description="1 sigma of the angle between table normal and vertical (0.2 deg)",
    )
    level: LevelReading | None = Field(
        default=None, description="reading of a level or plumb line, in place of 0 +- gravity_tilt_sd_rad"
    )
    table_friction: float = Field(
        default=0.4,
        ge=0.001,
        le=10,
        description="smallest friction coefficient between table and object, which plans assume",
    )
    table_name: str | None = Field(
        default=None,
        min_length=1,
        max_length=80,
        description="surface that objects stand on, such as oak: friction is reported for it",
    )
    table_far_edge_m: float = Field(
        default=TABLE_FAR_EDGE_M,
        gt=0,
        le=10,
        description="distance of the table's far edge behind the pivot line, in metres: it hides what is "
        "tossed behind it and lower",
    )
    camera: CameraConfig = Field(
        description="with address and [camera.calibration]: docs/how-to/rig.md shows a whole rig file"
    )
    striker: StrikerConfig = StrikerConfig()
    recorder: RecorderConfig = RecorderConfig()
    daemon: DaemonConfig = DaemonConfig()
