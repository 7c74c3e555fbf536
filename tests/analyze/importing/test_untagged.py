"""Import of videos of an object without a tag, on the mat: from files to the centre of mass."""

import json
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.pipeline.estimate_recordings import estimate_recordings
from analyze.reading.object_file import read_object_files
from schemas.strike_result import Verdict
from tests import make_phone_videos as phone
from tests.analyze.importing.mat_videos import LENS, PHONE, write_strikes


def untagged(folder: Path) -> tuple[Path, Path]:
    """Object file of the tea box without tags, and the sample's plan for it."""
    box, plan_path = folder / "box.toml", folder / "plan.json"
    text = (PHONE / "teabox.toml").read_text(encoding="utf-8")
    box.write_text(text.partition("# Each T_object_marker")[0], encoding="utf-8")
    plan = json.loads((PHONE / "plan.json").read_text(encoding="utf-8"))
    plan["object_sha256"] = read_object_files(box).sha256
    for strike in plan["strikes"]:
        strike["visible_markers"] = []
    plan_path.write_text(json.dumps(plan), encoding="utf-8")
    return box, plan_path


@pytest.mark.parametrize(
    ("numbers", "limit_mm"), [([0, 1, 4], 0.5), pytest.param([*range(6)], 0.2, marks=pytest.mark.slow)]
)
def test_videos_of_an_untagged_box_on_the_mat_give_its_centre_of_mass(tmp_path, numbers, limit_mm):
    box, plan = untagged(tmp_path)
    names = write_strikes(tmp_path, numbers, {}, tags=False)
    options = ImportOptions(
        tuple(tmp_path / f"{name}.mp4" for name in names), box, plan, tmp_path / "camera.toml"
    )
    with prepare(options) as prepared:
        assert any("the object has no tag" in each for each in prepared.remarks())
        write_recording(prepared, tmp_path / "t.mcap")
    estimate = estimate_recordings([tmp_path / "t.mcap"])
    assert [motion.verdict for motion in estimate.evidence.motions] == [Verdict.GOOD] * len(numbers)
    assert 1e3 * np.linalg.norm(estimate.inertial.com.position - phone.COM) < limit_mm


def test_an_untagged_object_needs_a_mat_or_the_camera_s_pose(tmp_path):
    box, plan = untagged(tmp_path)
    (tmp_path / "camera.toml").write_text(LENS, encoding="utf-8")
    with (
        pytest.raises(ImportRefused, match=r"box\.toml: has no tag, so that only a mat"),
        prepare(ImportOptions((PHONE / "VID_20260412_101500.mp4",), box, plan, tmp_path / "camera.toml")),
    ):
        pass
