"""The session manifest at the head of every recording, and the names of a recording's attachments."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field, field_validator, model_validator

from schemas.document import (
    SCHEMA_VERSION,
    Document,
    Matrix3,
    Matrix4,
    SparseDocument,
    check_pose,
    sha256_text,
)
from schemas.object_spec import ObjectSpec

FISHEYE_COEFFICIENTS = 4


MIN_FOCAL_LENGTH_PX, MAX_FOCAL_LENGTH_PX = 1.0, 1e6
"""Range of a camera's focal lengths [px]: a 1.4 mm lens on 15 um pixels has 93, one of 1 m on 1 um 1e6."""
MAX_OFFSET_PX = 1e6
"""Largest coordinate of a principal point, and largest skew [px]."""

Coefficient = Annotated[float, Field(ge=-1e6, le=1e6)]
"""Coefficient of a lens model; those of a rational model may reach hundreds."""


def check_camera_matrix(K: list[list[float]]) -> None:
    """Check that K (3, 3) is a camera matrix in pixels, with focal lengths that a lens can have.

    Raises:
        ValueError: an element that must be 0 or 1 is not, or another is out of its range.
    """
    (fx, skew, cx), (lower, fy, cy), last = K
    if lower != 0 or last != [0, 0, 1]:
        raise ValueError(
            "it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: focal lengths and principal point in pixels"
        )
    for name, value in (("fx", fx), ("fy", fy)):
        if not MIN_FOCAL_LENGTH_PX <= value <= MAX_FOCAL_LENGTH_PX:
            raise ValueError(
                f"its focal length {name} = {value:g} px must be from {MIN_FOCAL_LENGTH_PX:g} to "
                f"{MAX_FOCAL_LENGTH_PX:g} px: `analyze calibrate` measures it"
            )
    for name, value in (("cx", cx), ("cy", cy), ("skew", skew)):
        if abs(value) > MAX_OFFSET_PX:
            raise ValueError(
                f"its {name} = {value:g} px must be from {-MAX_OFFSET_PX:g} to {MAX_OFFSET_PX:g} px: "
                "`analyze calibrate` measures it"
            )


class TimeSource(enum.Enum):
    """Source of the frames' log times: the camera's clock, arrival at the host, or an imported file."""

    DEVICE_MAPPED = "device_mapped"
    """camera clock, mapped to the host's monotonic clock (a rig's camera)"""
    HOST_ARRIVAL = "host_arrival"
    """host clock at the arrival of the frame"""
    CONTAINER_PTS = "container_pts"
    """time stamps in the imported file"""


class LensModel(enum.Enum):
    """Lens model, in OpenCV's terms: pinhole with radial and tangential distortion, or fisheye."""

    PINHOLE = "pinhole"
    FISHEYE = "fisheye"


class CameraCalibrationSpec(SparseDocument):
    """Intrinsics of a camera and its pose in W, the world frame.

    Distortion as in OpenCV: of a pinhole k1, k2, p1, p2, k3, and k4, k5, k6 if these are used; of a fisheye
    k1, k2, k3, k4.
    """

    left_out: ClassVar[tuple[str, ...]] = ("line_time_s", "strain_sd")

    model: LensModel = LensModel.PINHOLE
    width: int = Field(gt=0, le=100_000, description="width of the image, in pixels")
    height: int = Field(gt=0, le=100_000, description="height of the image, in pixels")
    K: Matrix3 = Field(description="camera matrix, 3 x 3: focal lengths and principal point in pixels")
    distortion: list[Coefficient] = Field(default=[0.0] * 5, min_length=4, max_length=8)
    """coefficients of the lens model, in OpenCV's order"""
    T_world_camera: Matrix4 = Field(description="pose of the camera in W, 4 x 4, in metres")
    line_time_s: float = Field(
        default=0.0,
        ge=-1e-3,
        le=1e-3,
        description="delay of each row against the row above, for a rolling shutter [s]; 0 (global shutter) "
        "is not written",
    )
    rms_px: float | None = Field(
        default=None,
        ge=0,
        le=1e4,
        description="rms reprojection error of the calibration [px]; null if unknown",
    )
    strain_sd: float | None = Field(
        default=None,
        ge=0,
        le=0.1,
        description="1 sigma of the strain of the image that this lens leaves: relative error of a length in "
        "one direction against one across it; not written if not known",
    )

    @field_validator("K")
    @classmethod
    def _camera_matrix(cls, value: list[list[float]]) -> list[list[float]]:
        check_camera_matrix(value)
        return value

    @field_validator("T_world_camera")
    @classmethod
    def _pose(cls, value: list[list[float]]) -> list[list[float]]:
        check_pose(value)
        return value

    @model_validator(mode="after")
    def _coefficients(self) -> CameraCalibrationSpec:
        if (
            self.model is LensModel.FISHEYE
            and len(self.distortion) != FISHEYE_COEFFICIENTS
            and any(self.distortion)
        ):
            raise ValueError(
                f"a fisheye has {FISHEYE_COEFFICIENTS} coefficients k1, k2, k3, k4, not "
                f"{len(self.distortion)}: calibrate with --model fisheye, "
                "or leave `model` out"
            )
        return self


