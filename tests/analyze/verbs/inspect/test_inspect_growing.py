"""A file that is being written is inspected as it stands, and not called cut."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import pytest

from analyze.errors import RecordingCut, RecordingError
from analyze.reading import recording_file
from analyze.reading.mcap_contents import read_contents
from analyze.verbs.inspect import recording as inspection
from analyze.verbs.inspect.recording import inspect_recording
from analyze.verbs.inspect.table import render_inspection
from schemas.document import canonical_json
from schemas.strike_plan import StrikePlan
from schemas.terminal import Terminal
from tests import small_recording as small
from tests.analyze.motion.tipping import planned
from tests.places import FIRST_SAMPLE


@pytest.fixture
def part(tmp_path: Path) -> Path:
    """A recording as a session leaves it on the disk before its end."""
    strikes = [planned().model_copy(update={"id": name}) for name in ("s1", "s2")]
    plan = StrikePlan(object_name="box", object_sha256="0", strikes=strikes)
    small.write_recording(tmp_path / "whole.mcap", plan=canonical_json(plan).encode())
    path = tmp_path / "a.mcap.part"
    path.write_bytes((tmp_path / "whole.mcap").read_bytes()[:-3000])
    return path


def _text(found: dict[str, Any]) -> str:
    out = io.StringIO()
    render_inspection(found, Terminal(file=out, width=200))
    return out.getvalue()


@pytest.mark.parametrize("name", ["a.mcap", "a.mcap.part"])
def test_running_session_is_found_by_either_name_and_has_no_problem(part: Path, name: str) -> None:
    found = inspect_recording(part.with_name(name))
    assert (found["path"], found["complete"], found["growing"]) == (str(part), False, True)
    text = _text(found)
    assert "still being written" in text
    assert "planned strikes struck so far" in text
    for word in ("cut short", "recover", "missing:", "worth adding"):
        assert word not in text


def test_part_file_that_no_one_writes_any_more_is_cut(part: Path) -> None:
    an_hour_ago = part.stat().st_mtime - 3600
    os.utime(part, (an_hour_ago, an_hour_ago))
    found = inspect_recording(part)
    assert found["growing"] is False
    assert "cut short" in _text(found)
    assert "acquire recover" in _text(found)


def test_file_of_another_program_that_grows_while_it_is_read_is_being_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bag_0.mcap"
    data = FIRST_SAMPLE.read_bytes()
    path.write_bytes(data[:400_000])

    def while_it_grows(path: Path, progress: Any) -> Any:
        found = read_contents(path, progress)
        with path.open("ab") as stream:
            stream.write(data[400_000:500_000])
        return found

    assert inspect_recording(path)["growing"] is False
    monkeypatch.setattr(inspection, "read_contents", while_it_grows)
    assert inspect_recording(path)["growing"] is True


def test_session_that_ends_while_it_is_read_is_read_under_its_final_name(
    part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = part.with_name("whole.mcap")

    def while_it_ends(path: Path, progress: Any) -> Any:
        found = read_contents(path, progress)
        if path == part:
            part.unlink()
            whole.rename(part.with_suffix(""))
        return found

    monkeypatch.setattr(inspection, "read_contents", while_it_ends)
    found = inspect_recording(part)
    assert (found["complete"], found["path"]) == (True, str(part.with_suffix("")))


def test_file_that_holds_nothing_yet_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.part").touch()
    with pytest.raises(RecordingCut, match=r"a\.mcap\.part: is still empty, and being written: try again"):
        inspect_recording(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match=r"b\.mcap: no such"):
        inspect_recording(tmp_path / "b.mcap")


def test_fresh_part_file_counts_as_growing_and_a_vanished_file_does_not(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.touch()
    before = path.stat()
    assert not recording_file.is_growing(path, before)
    path.unlink()
    assert not recording_file.is_growing(path, before)
