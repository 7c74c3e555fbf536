"""A recording in several files is read as one, whichever of them is named."""

from __future__ import annotations

import io
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.errors import RecordingCut
from analyze.reading.file_series import SeriesFiles, find_series_files
from analyze.reading.recording import open_partial, open_recording
from analyze.reading.truth import read_truth
from analyze.verbs.inspect.recording import inspect_recording
from analyze.verbs.inspect.table import render_inspection
from schemas.result import Result
from schemas.terminal import Terminal
from tests import small_recording as small
from tests.analyze.split_recording import split_recording
from tests.places import SAMPLE

LAST_FRAME = 10
"""number of the last image in the first file"""


@pytest.fixture(scope="module")
def halves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a small recording in two files, and of the whole one."""
    folder = tmp_path_factory.mktemp("row")
    small.write_recording(folder / "whole.mcap")
    split_recording(folder / "whole.mcap", folder / "a.mcap", small.frame_time(LAST_FRAME))
    return folder


@pytest.fixture
def folder(halves: Path, tmp_path: Path) -> Path:
    """Copy of the two files, which a test may damage."""
    for name in ("a.mcap", "a-0002.mcap"):
        shutil.copy(halves / name, tmp_path)
    return tmp_path


def test_any_file_opens_the_whole_series(halves: Path) -> None:
    with open_recording(halves / "whole.mcap") as whole:
        strikes, topics, images = whole.strikes, whole.topics(), [frame.image for frame in whole.images()]
    ids = set()
    for name in ("a.mcap", "a-0002.mcap"):
        with open_recording(halves / name) as recording:
            assert [part.path.name for part in recording.parts] == ["a.mcap", "a-0002.mcap"]
            assert recording.missing_parts == ()
            assert recording.strikes == strikes
            assert {topic.name: topic for topic in recording.topics()} == {
                topic.name: topic for topic in topics
            }
            np.testing.assert_array_equal([frame.image for frame in recording.images()], images)
            around = recording.images(
                start_ns=small.frame_time(LAST_FRAME - 1), end_ns=small.frame_time(LAST_FRAME + 2)
            )
            assert [frame.sequence for frame in around] == [
                LAST_FRAME - 1,
                LAST_FRAME,
                LAST_FRAME + 1,
                LAST_FRAME + 2,
            ]
            ids.add(recording.content_id)
    assert len(ids) == 1
    assert None not in ids


def test_foreign_files_with_a_series_name_are_ignored(folder: Path) -> None:
    whole = SeriesFiles((folder / "a.mcap", folder / "a-0002.mcap"))
    (folder / "a-0003.mcap").write_bytes(b"none")
    shutil.copy(folder / "a-0002.mcap", folder / "a-0004.mcap")  # carries another number
    small.write_recording(folder / "a-0005.mcap")  # of another recording
    (folder / "a-0006.mcap").mkdir()
    shutil.copy(folder / "a-0002.mcap", folder / "a-0002.mcap.part")  # that one is whole meanwhile
    assert find_series_files(folder / "a.mcap") == find_series_files(folder / "a-0002.mcap") == whole
    assert find_series_files(folder / "gone.mcap") == SeriesFiles((folder / "gone.mcap",))
    assert find_series_files(folder / "a-0003.mcap") == SeriesFiles((folder / "a-0003.mcap",))


def test_missing_file_of_the_series_is_reported(folder: Path) -> None:
    (folder / "a.mcap").rename(folder / "elsewhere.mcap")
    assert find_series_files(folder / "a-0002.mcap") == SeriesFiles((folder / "a-0002.mcap",), missing=(1,))
    (folder / "a-0002.mcap").rename(folder / "second.mcap")
    assert find_series_files(folder / "second.mcap") == SeriesFiles((folder / "second.mcap",), missing=(1,))
    found = inspect_recording(folder / "second.mcap")
    assert found["missing_files"] == [1]
    assert "not here: file 1 of this recording" in rendered(found)


def test_cut_file_of_the_series_is_named_with_its_remedy(folder: Path) -> None:
    cut = folder / "a-0002.mcap"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 2 // 3])
    with pytest.raises(
        RecordingCut,
        match=r"a\.mcap: a-0002\.mcap of the same recording was cut short .*-0002\.mcap -o NEW\.mcap`",
    ):
        open_recording(folder / "a.mcap")
    cut.rename(f"{cut}.part")
    with pytest.raises(RecordingCut, match=rf"`acquire recover {cut}\.part -o {cut}`"):
        open_recording(folder / "a.mcap")
    with open_partial(folder / "a.mcap") as recording:
        assert LAST_FRAME + 1 < len(list(recording.images())) < small.FRAMES
        assert recording.content_id is None
    found = inspect_recording(folder / "a.mcap")
    assert found["complete"] is False
    assert [file["content_id"] is None for file in found["files"]] == [False, True]


def rendered(found: dict) -> str:
    text = io.StringIO()
    render_inspection(found, Terminal(file=text, width=200))
    return text.getvalue()


def test_inspection_lists_all_files(halves: Path) -> None:
    found, whole = inspect_recording(halves / "a-0002.mcap"), inspect_recording(halves / "whole.mcap")
    json.dumps(found, allow_nan=False)
    sizes = [(halves / name).stat().st_size for name in ("a.mcap", "a-0002.mcap")]
    assert [file["bytes"] for file in found["files"]] == sizes
    assert found["bytes"] == sum(sizes)
    for same in ("topics", "cameras", "clocks", "strikes", "duration_s", "complete", "attachments"):
        by_name = [
            sorted(each[same], key=str) if isinstance(each[same], list) else each[same]
            for each in (found, whole)
        ]
        assert by_name[0] == by_name[1], same
    assert "in 2 files: a.mcap, a-0002.mcap" in rendered(found)


def test_output_must_not_replace_another_file_of_the_series(folder: Path) -> None:
    done = CliRunner().invoke(analyze, ["report", str(folder / "a.mcap"), "-o", str(folder / "a-0002.mcap")])
    assert done.exit_code == 1
    assert "a-0002.mcap: is also an input" in done.stderr


@pytest.fixture(scope="module")
def sample_halves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the sample in two files: two strikes each."""
    folder = tmp_path_factory.mktemp("sample")
    with open_recording(SAMPLE) as recording:
        between = (recording.strikes[1].window_end_ns + recording.strikes[2].window_start_ns) // 2
    split_recording(SAMPLE, folder / "s.mcap", between)
    return folder


