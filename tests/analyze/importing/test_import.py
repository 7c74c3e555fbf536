"""Import of videos as a recording that is read like any other."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from analyze.batch.archive import find_sources
from analyze.batch.sparse_copy import sparse_copies
from analyze.cli import main
from analyze.errors import ImportRefused
from analyze.importing.onsets import OnsetFinder
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.reading.recording import Recording, open_recording
from analyze.reading.verify import refuse_changed_content
from analyze.sources.open_source import SourceOptions, open_source
from analyze.sources.source import TimedImage
from analyze.sources.video import VideoSource
from schemas.output_file import OutputError
from schemas.session_manifest import TimeSource
from schemas.strike_result import Verdict
from schemas.toss_result import TossVerdict
from tests.analyze.importing.tip_videos import (
    PHI,
    RATE,
    REST,
    T_WORLD_CAMERA,
    K,
    angles,
    picture,
    setting,
    tip,
    write_video,
)

STEP_US = 10**6 // RATE


def imported(folder: Path, *sources: Path, strikes=(), placed=True, planned=("s1",), **options) -> Path:
    output = folder / "imported.mcap"
    with prepare(
        ImportOptions(sources, *setting(folder, planned, placed=placed), strikes, **options)
    ) as prepared:
        write_recording(prepared, output)
    return output


def _images(recording: Recording, start_ns=None, end_ns=None) -> list[tuple[int, np.ndarray]]:
    return [(frame.time_ns, frame.image) for frame in recording.images(start_ns=start_ns, end_ns=end_ns)]


@pytest.mark.parametrize("b_frames", ["0", "3"])
@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_h264_and_h265_are_stored_as_coded_and_read_back(tmp_path, codec, b_frames):
    more = {"x265-params": "log-level=none:keyint=20"} if codec == "libx265" else {"g": "20"}
    path = write_video(tmp_path / "a.mp4", tip(), codec=codec, bf=b_frames, preset="ultrafast", **more)
    source = VideoSource(path)
    expected = [(frame.time_ns, frame.image.copy()) for frame in source.frames()]
    file = imported(tmp_path, path, whole=True)
    refuse_changed_content(file)
    with open_recording(file) as recording:
        assert recording.topics()[1].schema == "foxglove.CompressedVideo"
        every = _images(recording)
        assert len(every) == len(expected)
        start = every[0][0]
        assert [time - start for time, _ in every] == [time for time, _ in expected]
        assert all(np.array_equal(one[1], other[1]) for one, other in zip(every, expected, strict=True))
        middle = _images(recording, every[33][0], every[37][0])
        assert [time for time, _ in middle] == [time for time, _ in every[33:38]]
        assert all(np.array_equal(one[1], other[1]) for one, other in zip(middle, every[33:38], strict=True))
        [alone] = _images(recording, every[50][0], every[50][0])
        assert np.array_equal(alone[1], every[50][1])
        metas = list(recording.frame_meta())
        assert [meta.sequence for meta in metas] == list(range(len(every)))
        assert recording.manifest.time_source is TimeSource.CONTAINER_PTS
        assert recording.manifest.time_source_sd_ns == 289
        assert recording.manifest.cameras[0].frame_rate_hz == pytest.approx(RATE, rel=1e-4)
        [strike] = recording.strikes
        assert (strike.window_start_ns, strike.window_end_ns) == (every[0][0], every[-1][0])
        assert strike.contact_time_ns == 0


def test_imported_video_is_analysed_like_a_recording(tmp_path):
    file = imported(tmp_path, write_video(tmp_path / "a.mp4", tip(), crf="10"))
    [motion] = read_evidence(read_head(file)).motions
    assert motion.verdict is Verdict.GOOD, motion.reason
    assert motion.fit is not None
    assert motion.fit.phi == pytest.approx(PHI, abs=np.radians(0.1))
    assert motion.fit.k == pytest.approx(K, rel=0.01)


def test_slow_motion_that_states_30_hz(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip(), range(0, 33_333 * len(tip()), 33_333), crf="10")
    [motion] = read_evidence(
        read_head(imported(tmp_path, path, source=SourceOptions(capture_hz=RATE)))
    ).motions
    assert motion.fit is not None
    assert motion.fit.k == pytest.approx(K, rel=0.01)


def test_a_video_whose_stamps_are_wrong_is_read_with_its_table_of_times(tmp_path):
    """The container states 30 frames per second throughout; the camera lost four frames of the tip."""
    shown = [number for number in range(len(tip())) if not REST + 8 <= number < REST + 12]
    images, stamps = [tip()[number] for number in shown], range(0, 33_333 * len(shown), 33_333)
    path = write_video(tmp_path / "a.mp4", images, stamps, crf="10")
    table = tmp_path / "stamps.csv"
    rows = [f"{100 + number},{5 * 10**9 + number * STEP_US * 1000}" for number in shown]
    table.write_text("\n".join(["frame_id,device_time_ns", *rows]))
    with prepare(ImportOptions((path,), *setting(tmp_path), times=(table,))) as prepared:
        written = write_recording(prepared, tmp_path / "o.mcap")
    assert written.remarks == ("a.mp4: 4 frames are missing once: 0.042 s from 0.308 s on",)
    [motion] = read_evidence(read_head(tmp_path / "o.mcap")).motions
    assert motion.fit is not None
    assert motion.fit.k == pytest.approx(K, rel=0.01)


def test_missing_frames_are_reported(tmp_path):
    times = [number * STEP_US for number in range(len(tip())) if not 40 <= number < 47]
    images = [image for number, image in enumerate(tip()) if not 40 <= number < 47]
    with prepare(
        ImportOptions((write_video(tmp_path / "a.mp4", images, times),), *setting(tmp_path), whole=True)
    ) as prepared:
        written = write_recording(prepared, tmp_path / "o.mcap")
    assert written.remarks == ("a.mp4: 7 frames are missing once: 0.067 s from 0.325 s on",)
    with open_recording(tmp_path / "o.mcap") as recording:
        assert {
            meta.sequence: meta.frames_lost_before
            for meta in recording.frame_meta()
            if meta.frames_lost_before
        } == {40: 7}


def test_a_strike_without_images_is_not_counted(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:20])
    with prepare(ImportOptions((path,), *setting(tmp_path), whole=True)) as prepared:
        beyond = replace(prepared.windows[0], attempt=2, start_ns=10**12, end_ns=2 * 10**12)
        windows = (*prepared.windows, beyond)
        written = write_recording(replace(prepared, windows=windows), tmp_path / "o.mcap")
    assert written.strikes == 1
    assert "strike s1.2: has no images and is left out" in written.remarks


def test_other_codecs_are_stored_losslessly_in_the_windows_only(tmp_path):
    still = [tip()[0]] * 120
    path = write_video(tmp_path / "a.mkv", [*still, *tip()], codec="ffv1", pixels="gray")
    with open_recording(imported(tmp_path, path)) as recording:
        assert recording.topics()[1].schema == "foxglove.RawImage"
        images = [image for _, image in _images(recording)]
        [strike] = recording.strikes
    seconds = (strike.window_end_ns - strike.window_start_ns) * 1e-9
    assert seconds == pytest.approx(0.5 + (len(tip()) - REST) / RATE, abs=0.03)
    assert np.array_equal(images[-1], tip()[-1])
    assert np.array_equal(images[0], still[0])


def test_import_of_an_image_folder(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    with (folder / "times.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["name", "time_s"])
        for number, image in enumerate(tip()):
            cv2.imwrite(str(folder / f"{number}.png"), image)
            rows.writerow([f"{number}.png", f"{1_700_000_000 + number * STEP_US * 1e-6:.6f}"])
    with open_recording(imported(tmp_path, folder, whole=True)) as recording:
        images = _images(recording)
    assert np.diff([time for time, _ in images]).tolist() == [1000 * STEP_US] * (len(tip()) - 1)
    assert all(np.array_equal(image, drawn) for (_, image), drawn in zip(images, tip(), strict=True))


@pytest.mark.parametrize("codec", ["libx264", "ffv1"])
def test_videos_of_tosses_are_stored_whole_beside_the_strikes(tmp_path, codec):
    """Stored as coded and decoded; a toss's window holds all of its images, a strike's none of them."""
    suffix = ".mp4" if codec == "libx264" else ".mkv"
    strike, first, second = (tmp_path / f"{name}{suffix}" for name in ("s1", "up", "down"))
    write_video(strike, tip(), codec=codec)
    tossed = [np.full_like(tip()[0], 60 + 2 * number) for number in range(30)]
    write_video(first, tossed[:20], codec=codec)
    write_video(second, tossed[20:], codec=codec)
    path = imported(tmp_path, strike, tosses=(first, second))
    with open_recording(path) as recording:
        names = [(toss.toss_id, toss.plan_toss_id) for toss in recording.tosses]
        windows = [(toss.window_start_ns, toss.window_end_ns) for toss in recording.tosses]
        images = [_images(recording, *window) for window in windows]
        struck = recording.strikes[0]
    assert names == [("t1.1", "t1"), ("t2.1", "t2")]
    assert [len(each) for each in images] == [20, 10]
    assert abs(float(images[1][0][1].mean()) - 100) < 3
    assert struck.window_end_ns < windows[0][0] < windows[0][1] < windows[1][0]
    evidence = read_evidence(read_head(path))
    assert [toss.verdict for toss in evidence.tosses] == [TossVerdict.MARKER_LOST] * 2


def test_video_of_a_whole_session_is_split(tmp_path):
    gone = [np.full_like(tip()[0], 120)] * 40
    hand = [tip()[0].copy() for _ in range(20)]
    for image in hand:
        image[60:140, 40:120] = 20
    carried = [picture(0.0, (4.0 * step, -3.0 * step)) for step in range(1, 20)]
    one = [*[tip()[0]] * 40, *hand, *tip(), *gone, *[tip()[0]] * 30, *carried, *gone, *tip()]
    path = write_video(tmp_path / "a.mp4", one, crf="10")
    with prepare(ImportOptions((path,), *setting(tmp_path, ("s1", "s2")))) as prepared:
        assert prepared.was_split
        starts = [60 + REST, 60 + len(tip()) + 40 + 30 + 19 + 40 + REST]
        moments = [
            window.onset.time_ns * 1e-9 * RATE for window in prepared.windows if window.onset is not None
        ]
        assert moments == pytest.approx(starts, abs=3)
        write_recording(prepared, tmp_path / "o.mcap")
    evidence = read_evidence(read_head(tmp_path / "o.mcap"))
    assert [motion.strike_id for motion in evidence.motions] == ["s1.1", "s2.1"]
    assert all(motion.verdict is Verdict.GOOD for motion in evidence.motions), [
        motion.reason for motion in evidence.motions
    ]


def test_assignment_of_clips_to_strikes(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip())
    with prepare(
        ImportOptions((path, path), *setting(tmp_path, ("s1", "s2", "s3")), ("s3", "s3"), whole=True)
    ) as prepared:
        assert [window.strike_id for window in prepared.windows] == ["s3.1", "s3.2"]
    with pytest.raises(ImportRefused, match="the plan has s1"):
        prepare(ImportOptions((path,), *setting(tmp_path), ("s7",), whole=True))
    with pytest.raises(ImportRefused, match="2 sources, but the plan has 1"):
        prepare(ImportOptions((path, path), *setting(tmp_path), whole=True))
    with pytest.raises(ImportRefused, match=r"shows 1 strike .at 0.2 s., but --strike is given 2 times"):
        prepare(ImportOptions((path,), *setting(tmp_path, ("s1", "s2")), ("s1", "s2")))


def test_camera_pose_from_the_resting_object(tmp_path):
    file = imported(tmp_path, write_video(tmp_path / "a.mp4", tip(), crf="10"), placed=False)
    with open_recording(file) as recording:
        found = np.array(recording.manifest.cameras[0].calibration.T_world_camera)
    # A tag seen face on determines its tilt least; theta(t) hardly depends on the tilt.
    assert found[:3, 3] == pytest.approx(T_WORLD_CAMERA[:3, 3], abs=5e-3)
    assert np.degrees(np.arccos((np.trace(found[:3, :3].T @ T_WORLD_CAMERA[:3, :3]) - 1) / 2)) < 1.5
    [motion] = read_evidence(read_head(file)).motions
    assert motion.fit is not None
    assert motion.fit.phi == pytest.approx(PHI, abs=np.radians(0.2))


def test_images_of_another_size_are_refused(tmp_path):
    path = write_video(tmp_path / "a.mp4", [image[:200] for image in tip()[:5]])
    with pytest.raises(ImportRefused, match=r"has 320 x 200 px, .* is of 320 x 240"):
        prepare(ImportOptions((path,), *setting(tmp_path)))


def test_same_video_gives_the_same_content_id(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:20])
    ids = []
    for name in ("one.mcap", "two.mcap"):
        with prepare(ImportOptions((path,), *setting(tmp_path), whole=True)) as prepared:
            ids.append(write_recording(prepared, tmp_path / name).content_id)
    assert ids[0] == ids[1]
    with (
        prepare(ImportOptions((path,), *setting(tmp_path), whole=True)) as prepared,
        pytest.raises(OutputError, match="exists already"),
    ):
        write_recording(prepared, tmp_path / "one.mcap")


def test_level_reading_comes_from_the_rig_file(tmp_path):
    files = setting(tmp_path)
    files[2].write_text(
        "g_m_s2 = 9.79\n[level]\ntowards_x_rad = 0.001\ntowards_x_sd_rad = 0.0002\n" + files[2].read_text()
    )
    with prepare(
        ImportOptions((write_video(tmp_path / "a.mp4", tip()[:5]),), *files, whole=True)
    ) as prepared:
        write_recording(prepared, tmp_path / "o.mcap")
    with open_recording(tmp_path / "o.mcap") as recording:
        assert recording.manifest.g_m_s2 == 9.79
        assert recording.manifest.level is not None
        assert recording.manifest.level.towards_x_rad == 0.001


def test_part_file_of_another_import_is_left_alone(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:5])
    (tmp_path / "o.mcap.part").write_bytes(b"theirs")
    with (
        prepare(ImportOptions((path,), *setting(tmp_path), whole=True)) as prepared,
        pytest.raises(OutputError, match="is being written"),
    ):
        write_recording(prepared, tmp_path / "o.mcap")
    assert (tmp_path / "o.mcap.part").read_bytes() == b"theirs"


def test_recording_is_not_imported_again(tmp_path):
    """A recording given to the import is refused, and the text names the command that reads it."""
    file = imported(tmp_path, write_video(tmp_path / "a.mp4", tip()[:12]), whole=True)
    with pytest.raises(
        ImportRefused,
        match=r"is already a recording: use it as it is, as in `analyze estimate imported.mcap`",
    ):
        open_source(file, SourceOptions())


def test_watching_an_imported_video_is_refused_in_one_line(tmp_path):
    file = imported(tmp_path, write_video(tmp_path / "a.mp4", tip()[:12]), whole=True)
    done = CliRunner().invoke(main, ["watch", str(file)], input="")
    assert done.exit_code == 1
    assert done.output.count("\n") == 1
    assert "is an imported video" in done.output
    assert "analyze estimate" in done.output


def test_bucket_copy_contains_chunks_that_continue_without_a_key_picture(tmp_path, monkeypatch):
    """Chunks of 64 MiB (here 20 kB) may go on without a key picture.

    What lies before the strike is then fetched back to the last key picture.
    """
    monkeypatch.setattr("schemas.topics.VIDEO_CHUNK_BYTES", 20_000)
    monkeypatch.setattr("analyze.batch.sparse_copy.VIDEO_CHUNK_BYTES", 20_000)
    noise = np.random.default_rng(1)
    busy = [
        np.clip(image + noise.normal(0, 6, image.shape), 0, 255).astype(np.uint8)
        for image in [tip()[0]] * 150
    ]
    path = write_video(
        tmp_path / "a.mp4", [*busy, *tip()], crf="20", bf="0", g="95", sc_threshold="0", preset="ultrafast"
    )
    file = imported(tmp_path, path)
    with open_recording(file) as recording:
        [strike] = recording.strikes
        expected = _images(recording, strike.window_start_ns, strike.window_end_ns)
    (tmp_path / "copy").mkdir()
    [source] = find_sources([str(file)])
    with sparse_copies(source, tmp_path / "copy") as copy, open_recording(copy) as recording:
        images = _images(recording, strike.window_start_ns, strike.window_end_ns)
    assert [time for time, _ in images] == [time for time, _ in expected]
    assert all(np.array_equal(one[1], other[1]) for one, other in zip(images, expected, strict=True))


def test_nothing_is_written_without_confirmation(tmp_path):
    gone = [np.full_like(tip()[0], 120)] * 30
    path = write_video(tmp_path / "a.mp4", [*tip(), *gone, *gone, *gone, *tip()])
    files = zip(("--object", "--plan", "--camera"), map(str, setting(tmp_path, ("s1", "s2"))), strict=True)
    command = [
        "import",
        str(path),
        *(word for pair in files for word in pair),
        "-o",
        str(tmp_path / "o.mcap"),
    ]
    asked = CliRunner().invoke(main, command)
    assert asked.exit_code == 2
    assert "--yes" in asked.output
    shown = CliRunner().invoke(main, [*command, "--dry-run"])
    assert shown.exit_code == 0, shown.output
    assert "s2.1" in shown.output
    assert not (tmp_path / "o.mcap").exists()
    done = CliRunner().invoke(main, [*command, "--yes"])
    assert done.exit_code == 0, done.output
    assert "2 strikes" in done.output
    assert [path.name for path in tmp_path.glob("o.mcap*")] == ["o.mcap"]
    again = CliRunner().invoke(main, [*command, "--yes"])
    assert again.exit_code == 1
    assert again.output.count("\n") == 1, "before the video is searched"
    assert "exists already" in again.output
    older = (tmp_path / "o.mcap").stat().st_ino
    forced = CliRunner().invoke(main, [*command, "--yes", "--force"])
    assert forced.exit_code == 0, forced.output
    assert [path.name for path in tmp_path.glob("o.mcap*")] == ["o.mcap"]
    assert (tmp_path / "o.mcap").stat().st_ino != older


def test_nudge_before_the_strike_is_not_its_onset(tmp_path):
    """A finger nudges the object and strikes it later: the onset is that of the strike."""
    nudged = [picture(theta, (1.5, 0.0)) for theta in angles()[REST - 15 :]]
    one = [*[tip()[0]] * 40, *[nudged[0]] * 40, *nudged]
    with prepare(
        ImportOptions((write_video(tmp_path / "a.mp4", one, crf="10"),), *setting(tmp_path))
    ) as prepared:
        [window] = prepared.windows
    assert window.onset is not None
    assert window.onset.time_ns * 1e-9 * RATE == pytest.approx(40 + 40 + 15, abs=3)
    assert window.onset.rest_ns * 1e-9 * RATE == pytest.approx(40, abs=8)


def test_motion_during_a_pause_between_images_is_no_strike():
    """Between two preview images of a recording the object may be put down in another orientation."""
    finder = OnsetFinder([3])
    still, turned = tip()[0], picture(0.3)
    found = [finder.add(TimedImage(i * 8_333_333, still)) for i in range(40)]
    found += [finder.add(TimedImage(40 * 8_333_333 + 250_000_000 + i * 8_333_333, turned)) for i in range(40)]
    assert found == [None] * 80
