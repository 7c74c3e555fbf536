"""Tables (CSV) of frame times for videos: columns, units, order, and the frames that they belong to."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.sources.open_source import OWN_TIMES, SourceOptions, open_source
from analyze.sources.times_table import read_times_table
from analyze.sources.video import VideoSource
from schemas.session_manifest import TimeSource
from tests.analyze.importing.tip_videos import tip, write_video

FRAMES = 12
GAPS_US = [8000, 9000, 8500, 8200, 40000, 8100, 8300, 8000, 9100, 8700, 8600]
"""intervals of the frames in the tables; one is long, as frames are missing there"""
TIMES_US = [0, *np.cumsum(GAPS_US).tolist()]


def _video(folder, name="clip.mp4", **options):
    return write_video(folder / name, tip()[30 : 30 + FRAMES], **options)


def _table(folder, *lines, name="clip.csv"):
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def _rows(scale: float = 1.0, digits: int = 0) -> list[str]:
    return [f"{time_us * scale:.{digits}f}" for time_us in TIMES_US]


def _times_us(source) -> list[float]:
    return [1e-3 * frame.time_ns for frame in source.frames()]


@pytest.mark.parametrize(
    ("name", "options"), [("clip.mp4", {"bf": "3"}), ("clip.mp4", {"bf": "0"}), ("clip.h264", {"bf": "0"})]
)
def test_the_table_beside_a_video_gives_its_times(tmp_path, name, options):
    """A raw H.264 stream has no time stamps at all, and an MP4 those of a constant rate."""
    path = _video(tmp_path, name, **options)
    _table(tmp_path, "time_s", *_rows(1e-6, 6))
    source = open_source(path, SourceOptions())
    assert _times_us(source) == TIMES_US
    assert source.time_sd_ns == 289
    assert source.frame_count == FRAMES
    assert isinstance(source, VideoSource)
    in_order = np.sort(np.concatenate([group.times_ns for group in source.coded()]))
    assert in_order.tolist() == [1000 * time for time in TIMES_US]
    part = [frame.time_ns // 1000 for frame in source.frames(TIMES_US[4] * 1000, TIMES_US[7] * 1000)]
    assert part == TIMES_US[4:8]
    assert source.remarks == ()


def test_own_times_leave_the_table_aside(tmp_path):
    path = _video(tmp_path)
    _table(tmp_path, "time_s", *_rows(1e-6, 6))
    times = _times_us(open_source(path, SourceOptions(times=OWN_TIMES)))
    assert np.diff(times) == pytest.approx(8333, abs=1)


@pytest.mark.parametrize(
    ("lines", "remark"),
    [
        (["frame,timestamp_ns", *(f"{7 + n},{t}000" for n, t in enumerate(_rows()))], None),
        (["device_time_us;host_time_ns", *(f"{t};0" for t in _rows())], "device_time_us is used, not host_t"),
        (["Index\tTime [ms]", *(f"{n}\t{t}" for n, t in enumerate(_rows(1e-3, 3)))], None),
        (["Zeit;t (ms)", *(f"x;{t.replace('.', ',')}" for t in _rows(1e-3, 3))], None),
        (["frame,time", *reversed([f"{n},{t}" for n, t in enumerate(_rows())])], "time is read in us"),
        (["# timecode format v2", *_rows(1e-3, 3)], None),
        (["time", *_rows(1e-6, 6)], "column time is read in s"),
    ],
)
def test_columns_and_units(tmp_path, lines, remark):
    source = open_source(_video(tmp_path), SourceOptions(times=_table(tmp_path, *lines, name="t.csv")))
    assert _times_us(source) == pytest.approx(TIMES_US, abs=1e-3)
    assert (remark is None) == (source.remarks == ())
    assert all(remark in text for text in source.remarks)


def test_seconds_since_1970_keep_their_digits(tmp_path):
    table = read_times_table(_table(tmp_path, "t_s", "1700000000.123456789", "1700000000.133456789"), "frame")
    assert table.rows[1].time_s - table.rows[0].time_s == Decimal("0.01")


def test_times_of_arrival_are_reported_as_such(tmp_path):
    table = _table(tmp_path, "host_time_us", *_rows())
    source = open_source(_video(tmp_path), SourceOptions(times=table))
    assert source.time_source is TimeSource.HOST_ARRIVAL
    assert source.time_sd_ns > 100_000


def test_a_unit_is_chosen_by_the_videos_rate_only_if_it_agrees(tmp_path):
    lines = ["time", *(f"{number / 60:.6f}" for number in range(FRAMES))]
    table = _table(tmp_path, *lines)
    assert read_times_table(table, "frame", 60.0).unit == "s"
    for rate in (None, 30.0):
        with pytest.raises(ImportRefused, match="may be in s or ms: rename it to time_s or time_ms"):
            read_times_table(table, "frame", rate)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["time_s", *_rows(1e-6, 6)[1:]], "has 11 rows, but clip.mp4 has 12 frames"),
        (["time_us", *_rows()[:5], *_rows()[4:-1]], "two frames have the same time, lines 6 and 7"),
        (
            ["time_us", *_rows()[:5], _rows()[6], _rows()[5], *_rows()[7:]],
            "line 8: its time is 0.0081 s before",
        ),
        (["frame,time_us", *(f"{n % 11},{t}" for n, t in enumerate(_rows()))], "names frame 0 2 times"),
        (["frame,time_us", *(f"n{n},{t}" for n, t in enumerate(_rows()))], "'n0' is not a frame number"),
        (["time_us", *_rows()[:5], "late", *_rows()[6:]], "line 7: time_us 'late' is not a number"),
        (
            ["time_us", *_rows()[:-1], "9" * 19],
            "line 13: its time is 1e+13 s from that of line 2: correct it",
        ),
        (["time_us", *_rows()[:-1], "1e999999"], "line 13: time_us '1e999999' is not a number"),
        (["time_s", *_rows()], "if they are in us, rename the column to time_us"),
        (["time", *map(str, range(1, FRAMES + 1))], "rises by 1 from image to image, as frame numbers do"),
        (["time", *map(str, range(0, 100 * FRAMES, 100))], "may be in ms or us: rename it to time_ms or"),
        (
            ["time_s", *map(str, range(1, FRAMES + 1))],
            "come every 1 s by the column time_s: if they are in ms",
        ),
        (_rows(), "it needs a header with a column of times, as time_s"),
        (["exposure,gain", "1,2", "1,2"], "has the columns exposure,gain: it needs a header"),
        (["time_s", "0"], "names 1 frame: a strike needs more"),
    ],
)
def test_tables_that_do_not_fit_are_refused_in_one_line(tmp_path, lines, said):
    table = _table(tmp_path, *lines, name="t.csv")
    with pytest.raises(ImportRefused) as caught:
        open_source(_video(tmp_path), SourceOptions(times=table))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_another_csv_beside_a_video_is_named_and_not_used(tmp_path):
    path = _video(tmp_path)
    _table(tmp_path, "x,y", "1,2")
    source = open_source(path, SourceOptions())
    assert np.diff(_times_us(source)) == pytest.approx(8333, abs=1)
    assert "clip.csv beside it is not used, as it has no column of times" in source.remarks[0]


def test_frames_without_stamps_out_of_order_are_refused(tmp_path):
    path = _video(tmp_path, "clip.h264", bf="3")
    _table(tmp_path, "time_s", *_rows(1e-6, 6))
    with pytest.raises(ImportRefused, match="record without B-frames"):
        open_source(path, SourceOptions())


def test_capture_rate_and_table_contradict(tmp_path):
    path = _video(tmp_path)
    _table(tmp_path, "time_s", *_rows(1e-6, 6))
    with pytest.raises(ImportRefused, match=r"--capture-fps does not apply, as .*clip\.csv has the times"):
        open_source(path, SourceOptions(capture_hz=120))


def test_one_table_for_each_source(tmp_path):
    paths = tuple(tmp_path / name for name in ("a.mp4", "b.mp4"))
    some = ImportOptions(paths, tmp_path, tmp_path, None, times=(tmp_path / "a.csv", OWN_TIMES))
    assert [each.times for each in some.source_options()] == [tmp_path / "a.csv", OWN_TIMES]
    with pytest.raises(ImportRefused, match="--times is given 1 time for 2 sources"):
        ImportOptions(paths, tmp_path, tmp_path, None, times=(tmp_path / "a.csv",)).source_options()


def test_a_folder_of_videos_is_told_to_name_them(tmp_path):
    _video(tmp_path)
    with pytest.raises(ImportRefused, match=r"contains 1 video and no images: name the videos .*/\*\.\w+$"):
        open_source(tmp_path, SourceOptions())
