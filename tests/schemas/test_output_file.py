"""Output files are accepted and refused alike in both commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.errors import RecorderError
from acquire.recorder.atomic import refuse_unwritable as acquire_refuses
from schemas.output_file import OutputError, why_unwritable
from schemas.output_file import refuse_unwritable as analyze_refuses


def test_new_and_existing_output_names_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    assert why_unwritable(tmp_path / "new", tmp_path / "old") is None
    assert why_unwritable(tmp_path / "old") is None


@pytest.mark.parametrize("name", ["gone/new", "folder", "old/new"])
def test_both_commands_refuse_a_missing_folder_alike(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "old").touch()
    with pytest.raises(RecorderError) as of_acquire:
        acquire_refuses(tmp_path / name)
    with pytest.raises(OutputError) as of_analyze:
        analyze_refuses(tmp_path / name)
    assert str(of_acquire.value) == str(of_analyze.value) == why_unwritable(tmp_path / name)
    assert not (tmp_path / "gone").exists()


def test_output_must_not_replace_an_input(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    assert "is also an input" in (why_unwritable(tmp_path / "old", tmp_path / "old") or "")
