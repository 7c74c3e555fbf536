"""Which instant of a frame a camera stamps: measured on virtual cameras of both habits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from acquire.camera.aravis import AravisCamera
from acquire.camera.base import Camera
from acquire.camera.factory import make_camera
from acquire.clock.clock import SystemClock
from acquire.errors import CameraSettingError
from acquire.preflight.check import Outcome
from acquire.preflight.stamps import check_stamp, measure_stamp
from acquire.virtual.camera_makes import MAKES
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_faults import CameraHabits
from schemas.rig import CameraConfig
from tests.acquire.camera.video_device import pattern_video
from tests.acquire.capture.synthetic_rig import CALIBRATION
from tests.acquire.preflight.bench import Bench
from tests.acquire.virtual.pattern_source import PatternSource
from tests.loopback import loopback

TRIES = 5
"""measurements on a busy computer, as often as the remedy of the check may be followed"""


def measured(make_camera: Callable[[CameraConfig], Camera], config: CameraConfig, slope: float) -> float:
    """First of TRIES measured slopes that is near the expected one; otherwise the last."""
    found = float("nan")
    for _ in range(TRIES):
        found = measure_stamp(make_camera, config)
        assert found is not None
        if abs(found - slope) < 0.2:
            break
    return found


@pytest.mark.parametrize(("make", "slope"), [("alvium-g1", 1.0), ("blackfly-s", 0.0)])
def test_the_instant_is_found_out(make: str, slope: float) -> None:
    clock = SystemClock()
    address = loopback(53)
    server = VirtualGigeCamera(
        address, "STAMP", PatternSource(clock, 1), clock, habits=CameraHabits(make=MAKES[make])
    )
    try:
        config = CameraConfig(address=address, buffers=16, calibration=CALIBRATION)
        found = measured(lambda each: AravisCamera(each, clock), config, slope)
    finally:
        server.close()
    assert found == pytest.approx(slope, abs=0.2)


@pytest.mark.parametrize(
    ("stamp", "stated", "outcome", "text"),
    [
        (1.01, "exposure_start", Outcome.PASS, "start of the exposure, as stated"),
        (1.01, "trigger", Outcome.PASS, "start of the exposure, as stated"),
        (0.02, "exposure_end", Outcome.PASS, "end of the exposure, as stated"),
        (0.02, "exposure_start", Outcome.FAIL, "frame times are off by 1.5 ms"),
        (1.0, "exposure_end", Outcome.FAIL, "frame times are off by 1.5 ms"),
        (0.5, "exposure_start", Outcome.FAIL, "neither start nor end"),
        (-2.0, "exposure_start", Outcome.FAIL, "neither start nor end"),
        (1.9, "exposure_end", Outcome.FAIL, "neither start nor end"),
        (None, "exposure_start", Outcome.NOT_CHECKED, "clock cannot be read"),
        (float("nan"), "exposure_start", Outcome.NOT_CHECKED, "too unevenly"),
        (CameraSettingError("exposure"), "exposure_start", Outcome.NOT_CHECKED, "two exposures"),
    ],
)
def test_it_is_compared_with_the_rig_file(
    bench: Bench, stamp: float | Exception | None, stated: str, outcome: Outcome, text: str
) -> None:
    toml = bench.rig_path.read_text(encoding="utf-8")
    bench.rig_path.write_text(
        toml.replace("[camera]", f'[camera]\ntimestamp_at = "{stated}"'), encoding="utf-8"
    )
    bench.stamp = stamp
    line = bench.lines()["frame times"]
    assert line.outcome is outcome
    assert text in line.found


@pytest.mark.parametrize("instant", ["start", "end"])
def test_a_webcams_instant_is_measured_whatever_its_driver_states(tmp_path: Path, instant: str) -> None:
    clock = SystemClock()
    with pattern_video(tmp_path / "video0", "GREY", instant):
        plain = CameraConfig(
            kind="v4l2", address=str(tmp_path / "video0"), buffers=16, calibration=CALIBRATION
        )
        usual = 1.0 if instant == "start" else 0.0
        slope = measured(lambda each: make_camera(each, clock), plain, usual)
    assert slope == pytest.approx(usual, abs=0.2)
    unstated = check_stamp(lambda _: slope, plain)
    assert unstated.remedy.startswith(f'write timestamp_at = "exposure_{instant}"')
    stated = plain.model_copy(update={"timestamp_at": f"exposure_{instant}"})
    assert check_stamp(lambda _: slope, stated).outcome is Outcome.PASS
