"""Where a file may be written: the same answer for both commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.errors import RecorderError
from acquire.recorder.atomic import refuse_unwritable as acquire_refuses
from schemas.output_file import OutputError, why_unwritable
from schemas.output_file import refuse_unwritable as analyze_refuses


def test_a_new_name_and_one_to_replace_are_fine(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    assert why_unwritable(tmp_path / "new", tmp_path / "old") is None
    assert why_unwritable(tmp_path / "old") is None


@pytest.mark.parametrize("name", ["gone/new", "folder", "old/new"])
def test_both_commands_refuse_alike_and_make_no_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "old").touch()
    with pytest.raises(RecorderError) as of_acquire:
        acquire_refuses(tmp_path / name)
    with pytest.raises(OutputError) as of_analyze:
        analyze_refuses(tmp_path / name)
    assert str(of_acquire.value) == str(of_analyze.value) == why_unwritable(tmp_path / name)
    assert not (tmp_path / "gone").exists()


def test_what_is_read_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    assert "is also an input" in (why_unwritable(tmp_path / "old", tmp_path / "old") or "")
