"""The V4L2 client against a virtual webcam: real open, ioctl, mmap and poll through the kernel's FUSE."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from acquire.camera import v4l2_abi as abi
from acquire.camera.factory import make_camera
from acquire.camera.v4l2 import V4l2Camera
from acquire.camera.v4l2_device import V4l2Device
from acquire.camera.v4l2_discovery import list_v4l2_cameras
from acquire.camera.v4l2_stamp import stamped_instant
from acquire.clock.clock import SystemClock
from acquire.errors import CameraError, CameraLost, CameraNotFound, CameraSettingError
from acquire.frames.frame import Frame
from schemas.rig import CameraConfig
from tests.acquire.camera.video_device import pattern_video
from tests.acquire.virtual.pattern_source import noise, read_stamp, stamped

SEED = 7
MONOTONIC_START = abi.TIMESTAMP_MONOTONIC | abi.STAMP_START_OF_EXPOSURE


@pytest.fixture
def video_config(camera_config: Callable[..., CameraConfig], tmp_path: Path) -> Callable[..., CameraConfig]:
    def make(**changes: object) -> CameraConfig:
        return camera_config(str(tmp_path / "video0"), kind="v4l2", **changes)

    return make


@pytest.fixture
def webcam(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    with pattern_video(tmp_path / "video0") as process:
        yield process


def next_frame(camera: V4l2Camera) -> Frame:
    frame = camera.read(20.0)
    assert frame is not None
    return frame


def read_for_ever(camera: V4l2Camera) -> None:
    while True:
        frame = camera.read(0.2)
        if frame is not None:
            frame.buffer.release()


def opened(config: CameraConfig) -> V4l2Camera:
    camera = make_camera(config, SystemClock(), 4)
    assert isinstance(camera, V4l2Camera)
    camera.open()
    return camera


def test_frames_are_byte_exact_periodic_and_none_is_lost(webcam, video_config) -> None:
    pattern = noise(656, 492, SEED)
    camera = opened(video_config())
    assert camera.warnings == ()
    camera.start()
    last_ns = 0
    for number in range(120):
        frame = next_frame(camera)
        start_ns, drawn = read_stamp(frame.image)
        assert (drawn, frame.sequence, frame.frame_id, frame.lost_before) == (number, number, number, 0)
        assert np.array_equal(frame.image, stamped(pattern, start_ns, drawn))
        assert 0 <= start_ns - frame.device_time_ns < 1000  # stamps are whole microseconds
        assert number == 0 or frame.device_time_ns - last_ns == pytest.approx(1e9 / 120, abs=2000)
        last_ns = frame.device_time_ns
        assert frame.host_time_ns > start_ns + 1_500_000
        frame.buffer.release()
    camera.stop()
    camera.close()


@pytest.mark.parametrize(("pixel_format", "largest_error"), [("YUYV", 0), ("MJPG", 60)])
def test_other_formats_become_grey(webcam, video_config, pixel_format: str, largest_error: int) -> None:
    camera = opened(video_config(pixel_format=pixel_format))
    camera.start()
    frame = next_frame(camera)
    expected = stamped(noise(656, 492, SEED), 0, 0)[100:, 100:].astype(int)
    error = np.abs(frame.image[100:, 100:].astype(int) - expected)
    assert error.max() <= largest_error
    assert error.mean() <= largest_error / 10
    camera.close()


def test_a_camera_left_with_everything_automatic_is_set(webcam, video_config) -> None:
    config = video_config(exposure_us=2000.0, gain_raw=40)
    camera = opened(config)
    camera.close()
    device = V4l2Device(config.address)
    values = {
        control: device.control(control)
        for control in (
            abi.CID_EXPOSURE_AUTO,
            abi.CID_EXPOSURE_AUTO_PRIORITY,
            abi.CID_AUTO_WHITE_BALANCE,
            abi.CID_BACKLIGHT_COMPENSATION,
            abi.CID_EXPOSURE_ABSOLUTE,
            abi.CID_GAIN,
        )
    }
    device.close()
    assert list(values.values()) == [abi.EXPOSURE_MANUAL, 0, 0, 0, 20, 40]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 640}, r"640 x 492 px were written, 656 x 492 read back: write a size"),
        ({"frame_rate_hz": 100.0}, r"frame rate = 100 Hz was written, .* read back: write a rate"),
        ({"exposure_us": 10.0}, r"exposure = 10 us is outside its range, 100 to 500000 us: correct"),
        ({"gain_db": 0.0}, r"counts its gain in steps, 16 to 255: write gain_raw = 16"),
        ({"gain_raw": 3}, r"gain = 3 steps is outside its range, 16 to 255"),
    ],
)
def test_settings_that_the_camera_does_not_take_are_refused(
    webcam, video_config, changes: dict[str, object], said: str
) -> None:
    with pytest.raises(CameraSettingError, match=said):
        opened(video_config(**changes))


def test_a_missing_format_is_refused_with_one_that_is_there(tmp_path, video_config) -> None:
    with (
        pattern_video(tmp_path / "video0", "MJPG"),
        pytest.raises(
            CameraSettingError, match=r'GREY is not offered, but MJPG: write pixel_format = "MJPG"'
        ),
    ):
        opened(video_config())


def test_a_second_program_is_told_that_the_camera_is_in_use(webcam, video_config) -> None:
    first = opened(video_config())
    first.start()
    with pytest.raises(CameraError, match="used by another program: close that program"):
        opened(video_config())
    next_frame(first)
    first.close()
    opened(video_config()).close()


def test_an_absent_device_and_one_that_is_none(tmp_path, video_config) -> None:
    with pytest.raises(CameraNotFound, match="check its cable"):
        opened(video_config())
    (tmp_path / "video0").write_text("a file")
    with pytest.raises(CameraError, match="is no video device"):
        opened(video_config())


def test_an_unplugged_camera_is_lost_and_comes_back(tmp_path, video_config) -> None:
    config = video_config()
    with pattern_video(tmp_path / "video0") as process:
        camera = opened(config)
        camera.start()
        next_frame(camera)
        process.kill()
        process.wait()
        began = time.monotonic()
        with pytest.raises(CameraLost, match="check its cable, then connect again"):
            read_for_ever(camera)
        assert time.monotonic() - began < 2.0
        camera.close()
    with pattern_video(tmp_path / "video0"):
        camera = opened(config)
        camera.start()
        assert next_frame(camera).sequence == 0
        camera.close()


def test_frames_lost_in_the_driver_are_counted_by_their_numbers(webcam, video_config) -> None:
    camera = opened(video_config(buffers=8))
    camera.start()
    first = next_frame(camera)
    first.buffer.release()
    time.sleep(0.3)  # 36 frames, for which the driver has 8 buffers
    seen = [next_frame(camera) for _ in range(8)]
    for frame in seen:
        frame.buffer.release()
    numbers = [first, *seen, next_frame(camera)]
    assert sum(frame.lost_before for frame in numbers) > 10
    assert numbers[-1].frame_id == numbers[-1].sequence + sum(frame.lost_before for frame in numbers)
    camera.close()


@pytest.mark.parametrize("instant", ["start", "end"])
def test_the_middle_rows_exposure_is_found_from_either_stamp(tmp_path, video_config, instant: str) -> None:
    readout_ns, line_time_s = 4_910_000, 1e-5
    plain = video_config()
    calibration = plain.calibration.model_copy(update={"line_time_s": line_time_s})
    config = video_config(calibration=calibration)
    with pattern_video(tmp_path / "video0", "GREY", instant, str(readout_ns)):
        camera = opened(config)
        assert bool(camera.warnings) == (instant == "end")
        camera.start()
        frame = next_frame(camera)
        drawn_ns, _ = read_stamp(frame.image)
        assert abs(frame.device_time_ns - drawn_ns) < 2000
        camera.close()


def test_a_webcams_stamp_is_its_first_packet_unless_the_driver_works_it_out(video_config, tmp_path) -> None:
    config, option = video_config(), tmp_path / "hwtimestamps"
    plain = stamped_instant("uvcvideo", MONOTONIC_START, config, 1500.0, option)
    assert plain.start_offset_ns == -1_500_000
    assert "first packet" in plain.warning
    assert "8.3 ms" in plain.warning
    option.write_text("1\n")
    worked_out = stamped_instant("uvcvideo", MONOTONIC_START, config, 1500.0, option)
    assert (worked_out.start_offset_ns, worked_out.warning) == (0, "")
    option.write_text("0\n")
    assert stamped_instant("uvcvideo", MONOTONIC_START, config, 1500.0, option) == plain


def test_a_measured_instant_goes_before_the_drivers_statement(video_config, tmp_path) -> None:
    config = video_config(timestamp_at="exposure_end")
    found = stamped_instant("uvcvideo", MONOTONIC_START, config, 1500.0, tmp_path / "none")
    assert (found.start_offset_ns, found.warning) == (0, "")  # the stream takes off half of the exposure


def test_a_driver_without_monotonic_stamps_leaves_the_times_of_arrival(video_config) -> None:
    found = stamped_instant("loopback", 0x4000, video_config(), 1500.0)
    assert not found.monotonic
    assert "from their arrival" in found.warning


def test_discovery_lists_cameras_and_nothing_else(webcam, tmp_path) -> None:
    (tmp_path / "video1").write_text("a file")
    lasting = tmp_path / "v4l" / "by-id"
    lasting.mkdir(parents=True)
    (lasting / "usb-virtual").symlink_to(tmp_path / "video0")
    (found,) = list_v4l2_cameras(tmp_path)
    assert (found.model, found.kind) == ("Virtual webcam", "v4l2")
    assert found.address == str(lasting / "usb-virtual")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"trigger": "Line1"}, "has no trigger input"),
        ({"offset_x": 8}, "gives whole images"),
        ({"kind": "gige", "pixel_format": "MJPG"}, "write Mono8"),
    ],
)
def test_what_a_kind_cannot_do_is_refused_in_the_rig_file(camera_config, changes, said) -> None:
    with pytest.raises(ValueError, match=said):
        camera_config("/dev/video0", **{"kind": "v4l2", **changes})


HEADER = """
#include <linux/videodev2.h>
#include <stddef.h>
#include <stdio.h>
int main(void) {
  unsigned long requests[] = {VIDIOC_QUERYCAP, VIDIOC_ENUM_FMT, VIDIOC_G_FMT, VIDIOC_S_FMT, VIDIOC_REQBUFS,
    VIDIOC_QUERYBUF, VIDIOC_QBUF, VIDIOC_DQBUF, VIDIOC_STREAMON, VIDIOC_STREAMOFF, VIDIOC_G_PARM,
    VIDIOC_S_PARM, VIDIOC_G_CTRL, VIDIOC_S_CTRL, VIDIOC_QUERYCTRL,
    V4L2_CID_AUTO_WHITE_BALANCE, V4L2_CID_EXPOSURE, V4L2_CID_AUTOGAIN, V4L2_CID_GAIN, V4L2_CID_HFLIP,
    V4L2_CID_VFLIP, V4L2_CID_BACKLIGHT_COMPENSATION, V4L2_CID_EXPOSURE_AUTO, V4L2_CID_EXPOSURE_ABSOLUTE,
    V4L2_CID_EXPOSURE_AUTO_PRIORITY, V4L2_CID_FOCUS_AUTO, V4L2_CAP_VIDEO_CAPTURE,
    V4L2_CAP_VIDEO_CAPTURE_MPLANE, V4L2_CAP_META_CAPTURE, V4L2_CAP_STREAMING,
    V4L2_CAP_DEVICE_CAPS, V4L2_BUF_FLAG_ERROR,
    V4L2_BUF_FLAG_TIMESTAMP_MASK, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, V4L2_BUF_FLAG_TSTAMP_SRC_MASK,
    V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
    offsetof(struct v4l2_format, fmt.pix.bytesperline),
    offsetof(struct v4l2_streamparm, parm.capture.timeperframe),
    offsetof(struct v4l2_buffer, timestamp), offsetof(struct v4l2_buffer, sequence),
    offsetof(struct v4l2_buffer, m), offsetof(struct v4l2_buffer, length),
    offsetof(struct v4l2_capability, device_caps), offsetof(struct v4l2_fmtdesc, pixelformat),
    offsetof(struct v4l2_queryctrl, flags)};
  for (unsigned i = 0; i < sizeof requests / sizeof *requests; i++) printf("%lu ", requests[i]);
}
"""

NAMES = """QUERYCAP ENUM_FMT G_FMT S_FMT REQBUFS QUERYBUF QBUF DQBUF STREAMON STREAMOFF G_PARM S_PARM G_CTRL
S_CTRL QUERYCTRL CID_AUTO_WHITE_BALANCE CID_EXPOSURE CID_AUTOGAIN CID_GAIN CID_HFLIP CID_VFLIP
CID_BACKLIGHT_COMPENSATION CID_EXPOSURE_AUTO CID_EXPOSURE_ABSOLUTE CID_EXPOSURE_AUTO_PRIORITY CID_FOCUS_AUTO
CAP_VIDEO_CAPTURE CAP_VIDEO_CAPTURE_MPLANE CAP_META_CAPTURE CAP_STREAMING CAP_DEVICE_CAPS BUF_ERROR
TIMESTAMP_MASK TIMESTAMP_MONOTONIC STAMP_SOURCE_MASK STAMP_START_OF_EXPOSURE"""


def test_numbers_and_layouts_are_those_of_the_kernels_header(tmp_path) -> None:
    compiler = shutil.which("gcc")
    if (
        compiler is None
        or not Path("/usr/include/linux/videodev2.h").exists()
        or ctypes.sizeof(ctypes.c_void_p) != 8
    ):
        pytest.skip("needs gcc and the kernel's headers on a 64-bit system")
    source, program = tmp_path / "header.c", tmp_path / "header"
    source.write_text(HEADER)
    subprocess.run([compiler, str(source), "-o", str(program)], check=True)
    done = subprocess.run([str(program)], check=True, capture_output=True, text=True)
    names = NAMES.split()
    offsets = [
        abi.ImageFormat.bytesperline.offset,
        abi.StreamParameters.numerator.offset,
        abi.Buffer.seconds.offset,
        abi.Buffer.sequence.offset,
        abi.Buffer.offset.offset,
        abi.Buffer.length.offset,
        abi.Capability.device_caps.offset,
        abi.FormatDescription.pixelformat.offset,
        abi.ControlRange.flags.offset,
    ]
    assert [int(number) for number in done.stdout.split()] == [getattr(abi, name) for name in names] + offsets


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_no_frame_is_lost_in_a_minute_at_the_rigs_rate(webcam, video_config) -> None:
    camera = opened(video_config(buffers=32))
    camera.start()
    end, frames, lost = time.monotonic() + 60.0, 0, 0
    while time.monotonic() < end:
        frame = next_frame(camera)
        frames, lost = frames + 1, lost + frame.lost_before
        frame.buffer.release()
    camera.close()
    assert frames > 120 * 59
    assert lost == 0
