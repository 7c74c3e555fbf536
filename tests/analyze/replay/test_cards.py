"""Placement cards in rerun: a timeline step per strike, with visible contents."""

import resource
import time

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cards.page import placement_cards
from analyze.cli import main
from analyze.geometry.object_model import load_object_model
from analyze.planning.impact import StrikerModel
from analyze.planning.view import default_camera
from analyze.reading.object_file import read_object_files
from analyze.replay.cards import STRIKE, card_text, log_scenes, write_card_scenes
from analyze.replay.picture import headless_viewer
from schemas.output_file import OutputError
from tests.analyze.planning.planned import make_plan
from tests.places import CARTON


@pytest.fixture(scope="module")
def planned():
    files = read_object_files(CARTON)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    return make_plan(model, files.spec, files.sha256, StrikerModel(), strikes=4), model, files.spec


@pytest.fixture(scope="module")
def rrd(planned, tmp_path_factory):
    output = tmp_path_factory.mktemp("cards") / "cards.rrd"
    write_card_scenes(*planned, default_camera(), output)
    return output


class RecordingStreamSpy:
    """Stand-in for a rerun stream that keeps what is logged, by step and path; it sends nothing."""

    def __init__(self):
        self.step, self.logged = 0, {}

    def set_time(self, timeline, *, sequence):
        assert timeline == STRIKE
        self.step = sequence

    def log(self, path, *things, static=False):
        assert static == (self.step == 0)
        for thing in things:
            self.logged[self.step, path, type(thing).__name__] = thing


def numbers(batch):
    return np.concatenate([np.ravel(row) for row in batch.as_arrow_array().to_pylist()])


def test_object_lies_as_planned_at_each_timeline_step(planned):
    plan, model, spec = planned
    kept = RecordingStreamSpy()
    log_scenes(kept, plan, model, spec, default_camera())
    assert {step for step, _, _ in kept.logged} == set(range(len(plan.strikes) + 1))
    for number, strike in enumerate(plan.strikes, start=1):
        pose = kept.logged[number, "/world/object", "Transform3D"]
        # rerun keeps matrices column by column, as 32 bit floats
        turned = numbers(pose.mat3x3).reshape(3, 3).T
        assert turned == pytest.approx(np.array(strike.R_world_object), abs=1e-6)
        assert numbers(pose.translation) == pytest.approx(np.array(strike.p_world_object), abs=1e-6)
        arrow = kept.logged[number, "/world/striker", "Arrows3D"]
        head = numbers(arrow.origins) + numbers(arrow.vectors)
        assert head[1:] == pytest.approx([0.0, strike.impact_height_m], abs=1e-6)
        assert numbers(arrow.vectors)[0] > 0
        camera = kept.logged[number, "/world/camera", "Transform3D"]
        assert numbers(camera.translation) == pytest.approx(np.array(strike.camera_pose)[:3, 3], abs=1e-6)


def test_file_is_complete(rrd):
    assert rrd.read_bytes()[:4] == b"RRF2"
    assert [path.name for path in rrd.parent.iterdir()] == ["cards.rrd"]


def test_texts_equal_those_of_the_printed_cards(planned):
    plan = planned[0]
    for card in placement_cards(*planned):
        text = card_text(card)
        assert card.put_down in text
        assert f"{1000 * plan.strikes[card.number - 1].impact_height_m:.0f} mm" in text


def test_command_writes_the_file_and_leaves_no_part_file(tmp_path):
    out = CliRunner().invoke(
        main, ["plan", str(CARTON), "--strikes", "3", "--rerun", str(tmp_path / "c.rrd")]
    )
    assert out.exit_code == 0, out.output
    assert "rerun: " in out.output
    assert [path.name for path in tmp_path.iterdir()] == ["c.rrd"]


def test_unwritable_path_gives_a_one_line_error(planned, tmp_path):
    with pytest.raises(OutputError, match="create it first"):
        write_card_scenes(*planned, default_camera(), tmp_path / "gone" / "c.rrd")


@pytest.mark.slow
def test_rendered_picture_is_not_blank(rrd, vulkan, tmp_path):
    picture = tmp_path / "c.png"
    with headless_viewer(rrd) as client:
        client.set_time(STRIKE, sequence=1)
        time.sleep(1.5)
        client.save_screenshot(str(picture))
    assert cv2.imread(str(picture)).std() > 10


@pytest.mark.slow  # rerun's own writer sometimes waits for ever on a full disk, on a busy machine
@pytest.mark.timeout(120)
@pytest.mark.parametrize("missing_bytes", [200, 2000, None])
def test_a_full_disk_leaves_no_file(planned, rrd, tmp_path, missing_bytes):
    """Up to the last block; rerun itself does not report that a file's end is missing."""
    most = rrd.stat().st_size - missing_bytes if missing_bytes else 1000
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))  # Python ignores the signal
    try:
        with pytest.raises(OutputError, match="free space on its disk"):
            write_card_scenes(*planned, default_camera(), tmp_path / "cards.rrd")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
