"""Gravity from strings in view, on rendered images, to within the stated errors; one view may not suffice."""

import json
import tomllib

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from acquire.config import read_rig
from analyze.calibration.plumb import find_plumb_lines, merged_line, table_lean, upright
from analyze.cli import main
from analyze.types import CameraModel
from tests.analyze.calibration.plumb_scenes import LENS, WORLD_CAMERA, Scene, photograph, turned

MATRIX = np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1]])
CAMERA = CameraModel(LENS.width, LENS.height, MATRIX, np.array(LENS.k), WORLD_CAMERA)
PRIOR = np.radians(0.2)
EXACT = 1e-6
SLOPE = np.array([0.004, -0.003])
TWO, ONE = [(-0.05, -0.1), (0.12, 0.05)], [(0.03, 0.02)]


def table(strings, scene=None, seed=1, camera_sd=EXACT):
    image = photograph(strings, SLOPE, np.random.default_rng(seed), scene)
    return table_lean(upright(find_plumb_lines(image, CAMERA), CAMERA), CAMERA, PRIOR, camera_sd)


@pytest.mark.parametrize(
    "scene", [Scene(), Scene(string=240, ground=90), Scene(width_px=5.0), Scene(box=True)]
)
def test_two_strings_determine_both_tilts_within_their_sd(scene):
    found = table(TWO, scene)
    assert found.determined == (True, True)
    assert np.all(np.abs(found.lean - SLOPE) < 3 * found.sd)
    assert found.sd[0] < np.radians(0.006)
    assert found.sd[1] < np.radians(0.04)


def test_one_string_determines_only_the_tilt_across_the_view():
    found = table(ONE)
    assert found.determined == (True, False)
    assert found.lean[0] == pytest.approx(SLOPE[0], abs=3 * found.sd[0])
    assert found.sd[1] > 0.9 * PRIOR


def test_the_sd_includes_the_rotation_of_the_camera():
    found = table(TWO, camera_sd=np.radians(0.1))
    assert np.degrees(found.sd[0]) == pytest.approx(0.1 * 0.2 / np.hypot(0.1, 0.2), rel=0.05), (
        "the camera's and the prior's merged_line"
    )


def test_a_lean_far_beyond_what_was_known_is_doubted():
    """The prior would pull the estimate of a table tilted by 1.4 degrees back by more than its interval."""
    image = photograph(TWO, np.array([0.025, 0.0]), np.random.default_rng(1))
    lines = upright(find_plumb_lines(image, CAMERA), CAMERA)
    far = table_lean(lines, CAMERA, PRIOR, np.radians(0.1))
    assert far.contradicts_prior
    assert far.lean_by_lines[0] == pytest.approx(0.025, abs=2e-4)
    assert far.lean_by_lines[0] - far.lean[0] > 2 * far.sd[0]
    assert not table_lean(lines, CAMERA, np.radians(1.0), np.radians(0.1)).contradicts_prior
    assert not table(TWO, camera_sd=np.radians(0.1)).contradicts_prior


def test_images_of_one_string_are_averaged_and_a_swinging_one_is_known_worse():
    still, swinging = [], []
    for number in range(4):
        rng = np.random.default_rng(number)
        still += find_plumb_lines(photograph(ONE, SLOPE, rng), CAMERA)
        lean = SLOPE + np.array([0.005 * np.sin(number), 0])
        swinging += find_plumb_lines(photograph(ONE, lean, rng), CAMERA)
    assert len(still) == len(swinging) == 4
    assert merged_line(still).end_sd < 0.025
    assert merged_line(swinging).end_sd > 0.2


def test_nothing_is_found_where_there_is_no_string():
    rng = np.random.default_rng(3)
    assert find_plumb_lines(photograph([], SLOPE, rng, Scene(box=True)), CAMERA) == []


