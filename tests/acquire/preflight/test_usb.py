"""The check of a USB camera's bandwidth, on folders made like the system's."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.preflight.check import Outcome
from acquire.preflight.usb import check_usb_bandwidth
from schemas.rig import CameraConfig
from tests.acquire.preflight.bench import RIG


@pytest.fixture
def port(tmp_path: Path) -> Path:
    """Folder of a USB device with one video device, video3."""
    usb = tmp_path / "usb" / "1-2"
    (usb / "1-2:1.0").mkdir(parents=True)
    (usb / "speed").write_text("480\n")
    (usb / "serial").write_text("23451234\n")
    video = tmp_path / "video" / "video3"
    video.mkdir(parents=True)
    (video / "device").symlink_to(usb / "1-2:1.0")
    return tmp_path


def camera(**changes: object) -> CameraConfig:
    import tomllib

    section = tomllib.loads(RIG.format(folder="/tmp"))["camera"]
    return CameraConfig.model_validate(section | {"kind": "v4l2", "address": "/dev/video3"} | changes)


@pytest.mark.parametrize(
    ("changes", "speed", "outcome"),
    [
        ({}, "480", Outcome.FAIL),  # 656 x 492 x 120 Hz: 39 MB/s
        ({"pixel_format": "MJPG"}, "480", Outcome.PASS),
        ({}, "5000", Outcome.PASS),
        ({"pixel_format": "YUYV", "frame_rate_hz": 1000.0}, "5000", Outcome.FAIL),
        ({"kind": "usb3", "address": "Basler-2676-23451234"}, "480", Outcome.FAIL),
        ({"kind": "usb3", "address": "Basler-2676-23451234"}, "5000", Outcome.PASS),
        ({"address": "/dev/video7"}, "5000", Outcome.NOT_CHECKED),
    ],
)
def test_what_a_port_carries(port: Path, changes: dict[str, object], speed: str, outcome: Outcome) -> None:
    (port / "usb" / "1-2" / "speed").write_text(speed)
    check = check_usb_bandwidth(camera(**changes), port / "video", port / "usb")
    assert check.outcome is outcome
    assert "MB/s" in check.found
    assert bool(check.remedy) == (outcome is Outcome.FAIL)
