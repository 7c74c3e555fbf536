"""Manifest (description of the session) of an imported recording, and the files attached to it."""

from __future__ import annotations

import hashlib
import uuid
from datetime import UTC, datetime
from pathlib import Path

from analyze.importing.prepared_import import PreparedImport
from schemas.document import sha256_text
from schemas.rig import RigConfig
from schemas.session_manifest import (
    OBJECT_ATTACHMENT,
    PLAN_ATTACHMENT,
    SHAPE_ATTACHMENT_PREFIX,
    ManifestCamera,
    SessionManifest,
    TimeSource,
)
from schemas.software import software_version

CAMERA = "main"
CAMERA_ATTACHMENT_PREFIX = "camera/"


def manifest(prepared: PreparedImport, anchor_ns: int) -> SessionManifest:
    """Manifest (description of the session) of an imported recording.

    Its date of creation is that of the first source's images; if the source states none, the present time.

    Args:
        prepared: the import.
        anchor_ns: log time of the first source's start [ns since 1970].
    """
    known = prepared.all_sources[0].wall_start_ns is not None
    created = datetime.fromtimestamp(anchor_ns * 1e-9, UTC) if known else datetime.now(UTC)
    kinds = {source.time_source for source in prepared.all_sources}
    rig, usual = prepared.camera.rig, RigConfig.model_fields
    files = prepared.object
    return SessionManifest(
        recording_id=str(uuid.uuid4()),
        created=created.isoformat(timespec="seconds"),
        software=software_version(),
        wall_anchor_ns=anchor_ns,
        time_source=kinds.pop() if len(kinds) == 1 else TimeSource.CONTAINER_PTS,
        time_source_sd_ns=max(source.time_sd_ns for source in prepared.all_sources),
        g_m_s2=usual["g_m_s2"].default if rig is None else rig.g_m_s2,
        g_sd_m_s2=usual["g_sd_m_s2"].default if rig is None else rig.g_sd_m_s2,
        gravity_tilt_sd_rad=usual["gravity_tilt_sd_rad"].default if rig is None else rig.gravity_tilt_sd_rad,
        level=None if rig is None else rig.level,
        cameras=[_camera(prepared)],
        object=files.spec,
        object_sha256=files.sha256,
        plan_sha256=sha256_text(prepared.plan_text),
        hashes={name: hashlib.sha256(data).hexdigest() for name, _, data in attachments(prepared)},
    )


def _camera(prepared: PreparedImport) -> ManifestCamera:
    """Manifest entry of the camera: name, calibration, frame rate [Hz] and that rate's standard deviation."""
    sd = prepared.options.rate_sd_hz
    return ManifestCamera(
        name=CAMERA, frame_rate_hz=prepared.rate_hz, frame_rate_sd_hz=sd, calibration=prepared.calibration
    )


def attachments(prepared: PreparedImport) -> list[tuple[str, str, bytes]]:
    """Name, media type and content of each file attached to the recording.

    These are the object file, the plan, the camera file and, if there is one, the shape file.
    """
    files = prepared.object
    found = [
        (OBJECT_ATTACHMENT, "application/toml", prepared.object_text.encode()),
        (PLAN_ATTACHMENT, "application/json", prepared.plan_text.encode()),
        (CAMERA_ATTACHMENT_PREFIX + prepared.camera.file_name, "text/plain", prepared.camera.content()),
    ]
    if files.shape_bytes is not None:
        name = SHAPE_ATTACHMENT_PREFIX + Path(files.shape_name).name
        found.append((name, "application/octet-stream", files.shape_bytes))
    return found