RIG = f"""gravity_tilt_sd_rad = 0.0035  # as bought

[camera]
address = "10.0.0.2"

[camera.calibration]
width = 656
height = 492
K = {MATRIX.tolist()}
distortion = {list(LENS.k)}
T_world_camera = {WORLD_CAMERA.tolist()}
"""


def run(*arguments):
    return CliRunner().invoke(main, ["gravity", *map(str, arguments)])


@pytest.fixture(scope="module")
def photographs():
    return {
        name: photograph(strings, SLOPE, np.random.default_rng(5))
        for name, strings in (("two", TWO), ("none", []))
    }


@pytest.fixture
def folder(tmp_path, photographs):
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    for name, image in photographs.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    return tmp_path


def test_the_reading_is_written_where_the_estimate_finds_it(folder):
    rig = folder / "rig.toml"
    answer = run(
        folder / "two.png",
        "--rig",
        rig,
        "--camera-sd-deg",
        "0.03",
        "--write",
        "--picture",
        folder / "seen.png",
    )
    assert answer.exit_code == 0, answer.output
    assert "table tilt towards +x" in answer.output
    assert rig.read_text(encoding="utf-8").startswith(RIG)
    level = read_rig(rig).level
    assert (level.towards_x_rad, level.towards_y_rad) == pytest.approx(tuple(SLOPE), abs=1.5e-3)
    assert level.towards_x_sd_rad == pytest.approx(np.radians(0.03), rel=0.1)
    assert level.read_by == "plumb line"
    assert cv2.imread(str(folder / "seen.png")).shape == (492, 656, 3)
    again = run(folder / "two.png", "--rig", rig, "--camera-sd-deg", "0.03", "--json")
    document = json.loads(again.stdout)
    assert document["determined"] == [True, True]
    assert len(document["strings"]) == 2
    assert (
        tomllib.loads("\n".join(f"{key} = {value}" for key, value in document["level"].items()))["read_by"]
        == "plumb line"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("two.png",), "give --rig RIG.toml"),
        (("none.png", "--rig", "rig.toml"), "no plumb line is seen in 1 image: hang a thin string"),
        (
            ("two.png", "--rig", "rig.toml", "--camera-sd-deg", "1"),
            "do not determine the table's tilt towards +x: ±0.2",
        ),
    ],
)
def test_what_cannot_be_determined_is_refused_in_one_line(folder, arguments, said):
    found = run(*(folder / each if "." in each and each[0].isalpha() else each for each in arguments))
    assert found.exit_code == 1
    assert said in found.stderr
    assert len(found.stderr.strip().splitlines()) == 1


def test_a_tilted_camera_is_distinguished_from_a_tilted_table():
    image = photograph(TWO, SLOPE, np.random.default_rng(7), pose=turned(WORLD_CAMERA, (0.03, 0.05, -0.02)))
    leaning = CameraModel(
        LENS.width, LENS.height, MATRIX, np.array(LENS.k), turned(WORLD_CAMERA, (0.03, 0.05, -0.02))
    )
    found = table_lean(upright(find_plumb_lines(image, leaning), leaning), leaning, PRIOR, EXACT)
    assert np.all(np.abs(found.lean - SLOPE) < 3 * found.sd)


def test_a_table_stated_level_is_reported_as_level(folder):
    rig = folder / "exact.toml"
    rig.write_text(RIG.replace("0.0035", "0.0"), encoding="utf-8")
    answer = run(folder / "two.png", "--rig", rig)
    assert answer.exit_code == 1
    assert "gravity_tilt_sd_rad is 0" in answer.stderr


def test_many_dark_lines_do_not_hide_a_bright_string():
    """Eight dark lines are found at every scale, which was as many as were searched for in all."""
    image = np.full((LENS.height, LENS.width), 120, np.uint8)
    image[: LENS.height // 2, 60:620:70] = 30
    image[:, 345:348] = 230
    straight = CameraModel(LENS.width, LENS.height, MATRIX, np.zeros(5), WORLD_CAMERA)
    assert not find_plumb_lines(image, straight)[0].dark
