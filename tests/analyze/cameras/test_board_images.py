"""Images of a board from recordings."""

from __future__ import annotations

import pytest

from analyze.cameras.board_images import read_images, resolve_inputs
from analyze.errors import CalibrationError
from analyze.progress import no_progress
from tests import small_recording as small


def test_a_recording_is_known_by_its_name_in_any_case(tmp_path):
    path = tmp_path / "A.MCAP"
    small.write_recording(tmp_path / "a.mcap")
    (tmp_path / "a.mcap").rename(path)
    [(name, image), *_] = read_images([path], no_progress)
    assert name == f"{path} at 0.0 s"
    assert (image == small.image(0)).all()


def test_a_pattern_that_matches_no_image_is_refused(tmp_path):
    (tmp_path / "board.txt").touch()
    with pytest.raises(CalibrationError, match=r"board\*: matches no image, video or recording, only such"):
        resolve_inputs([tmp_path / "board*"])
    (tmp_path / "board.png").touch()
    assert resolve_inputs([tmp_path / "board*"]) == [tmp_path / "board.png"]
