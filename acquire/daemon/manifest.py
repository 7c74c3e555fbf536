"""Manifest of a recording: object, hash of the plan, rig, camera and clock at its beginning."""

from __future__ import annotations

import base64
import hashlib
import uuid
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from acquire.camera.base import CameraInfo
from acquire.errors import SessionError
from schemas.document import DocumentError, sha256_text
from schemas.object_spec import ObjectSpec, object_sha256, parse_object_spec
from schemas.rig import RigConfig
from schemas.session_manifest import (
    OBJECT_ATTACHMENT,
    PLAN_ATTACHMENT,
    RIG_ATTACHMENT,
    SHAPE_ATTACHMENT_PREFIX,
    ManifestCamera,
    SessionManifest,
    TimeSource,
)
from schemas.software import software_version
from schemas.strike_plan import parse_strike_plan

MAPPING_SD_NS = 30_000
"""1 sigma [ns] of the camera-to-host clock mapping with a latched clock (docs/how-to/hardware.md)"""
ARRIVAL_SD_NS = 500_000
"""1 sigma [ns] of arrival times, for cameras whose clock cannot be latched"""


@dataclass(frozen=True)
class OpenCamera:
    """Identity of the open camera, and whether frame times come from the camera's own clock."""

    info: CameraInfo
    clock_latched: bool
    """True if frame times are mapped from the camera's clock; False: they are arrival times"""


@dataclass(frozen=True)
class SessionFiles:
    """Object and plan of a session, and the files attached to its recording."""

    spec: ObjectSpec
    """the object file's content"""
    object_sha256: str
    """SHA-256 of the object and its shape"""
    plan_sha256: str
    """SHA-256 of the plan's text"""
    attachments: tuple[tuple[str, str, bytes], ...]
    """files to attach to the recording: (name, media type, content) of each"""

    @property
    def hashes(self) -> dict[str, str]:
        """SHA-256 (hexadecimal) of the content of each attached file, by its name."""
        return {name: hashlib.sha256(content).hexdigest() for name, _, content in self.attachments}


def session_files(request: dict[str, Any], rig_toml: str) -> SessionFiles:
    """Check and pack the files of a session from the parameters of the request `recording.open`.

    Args:
        request: `object_toml`, `plan_json`, and for an object with a shape file `shape_base64` and
            `shape_name`; `object_name` and `plan_name`, if given, appear in errors.
        rig_toml: text of the rig file.

    Returns:
        Content of the object file, hashes of object and plan, and the files to attach to the recording:
        object, plan, rig and, if there is one, shape.

    Raises:
        SessionError: object or plan cannot be used, or the plan was made for another object.
        KeyError, ValueError: a parameter is missing, or the shape is not base64.
    """
    try:
        spec = parse_object_spec(request["object_toml"], request.get("object_name", OBJECT_ATTACHMENT))
        plan = parse_strike_plan(request["plan_json"], request.get("plan_name", PLAN_ATTACHMENT))
    except DocumentError as error:
        raise SessionError(str(error)) from None
    shape = base64.b64decode(request["shape_base64"]) if request.get("shape_base64") else None
    digest = object_sha256(spec, shape)
    if plan.object_sha256 != digest:
        raise SessionError(f"the plan was made for another object than {spec.name!r}: repeat `analyze plan`")
    attachments = [
        (OBJECT_ATTACHMENT, "application/toml", request["object_toml"].encode()),
        (PLAN_ATTACHMENT, "application/json", request["plan_json"].encode()),
        (RIG_ATTACHMENT, "application/toml", rig_toml.encode()),
    ]
    if shape is not None:
        attachments.append(
            (SHAPE_ATTACHMENT_PREFIX + Path(request["shape_name"]).name, "application/octet-stream", shape)
        )
    return SessionFiles(spec, digest, sha256_text(request["plan_json"]), tuple(attachments))


def session_manifest(
    config: RigConfig, camera: OpenCamera, files: SessionFiles, anchor_ns: int
) -> SessionManifest:
    """Manifest (description) of a session that begins now, with a new random recording id.

    Args:
        config: the rig: camera, striker, gravity.
        camera: identity of the camera, and whether frame times come from its own clock.
        files: object, plan and attachments.
        anchor_ns: wall clock (Unix time) minus host monotonic time [ns].
    """
    return SessionManifest(
        recording_id=str(uuid.uuid4()),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        software=software_version(),
        wall_anchor_ns=anchor_ns,
        time_source=TimeSource.DEVICE_MAPPED if camera.clock_latched else TimeSource.HOST_ARRIVAL,
        time_source_sd_ns=MAPPING_SD_NS if camera.clock_latched else ARRIVAL_SD_NS,
        g_m_s2=config.g_m_s2,
        g_sd_m_s2=config.g_sd_m_s2,
        gravity_tilt_sd_rad=config.gravity_tilt_sd_rad,
        level=config.level,
        cameras=[
            ManifestCamera(
                name=config.camera.name,
                vendor=camera.info.vendor,
                model=camera.info.model,
                serial=camera.info.serial,
                frame_rate_hz=config.camera.frame_rate_hz,
                exposure_us=config.camera.exposure_us,
                calibration=config.camera.calibration,
            )
        ],
        striker=config.striker.model_dump(mode="json"),
        rig={"name": config.name},
        object=files.spec,
        object_sha256=files.object_sha256,
        plan_sha256=files.plan_sha256,
        hashes=files.hashes,
    )
