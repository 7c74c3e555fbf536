"""Videos and image folders as sources: times, sizes, missing frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from analyze.errors import ImportRefused
from analyze.sources.open_source import SourceOptions, open_source
from analyze.sources.video import VideoSource
from tests.analyze.importing.tip_videos import HEIGHT, RATE, WIDTH, tip, write_video

MS = 1_000_000


def _times(source) -> list[int]:
    return [frame.time_ns for frame in source.frames()]


def test_variable_frame_times_are_kept(tmp_path):
    gaps = np.random.default_rng(1).integers(7000, 10000, 39)
    times = [0, *np.cumsum(gaps).tolist()]
    source = VideoSource(write_video(tmp_path / "a.mp4", tip()[:40], times, bf="3"))
    assert _times(source) == [1000 * time for time in times]
    assert source.time_sd_ns == round(1000 / 12**0.5)
    assert source.remarks == ()


def test_metadata_in_no_known_encoding_does_not_matter(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:20], range(0, 20 * 8333, 8333))
    data = path.read_bytes()
    assert data.count(b"VideoHandler") == 1
    path.write_bytes(data.replace(b"VideoHandler", b"Video\xff\xfe\xa7dler"))
    assert len(_times(VideoSource(path))) == 20


def test_slow_motion_is_corrected(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:20], range(0, 20 * 33_333, 33_333))
    source = VideoSource(path, capture_hz=240)
    assert np.diff(_times(source)) == pytest.approx(1e9 / 240, rel=1e-4)
    assert source.timing.interval_s == pytest.approx(1 / 240, rel=1e-4)


def test_constant_rate_with_millisecond_stamps_is_straightened(tmp_path):
    source = VideoSource(
        write_video(tmp_path / "a.mkv", tip()[:60], [round(number * 1e6 / RATE) for number in range(60)])
    )
    assert np.diff(_times(source)) == pytest.approx(1e9 / RATE, abs=2)
    assert source.time_sd_ns == 1


def test_variable_millisecond_stamps_are_kept(tmp_path):
    times = [0, *np.cumsum(np.random.default_rng(1).integers(6, 13, 59)).tolist()]
    source = VideoSource(write_video(tmp_path / "a.mkv", tip()[:60], [1000 * time for time in times]))
    assert _times(source) == [MS * time for time in times]
    assert source.time_sd_ns == 288675


def test_range_yields_the_same_frames_as_the_whole(tmp_path):
    path = write_video(tmp_path / "a.mkv", tip()[:60], codec="libx264", g="12", bf="2")
    source = VideoSource(path)
    every = [(frame.time_ns, frame.image.copy()) for frame in source.frames()]
    some = [(frame.time_ns, frame.image.copy()) for frame in source.frames(every[30][0], every[40][0])]
    assert [time for time, _ in some] == [time for time, _ in every[30:41]]
    assert all(np.array_equal(one[1], other[1]) for one, other in zip(some, every[30:41], strict=True))


@pytest.mark.parametrize(
    ("codec", "pixels", "suffix"),
    [("ffv1", "gray", ".mkv"), ("ffv1", "rgb24", ".mkv"), ("ffv1", "yuv420p10le", ".mkv")],
)
def test_lossless_codecs_yield_the_original_images(tmp_path, codec, pixels, suffix):
    if pixels == "rgb24":
        codec, suffix = "png", ".mov"
    source = VideoSource(write_video(tmp_path / f"a{suffix}", tip()[:5], codec=codec, pixels=pixels))
    for frame, image in zip(source.frames(), tip(), strict=False):
        # A conversion between luma and RGB or 10 bits rounds, and stretches studio range.
        assert np.abs(frame.image.astype(int) - image).max() <= (0 if pixels == "gray" else 12)


def test_rotated_video_is_read_in_sensor_orientation(tmp_path):
    source = VideoSource(write_video(tmp_path / "a.mp4", tip()[:5], turned=90))
    assert (source.width, source.height) == (WIDTH, HEIGHT)
    assert next(source.frames()).image.shape == (HEIGHT, WIDTH)
    [remark] = source.remarks
    assert "rotated by" in remark
    assert "320 x 240" in remark


def test_cut_file_is_read_up_to_its_end(tmp_path):
    whole = write_video(tmp_path / "a.mkv", tip()[:60], codec="ffv1", pixels="gray")
    part = tmp_path / "part.mkv"
    part.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    source = VideoSource(part)
    assert 10 < len(_times(source)) < 55
    assert any("cut short" in remark or "cannot be decoded" in remark for remark in source.remarks)


def test_an_mp4_without_its_index_is_refused_in_one_line(tmp_path):
    whole = write_video(tmp_path / "a.mp4", tip()[:20])
    part = tmp_path / "part.mp4"
    part.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    with pytest.raises(ImportRefused, match="cut short has no index") as caught:
        VideoSource(part)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["nothing.mp4", "text.mp4"])
def test_file_that_is_no_video_is_refused(tmp_path, name):
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(ImportRefused):
        open_source(tmp_path / name, SourceOptions())


def test_a_folder_without_times_is_refused(tmp_path):
    (tmp_path / "images").mkdir()
    with pytest.raises(ImportRefused, match="name,time_s"):
        open_source(tmp_path / "images", SourceOptions())


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        (1000, "its images come every 8.33 s by the column time_s: if they are in ms, rename"),
        (0, "two images have the same"),
    ],
)
def test_csv_times_not_in_seconds_are_refused(tmp_path, unit, said):
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), tip()[0])
    rows = [f"{number}.png,{number * unit / RATE:.6f}" for number in range(4)]
    (tmp_path / "times.csv").write_text("\n".join(["name,time_s", *rows]))
    with pytest.raises(ImportRefused, match=said):
        open_source(tmp_path, SourceOptions())


@pytest.mark.parametrize("content", [b"", b"These are words and no film."])
def test_file_that_is_no_mp4_is_not_called_cut(tmp_path, content):
    (tmp_path / "a.mp4").write_bytes(content)
    with pytest.raises(ImportRefused, match="not a readable video") as caught:
        VideoSource(tmp_path / "a.mp4")
    assert "cut short" not in str(caught.value)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["Time_s, Name", "0, 0.png", "0.01, 1.png"], None),
        (["name,time_s", "0.png,0", ",0.01"], "line 3: names no image"),
        (["name,time_s", "0.png,0", "0.png,0.01"], "0.png 2 times: each has one time"),
    ],
)
def test_csv_in_usual_variants(tmp_path, rows, said):
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), tip()[0])
    (tmp_path / "times.csv").write_text("\n".join(rows))
    if said is None:
        source = open_source(tmp_path, SourceOptions())
        assert [image.time_ns for image in source.frames()] == [0, 10_000_000]
        return
    with pytest.raises(ImportRefused, match=said):
        open_source(tmp_path, SourceOptions())


@pytest.mark.parametrize("blanks", ["", "   "])
def test_decimals_of_the_csv_times_give_their_sd(tmp_path, blanks):
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), tip()[0])
    (tmp_path / "times.csv").write_text(f"name,time_s\n0.png,0.000{blanks}\n1.png,0.010{blanks}\n")
    assert open_source(tmp_path, SourceOptions()).time_sd_ns == 288675


def test_images_that_the_csv_omits_are_reported(tmp_path):
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), tip()[0])
    (tmp_path / "times.csv").write_text("name,time_s\n0.png,0\n./1.png,0.01\n2.png,0.02\n")
    source = open_source(tmp_path, SourceOptions())
    assert source.remarks == (f"{tmp_path.name}: left out 1 of 4 images: not in times.csv",)
    (tmp_path / "3.png").unlink()
    source = open_source(tmp_path, SourceOptions())
    assert source.remarks == ()


def test_video_of_a_single_frame_is_refused(tmp_path):
    path = Path(write_video(tmp_path / "a.mkv", tip()[:1]))
    with pytest.raises(ImportRefused, match="fewer than two frames"):
        VideoSource(path)


@pytest.mark.parametrize("delays", [[1, 3], [2, 3], [3, 3, 4], [6, 6, 6, 1, 11]])
def test_gif_with_uneven_delays_has_their_times(tmp_path, delays):
    """Its hundredths of a second are too coarse for the mean rate that FFmpeg states; its end is held."""
    random = np.random.default_rng(0)
    steps = np.array([*(delays * 12)[:-1], 200])
    images = [Image.fromarray(random.integers(0, 255, (48, 64), dtype=np.uint8)) for _ in steps]
    path = tmp_path / "tip.gif"
    images[0].save(path, save_all=True, append_images=images[1:], duration=[int(10 * each) for each in steps])
    source = VideoSource(path)
    times = [frame.time_ns for frame in source.frames()]
    assert np.array_equal(times, 10**7 * np.concatenate([[0], np.cumsum(steps[:-1])]))
    assert not any("cut short" in remark for remark in source.remarks)