class LevelReading(Document):
    """Tilt of the table, read from a level or a plumb line: rise [rad] towards +x and +y of W.

    W is the world frame, z along the table's normal; objects tip towards +x. The vertical leans, relative to
    the table's normal, towards the higher side by the angle read. An object that tips towards a higher side
    must turn farther by that angle to reach balance. A level's 1 mm/m is 0.001 rad.
    """

    towards_x_rad: float = Field(
        ge=-0.2, le=0.2, description="rise of the table towards W's +x, where objects tip"
    )
    towards_x_sd_rad: float = Field(ge=0, le=1, description="1 sigma of towards_x_rad")
    towards_y_rad: float = Field(
        default=0.0, ge=-0.2, le=0.2, description="rise of the table towards W's +y, away from the camera"
    )
    towards_y_sd_rad: float | None = Field(
        default=None, ge=0, le=1, description="1 sigma of towards_y_rad; gravity_tilt_sd_rad if left out"
    )
    read_by: str = Field(default="level", description="instrument that was read")


class ManifestCamera(SparseDocument):
    """One camera of the recording: name, make, frame rate, exposure and calibration.

    The names of its topics begin with /camera/<name>/.
    """

    left_out: ClassVar[tuple[str, ...]] = ("frame_rate_sd_hz",)

    name: str
    vendor: str = ""
    model: str = ""
    serial: str = ""
    frame_rate_hz: float = Field(gt=0, description="nominal frame rate [Hz]")
    frame_rate_sd_hz: float | None = Field(
        default=None,
        gt=0,
        description="1 sigma of the measured frame rate of an imported recording; not written if not "
        "measured",
    )
    exposure_us: float | None = Field(
        default=None, gt=0, description="exposure time [us]; null if not known, as for an imported video"
    )
    calibration: CameraCalibrationSpec


class RebaseEntry(Document):
    """Change of a recording's object file after the strikes, with hashes of what it replaced.

    The messages, images among them, are unchanged: the copy has the original's `content_id`. What was
    replaced is attached as `rebase-<number>/<name>`, from 1.
    """

    manifest_sha256: str
    """SHA-256 of the original file's manifest, as in its seal"""
    content_id: str | None
    """hash of the original file's messages; null if it has no seal"""
    object_sha256: str
    """hash of the original's object specification and shape file"""
    plan_sha256: str
    """SHA-256 of the original's strike plan"""
    software: str = Field(description="percuss version and git commit that made the change")
    changed: list[str] = Field(description="entries of the object file that differ")


class SessionManifest(SparseDocument):
    """Head of every recording (MCAP metadata `percuss.manifest`): description of how it was made.

    It holds identity and clocks of the recording, gravity, the cameras, the striker, the rig, the object, and
    the hash of the plan, which is an attachment.
    """

    left_out: ClassVar[tuple[str, ...]] = ("rebased",)

    schema_version: str = SCHEMA_VERSION
    recording_id: str
    """id of the recording, common to all files of its series"""
    created: str = Field(description="ISO 8601, UTC")
    software: str = Field(description="percuss version and git commit")
    wall_anchor_ns: int = Field(description="wall clock minus host monotonic clock, read once at the start")
    time_source: TimeSource
    """source of the frame times"""
    time_source_sd_ns: int = Field(ge=0, description="1 sigma of a frame's time against the others'")
    g_m_s2: float = Field(gt=9.7, lt=9.9, description="local gravity [m/s^2]")
    g_sd_m_s2: float = Field(ge=0, description="1 sigma of it")
    gravity_tilt_sd_rad: float = Field(
        ge=0, description="1 sigma of the angle between table normal and vertical, if no level was read"
    )
    level: LevelReading | None = None
    """reading of a level; null if none was read"""
    cameras: list[ManifestCamera] = Field(min_length=1)
    striker: dict[str, Any] = Field(default={})
    """settings of the striker; empty for an imported recording"""
    rig: dict[str, Any] = Field(default={})
    """name of the rig; empty for an imported recording"""
    object: ObjectSpec
    object_sha256: str
    """SHA-256 of the object's specification and shape file, which identifies it"""
    plan_sha256: str
    """SHA-256 of the strike plan's text"""
    hashes: dict[str, str] = Field(default={}, description="attachment name -> sha256")
    random_seed: int | None = None
    """seed of the recording's random numbers; null if none is stated"""
    part: int = Field(default=1, ge=1, description="number of this file in the recording's series of files")
    rebased: list[RebaseEntry] | None = Field(
        default=None,
        description="changes of the object file after the strikes, the latest last; not written if none",
    )


MANIFEST_NAME = "percuss.manifest"
SEAL_NAME = "percuss.seal"
RECOVERED_NAME = "percuss.recovered"
PLAN_ATTACHMENT = "plan.json"
OBJECT_ATTACHMENT = "object.toml"
RIG_ATTACHMENT = "rig.toml"
SHAPE_ATTACHMENT_PREFIX = "shape/"


def manifest_entries(text: str) -> dict[str, str]:
    """Entries of the metadata record that holds a manifest: its JSON text, and the text's hash."""
    return {"json": text, "sha256": sha256_text(text)}


def stated_manifest_hashes(entries: Mapping[str, str], seal: Mapping[str, str]) -> set[str]:
    """Hashes that a file states of its manifest: beside the text, and in the seal; empty if none is stated.

    Args:
        entries: entries of the manifest's metadata record.
        seal: entries of the seal; empty if the file has none.
    """
    stated = {entries.get("sha256"), seal.get("manifest_sha256")}
    return {each for each in stated if each is not None}
