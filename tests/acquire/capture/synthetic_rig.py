"""A capture process with a synthetic camera: rig file, manifest, environment, and what it recorded."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader

from acquire.clock.clock import SystemClock
from schemas.proto import percuss_pb2 as pb
from schemas.rig import CameraConfig, RecorderConfig, RigConfig
from schemas.session_manifest import CameraCalibrationSpec, ManifestCamera, SessionManifest
from tests import small_recording

COMMAND = (sys.executable, str(Path(__file__).parents[1] / "synthetic_camera.py"))
CALIBRATION = CameraCalibrationSpec(
    width=64, height=48, K=[[100, 0, 32], [0, 100, 24], [0, 0, 1]], T_world_camera=np.eye(4).tolist()
)
RATE = 120.0
LARGE = CALIBRATION.model_copy(update={"width": 111, "height": 83})
"""calibration with images of 9213 bytes: two pages and a piece, so that a continuous recording writes frames
from the camera's buffers"""


def rig(address: str = "synthetic", *, large: bool = False, **recorder: object) -> RigConfig:
    calibration = LARGE if large else CALIBRATION
    camera = CameraConfig(
        address=address,
        width=calibration.width,
        height=calibration.height,
        frame_rate_hz=RATE,
        calibration=calibration,
    )
    return RigConfig(
        camera=camera, recorder=RecorderConfig.model_validate({"disk_reserve_bytes": 0, **recorder})
    )


def manifest_of_a_box() -> SessionManifest:
    """Manifest of a small recording of a box, with the synthetic camera and the current time."""
    clock = SystemClock()
    return small_recording.manifest(
        recording_id="test",
        hashes={},
        wall_anchor_ns=clock.wall_ns() - clock.monotonic_ns(),
        cameras=[ManifestCamera(name="main", frame_rate_hz=RATE, exposure_us=1500, calibration=CALIBRATION)],
    )


def read(path: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append(message)
    return found


def frame_number(message) -> int:
    """Frame number that the synthetic camera drew into an image."""
    data = RawImage.FromString(message.data).data
    assert data[4:8] != b"\xaa\xaa\xaa\xaa", "the image was read after its buffer was released"
    return int(np.frombuffer(data[:4], np.uint32)[0])


def check_times(messages: list[Any], anchor_ns: int) -> None:
    for message in messages:
        meta = pb.FrameMeta.FromString(message.data)
        assert message.log_time == anchor_ns + meta.mid_exposure_host_ns
        # The camera sends 2 ms after exposure began; mid-exposure was 1.25 ms before that.
        assert meta.host_time_ns - meta.mid_exposure_host_ns > 1_000_000
        assert 0 < meta.mapping_sd_ns < 1_000_000