def test_ground_truth_of_both_files(sample_halves: Path) -> None:
    truth, whole = read_truth(sample_halves / "s.mcap"), read_truth(SAMPLE)
    assert truth.body == whole.body
    assert truth.contacts == whole.contacts
    np.testing.assert_array_equal(truth.pose_time_ns, whole.pose_time_ns)


@pytest.mark.slow
def test_sample_in_two_files_gives_the_same_result(sample_halves: Path, tmp_path: Path) -> None:
    answers = []
    for path in (SAMPLE, sample_halves / "s.mcap", sample_halves / "s-0002.mcap"):
        done = CliRunner().invoke(analyze, ["estimate", str(path), "--json"], catch_exceptions=False)
        assert done.exit_code == 0, done.stderr
        answers.append(Result.model_validate_json(done.stdout))
    whole, first, second = answers
    assert first == second
    assert first.inputs.content_id != whole.inputs.content_id
    same = first.inputs.model_copy(update={"content_id": whole.inputs.content_id})
    assert first.model_copy(update={"inputs": same}) == whole
    assert (
        math.dist(first.centre_of_mass.value, read_truth(sample_halves / "s.mcap").body.com_object) < 0.0005
    )
    for verb, more in (
        ("score", []),
        ("report", ["-o", str(tmp_path / "r.html")]),
        ("replay", ["--save", str(tmp_path / "r.rrd")]),
    ):
        done = CliRunner().invoke(
            analyze, [verb, str(sample_halves / "s-0002.mcap"), *more], catch_exceptions=False
        )
        assert done.exit_code == 0, done.stderr
    (sample_halves / "s.mcap").rename(tmp_path / "s.mcap")
    done = CliRunner().invoke(
        analyze, ["estimate", str(sample_halves / "s-0002.mcap")], catch_exceptions=False
    )
    (tmp_path / "s.mcap").rename(sample_halves / "s.mcap")
    assert done.exit_code == 1
    assert "2 good strikes of 2" in done.stderr
