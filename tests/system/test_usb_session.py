"""A session seen by a webcam or a USB3 Vision camera, through the daemon and the real clients."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.virtual.device_kinds import DeviceKinds
from acquire.virtual.truth import merge_truth
from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from schemas.camera_kind import CameraKindName
from schemas.session_manifest import TimeSource
from tests.system.session_rig import session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]
NEEDS_FUSE = pytest.mark.skipif(
    os.getuid() != 0 or not Path("/dev/fuse").exists(), reason="needs root and the kernel's FUSE"
)


@pytest.mark.parametrize(
    ("kind", "model"), [pytest.param("v4l2", "Virtual webcam", marks=NEEDS_FUSE), ("usb3", "USB3-656")]
)
def test_a_session_of_three_strikes_from_the_first_to_the_answer(kind: CameraKindName, model: str) -> None:
    with session_rig(kinds=DeviceKinds(camera=kind)) as rig:
        report = rig.session(lambda text, _done, _total: rig.said.append(text))
        assert not report.aborted, rig.said
        assert report.lost == 0, rig.said
        merge_truth(report.path, Path(rig.world().truth()))
        truth = read_truth(report.path)
        with open_recording(report.path) as recording:
            assert recording.manifest.time_source is TimeSource.DEVICE_MAPPED
            assert recording.manifest.cameras[0].model == model
            assert len([record for record in recording.strikes if record.verdict_code == "good"]) >= 3
        done = CliRunner().invoke(analyze, ["estimate", str(report.path), "--json"], catch_exceptions=False)
        assert done.exit_code == 0, done.stderr
        answer = json.loads(done.stdout)
        assert math.dist(answer["centre_of_mass"]["value"], truth.body.com_object) < 0.002
