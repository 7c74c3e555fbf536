"""Sample phone videos: the commands of the tutorial, as printed, give the answer that belongs to them."""

from __future__ import annotations

import json
import os
import re
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.prepared_import import Assignment
from tests import make_phone_videos as renderer
from tests.docs.pages import DOCS, FENCE, text_of
from tests.places import ROOT

SAMPLE = DOCS / "examples" / "phone"
MAX_BYTES = 8_000_000


def section_lines(page: Path, title: str) -> list[str]:
    """Lines of the shell blocks in one section of a page."""
    (section,) = re.findall(rf"^## {title}\n(.*?)(?=^## )", text_of(page), re.MULTILINE | re.DOTALL)
    return [line for kind, body in FENCE.findall(section) if kind == "sh" for line in body.splitlines()]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_tutorials_commands_give_the_expected_answer(tmp_path):
    lines = section_lines(DOCS / "tutorial" / "phone.md", "First, with sample videos")
    assert lines[0] == "cp -r docs/examples/phone sample"
    (tmp_path / "docs" / "examples").mkdir(parents=True)
    (tmp_path / "docs" / "examples" / "phone").symlink_to(SAMPLE)
    lines[0] = lines[0].replace("cp -r", "cp -rL")
    environment = os.environ | {
        "PATH": f"{ROOT / '.venv' / 'bin'}:{os.environ['PATH']}",
        "HOME": str(tmp_path),
    }
    done = subprocess.run(
        ["bash", "-ec", "\n".join([*lines, "analyze estimate sample/teabox.mcap --json > answer.json"])],
        cwd=tmp_path,
        env=environment,
        input="",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    answer = json.loads((tmp_path / "answer.json").read_text(encoding="utf-8"))
    expected = tomllib.loads((SAMPLE / "expected.toml").read_text(encoding="utf-8"))
    com = np.array(answer["centre_of_mass"]["value"])
    assert np.linalg.norm(com - expected["com_m"]) < 2e-4
    low, high = np.array(answer["centre_of_mass"]["interval95"]).T
    assert np.all((low < expected["com_m"]) & (expected["com_m"] < high))
    found, true = np.array(answer["inertia"]["value"]), np.array(expected["inertia_kg_m2"])
    assert np.diag(found)[:2] == pytest.approx(np.diag(true)[:2], rel=0.03)
    assert all(strike["used"] for strike in answer["strikes"])


def test_the_sample_is_complete_and_small():
    names = {path.name for path in SAMPLE.iterdir()}
    assert {"teabox.toml", "plan.json", "board.mp4", "expected.toml"} <= names
    assert len(list(SAMPLE.glob("VID_*.mp4"))) == 6
    assert sum(path.stat().st_size for path in SAMPLE.iterdir()) <= MAX_BYTES
    assert (SAMPLE / "teabox.toml").read_bytes() == (SAMPLE.parent / "teabox.toml").read_bytes()


def test_a_sample_video_is_recognised_among_the_planned_strikes(tmp_path):
    lens = tmp_path / "camera.toml"
    lens.write_text(
        f"[camera.calibration]\nwidth = {renderer.WIDTH}\nheight = {renderer.HEIGHT}\n"
        f"K = {renderer.K.tolist()}\ndistortion = [{renderer.K1}, 0, 0, 0, 0]\n",
        encoding="utf-8",
    )
    video = SAMPLE / "VID_20260412_101537.mp4"
    with prepare(ImportOptions((video,), SAMPLE / "teabox.toml", SAMPLE / "plan.json", lens)) as prepared:
        assert [window.plan_strike_id for window in prepared.windows] == ["s5"]
        assert prepared.assignment is Assignment.IMAGES
