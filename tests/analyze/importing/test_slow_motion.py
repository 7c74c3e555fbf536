"""Slow motion from videos to the result: files that state a fraction of the frame rate of their strikes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main
from tests.analyze.importing.tipped_boxes import BODY, images, strikes, write_videos

pytestmark = pytest.mark.usefixtures("coarse_regions")

RATE, STATED = 120, 15


@pytest.fixture(scope="module")
def drawn():
    return images(strikes(3), RATE)


def run(*words):
    done = CliRunner().invoke(main, [str(word) for word in words])
    return done, " ".join(done.output.split())


def imported(folder, drawn, stated, *more, only=slice(None)):
    paths, files = write_videos(folder, strikes(3)[only], drawn[only], stated)
    output = folder / "session.mcap"
    done, said = run("import", *paths, *files, "-o", output, *more)
    assert done.exit_code == 0, said
    return output


def answer(file):
    done, said = run("estimate", file, "--json")
    assert done.exit_code == 0, said
    return json.loads(done.output)


@pytest.mark.slow
def test_8_times_slow_motion_is_found_and_the_remedy_is_right(tmp_path, drawn):
    """Three videos imported twice; pipeline/test_frame_rate.py has the same without videos."""
    (tmp_path / "wrong").mkdir()
    wrong = imported(tmp_path / "wrong", drawn, STATED)
    found = answer(wrong)
    (said,) = [sentence for sentence in found["verdict"] if "frame rate" in sentence]
    assert said.startswith(
        "doubt the frame rate: no body of this shape tips like this at the stated 15 frames a second"
    )
    assert "probably 120 (8 times): import again with --capture-fps 120" in said
    (times,) = found["frame_times"]
    assert not times["possible"]
    assert times["likely_rate_hz"] == pytest.approx(120, abs=0.01)
    assert times["rate_limits"][0] < 8 < times["rate_limits"][1]

    (tmp_path / "right").mkdir()
    found = answer(
        imported(tmp_path / "right", drawn, STATED, "--capture-fps", str(RATE), "--capture-fps-sd", "0.3")
    )
    (times,) = found["frame_times"]
    assert times["possible"]
    assert times["frame_rate_sd_hz"] == 0.3
    assert times["rate_limits"][0] < 1 < times["rate_limits"][1]
    off = np.array(found["centre_of_mass"]["value"]) - BODY.com
    assert np.linalg.norm(off[[0, 2]]) < 1e-3


def test_32_times_slow_motion_is_found_though_no_strike_is_readable(tmp_path, drawn):
    done, said = run("estimate", imported(tmp_path, drawn, RATE / 32, only=slice(1, 2)))
    assert done.exit_code == 1
    assert "0 good strikes of 1" in said
    assert said.endswith("(slow motion?): import again with --capture-fps 120")
