"""Phone videos: slow motion that states its rate, edited speed, cameras held by hand, cuts."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.cameras.camera_file import read_camera
from analyze.errors import CalibrationError, ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.sources.open_source import SourceOptions
from analyze.sources.video import VideoSource
from tests.analyze.importing.tip_videos import RATE, REST, angles, picture, setting, tip, write_video

PLAYED_US = 33_333
STEP_US = 10**6 // RATE


def played(images, step_us=PLAYED_US):
    return range(0, step_us * len(images), step_us)


def refused(folder, path, placed=False, strikes=("s1",), **options) -> str:
    with pytest.raises(ImportRefused) as caught:
        prepare(ImportOptions((path,), *setting(folder, strikes, placed=placed), **options))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_slow_motion_with_stated_capture_rate_is_corrected(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:20], played(tip()[:20]), captured="240.000000")
    source = VideoSource(path)
    assert source.rate_hz == pytest.approx(240, rel=1e-4)
    assert np.diff([frame.time_ns for frame in source.frames()]) == pytest.approx(1e9 / 240, rel=1e-4)
    [remark] = source.remarks
    assert remark.startswith("a.mp4: plays at 30 frames a second and states that 240 were captured")


def test_given_capture_rate_wins_over_the_stated_one(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:20], played(tip()[:20]), captured="240.000000")
    source = VideoSource(path, capture_hz=120)
    assert source.rate_hz == pytest.approx(120, rel=1e-4)
    assert source.remarks == ("a.mp4: states that 240 frames a second were captured, not 120",)


@pytest.mark.parametrize("said", ["120.000000", "30.0", "nan", "-3", "fast", ""])
def test_capture_rate_that_is_the_playing_rate_or_invalid_changes_nothing(tmp_path, said):
    path = write_video(tmp_path / "a.mp4", tip()[:20], captured=said)
    source = VideoSource(path)
    assert source.rate_hz == pytest.approx(RATE, rel=1e-3)
    assert source.remarks == ()


def ramp(folder):
    """A video whose middle was slowed down, as phones export it."""
    images = [*[tip()[0]] * 60, *tip()]
    steps = [PLAYED_US if 40 <= number < 120 else STEP_US // 2 for number in range(len(images) - 1)]
    return write_video(folder / "ramp.mp4", images, [0, *np.cumsum(steps).tolist()])


def test_slowed_part_is_refused_with_a_capture_rate(tmp_path):
    said = refused(tmp_path, ramp(tmp_path), source=SourceOptions(capture_hz=240))
    assert "its frame rate is 240 a second in one part and 30 in another" in said
    assert "import the video as the camera recorded it" in said


def test_slowed_part_is_reported_without_a_capture_rate(tmp_path):
    with prepare(ImportOptions((ramp(tmp_path),), *setting(tmp_path))) as prepared:
        assert any(
            "240 a second in one part and 30 in another: if a slow-motion effect" in remark
            for remark in prepared.remarks()
        )


def test_frame_times_that_scatter_are_reported(tmp_path):
    random = np.random.default_rng(2)
    steps = np.arange(len(tip())) * STEP_US
    uneven = [round(each) for each in steps + 1000 + np.clip(random.normal(0, 900, len(steps)), -3000, 3000)]
    path = write_video(tmp_path / "a.mp4", tip(), uneven)
    with prepare(ImportOptions((path,), *setting(tmp_path))) as prepared:
        assert any("a.mp4: its frame times scatter by " in remark for remark in prepared.remarks())
    even = write_video(tmp_path / "b.mp4", tip())
    with prepare(ImportOptions((even,), *setting(tmp_path))) as prepared:
        assert not any("scatter" in remark for remark in prepared.remarks())


def test_low_frame_rate_asks_for_capture_fps_and_equal_remarks_appear_once(tmp_path):
    paths = [
        write_video(tmp_path / f"s{number}.mp4", tip(), played(tip()), turned=180) for number in (1, 2, 3)
    ]
    with prepare(ImportOptions(tuple(paths), *setting(tmp_path, ("s1", "s2", "s3")))) as prepared:
        few, turned = prepared.remarks()
    assert few.startswith(
        "30 frames per second are few for a strike: if this is slow motion, give the capture rate with "
        "--capture-fps"
    )
    assert turned.startswith("s1.mp4 and 2 more: is displayed rotated by 180 deg")


def test_one_capture_rate_for_different_playing_rates_is_reported(tmp_path):
    paths = (
        write_video(tmp_path / "s1.mp4", tip(), played(tip())),
        write_video(tmp_path / "s2.mp4", tip(), played(tip(), 2 * PLAYED_US)),
    )
    options = ImportOptions(paths, *setting(tmp_path, ("s1", "s2")), source=SourceOptions(capture_hz=RATE))
    with prepare(options) as prepared:
        assert (
            "s2.mp4: plays 15 frames per second, s1.mp4 30, but --capture-fps 120 applies to both: import "
            "videos" in " ".join(prepared.remarks())
        )


def test_handheld_camera_is_reported(tmp_path):
    swing = [picture(theta, (25 * np.sin(0.09 * number), 0.0)) for number, theta in enumerate(angles())]
    assert "is never at rest: put the camera on a stand" in refused(
        tmp_path, write_video(tmp_path / "a.mp4", swing)
    )


def test_video_that_begins_with_the_strike_is_reported(tmp_path):
    said = refused(tmp_path, write_video(tmp_path / "a.mp4", [*tip()[REST:], *[tip()[-1]] * 40]))
    assert (
        "no tag is at rest in view and then tips: record the whole tag, sharp, from a second before the "
        "strike" in said
    )


def test_cuts_and_setting_up_again_are_not_strikes(tmp_path):
    lying = [tip()[-1]] * RATE
    up = [picture(theta) for theta in np.linspace(np.pi / 2, 0, 50)]
    path = write_video(tmp_path / "a.mp4", [*tip(), *lying, *tip(), *lying, *up, *tip()], crf="10")
    with prepare(ImportOptions((path,), *setting(tmp_path, ("s1", "s2", "s3")))) as prepared:
        found = [
            window.onset.time_ns * 1e-9 * RATE for window in prepared.windows if window.onset is not None
        ]
    first, second = REST, len(tip()) + RATE + REST
    assert found == pytest.approx([first, second, second + len(tip()) + RATE + len(up)], abs=4)


def test_calibration_of_rotated_copy_or_photo_is_reported(tmp_path):
    turned = write_video(tmp_path / "a.mp4", [np.rot90(image) for image in tip()[:5]])
    assert "one of them was rotated when it was edited or shared" in refused(tmp_path, turned, placed=True)
    smaller = write_video(tmp_path / "b.mp4", [image[:120, :160] for image in tip()[:5]])
    assert "calibrate with a video of the strikes' camera mode, not with photos" in refused(
        tmp_path, smaller, placed=True
    )


@pytest.mark.parametrize(
    ("name", "said"),
    [("gone.toml", "no such camera file: check the path"), ("board.JPG", "is an image, not a camera file")],
)
def test_wrong_camera_file_is_refused_with_the_remedy(tmp_path, name, said):
    if name != "gone.toml":
        (tmp_path / name).write_bytes(b"\xff\xd8")
    with pytest.raises(CalibrationError, match=said) as caught:
        read_camera(tmp_path / name)
    assert "`analyze calibrate" in str(caught.value)
