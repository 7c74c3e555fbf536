"""`analyze frame-rate` on rendered videos."""

from __future__ import annotations

import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import CameraModel
from analyze.verbs.frame_rate.text import capture_fps
from tests.analyze.motion.falling import Drop, pose
from tests.analyze.tracking.rendering import render

CAMERA = CameraModel(
    176, 384, np.array([[330.0, 0, 87.5], [0, 330.0, 191.5], [0, 0, 1]]), np.zeros(5), np.eye(4)
)
DROP = Drop(
    fps=120.0,
    fall=0.35,
    size=0.05,
    distance=0.45,
    spin=(0.4, -0.5, 0.6),
    bounces=False,
    down=(0.02, 1.0, 0.03),
)
TAG = 7


def frame(time, rng):
    R, p = pose(DROP, np.array([time]))
    return render(CAMERA, [(TAG, DROP.size, R[0], p[0])], rng, noise=2.0)


@pytest.fixture(scope="module")
def fall_video(tmp_path_factory):
    """Folder of images, captured at 120 Hz and stated as 30 Hz, and the camera file."""
    folder = tmp_path_factory.mktemp("drop")
    rng = np.random.default_rng(0)
    images = folder / "images"
    images.mkdir()
    rows = ["name,time_s"]
    for number, time in enumerate(np.arange(-6, 34) / DROP.fps + 0.002):
        cv2.imwrite(str(images / f"{number:03}.png"), frame(time, rng))
        rows.append(f"{number:03}.png,{number / 30:.6f}")
    (images / "times.csv").write_text("\n".join(rows) + "\n")
    camera = folder / "camera.json"
    spec = {
        "image_width": CAMERA.width,
        "image_height": CAMERA.height,
        "camera_matrix": CAMERA.K.tolist(),
        "distortion": [0.0] * 5,
    }
    camera.write_text(json.dumps(spec))
    return images, camera


def run(*words):
    return CliRunner().invoke(main, ["frame-rate", *map(str, words)])


def test_rendered_fall_shows_120_hz_stated_as_30(fall_video):
    images, camera = fall_video
    done = run(
        images, "--camera", camera, "--marker-size-mm", "50", "--g", "9.81", "--global-shutter", "--json"
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    assert found["marker"] == TAG
    assert found["stated_frame_rate_hz"] == pytest.approx(30, rel=1e-3)
    assert found["frame_rate_hz"] == pytest.approx(120, rel=5e-3)
    assert abs(found["frame_rate_hz"] - 120) < 3 * found["frame_rate_sd_hz"]
    assert found["capture_fps"] == 120
    assert found["capture_fps_sd"] < min(found["frame_rate_sd_hz"], 0.24)
    said = run(images, "--camera", camera, "--marker-size-mm", "50").output
    assert "with --capture-fps 120 --capture-fps-sd 0." in said
    assert "note: the shutter's line time is unknown" in said


def test_missing_fall_or_tag_is_one_line(fall_video, tmp_path):
    _, camera = fall_video
    rng = np.random.default_rng(1)
    for name, picture in (
        ("still", frame(-1.0, rng)),
        ("blank", np.full((CAMERA.height, CAMERA.width), 120, np.uint8)),
    ):
        folder = tmp_path / name
        folder.mkdir()
        for number in range(12):
            cv2.imwrite(str(folder / f"{number:03}.png"), picture)
        (folder / "times.csv").write_text(
            "name,time_s\n" + "".join(f"{n:03}.png,{n / 30:.6f}\n" for n in range(12))
        )
    still = run(tmp_path / "still", "--camera", camera, "--marker-size-mm", "50")
    assert still.exit_code == 1
    assert "marker 7 is seen in 12 of 12 frames, but no free fall" in still.output
    unknown = run(tmp_path / "still", "--camera", camera, "--marker-size-mm", "50", "--marker", "25h9/0")
    assert unknown.exit_code == 1
    assert "analyze: --marker 25h9/0: '25h9/0' is not the name of a marker" in unknown.output
    blank = run(tmp_path / "blank", "--camera", camera, "--marker-size-mm", "50")
    assert blank.exit_code == 1
    assert "no tag is seen in" in blank.output


@pytest.mark.parametrize(
    ("measured_hz", "half_hz", "stated_hz"),
    [
        (240.04, 0.1, 240.0),
        (240.04, 0.01, 240.04),
        (239.7604, 0.2, 239.8),
        (239.7604, 0.003, 239.76),
        (119.88, 0.0, 119.88),
    ],
)
def test_rate_to_state_lies_within_the_interval(measured_hz, half_hz, stated_hz):
    answer = SimpleNamespace(true_hz=measured_hz, true_sd_hz=half_hz / SIGMAS_95)
    assert capture_fps(answer) == stated_hz


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["x.mp4"], "Missing option '--marker-size-mm'"),
        (["x.mp4", "--marker-size-mm", "40", "--table", "t.png"], "No such option '--table'"),
        (["x.mp4", "y.mp4", "--marker-size-mm", "40"], "unexpected extra argument (y.mp4)"),
        ([".", "--marker-size-mm", "40"], "CSV"),
    ],
)
def test_wrong_usage_is_one_line(words, said):
    done = CliRunner().invoke(main, ["frame-rate", *words])
    assert done.exit_code in (1, 2)
    assert said in done.output
    assert done.output.count("\n") == 1


def test_lens_and_frame_rate_are_calibrated_by_commands_of_their_own():
    options = {
        name: {one for each in verb.params for one in each.opts} for name, verb in main.commands.items()
    }
    assert options["calibrate"].isdisjoint({"--drop", "--marker-size-mm", "--mass-g", "--g", "--capture-fps"})
    assert {"--marker-size-mm", "--mass-g", "--g", "--capture-fps"} <= options["frame-rate"]
