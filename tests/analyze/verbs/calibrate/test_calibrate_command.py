"""`analyze calibrate` as a user types it, on rendered images of a printed board."""

import json
import pickle
import tomllib

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from acquire.config import read_rig
from acquire.recorder.image import RawImageEncoder
from analyze.calibration import choose
from analyze.cameras import calibrate
from analyze.cli import main
from schemas import topics
from schemas.document import canonical_json
from schemas.session_manifest import LensModel, TimeSource
from tests.analyze.calibration.boards import TrueBoard, TrueLens, facing, photograph
from tests.analyze.importing.tip_videos import write_video
from tests.analyze.tracking.rendering import Look
from tests.full_disk import full_disk
from tests.mcap_writer import McapWriter
from tests.small_recording import START_NS, manifest, write_head

PRINTED = TrueBoard(5, 7)
LENS = TrueLens(328, 246, 715.0, 715.5, 166.0, 120.0, (-0.12, 0.1, 3e-4, -2e-4, 0.0))
SQUARES = ("--squares", "5x7")
RIG = """name = "bench"
gravity_tilt_sd_rad = 0.0021

[camera]  # ours
address = "10.0.0.2"
width = 328
height = 246

[camera.calibration]  # of the region
width = 328
height = 246
K = [
  [700, 0, 164],
  [0, 700, 123],
  [0, 0, 1],
]
T_world_camera = [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]]

# how hard it hits
[striker]
kind = "manual"
"""
WORLD_CAMERA = np.array([[1.0, 0, 0, 0.06], [0, -0.6, 0.8, -0.25], [0, -0.8, -0.6, 0.28], [0, 0, 0, 1]])
"""camera pose that looks down on the table at 37 degrees"""


@pytest.fixture(scope="module", autouse=True)
def made_once():
    """Cache the results of pure functions: most tests use the same seven images."""

    def remembered(pure):
        known = {}

        def call(*given):
            key = pickle.dumps([each for each in given if not callable(each)])  # all but the progress
            if key not in known:
                known[key] = pure(*given)
            return known[key]

        return call

    with pytest.MonkeyPatch.context() as patch:
        for name in ("read_board", "find_corners", "calibrate"):
            patch.setattr(calibrate, name, remembered(getattr(calibrate, name)))
        yield


def run(*arguments):
    return CliRunner().invoke(main, ["calibrate", *map(str, arguments)])


def photo(path, pose, seed, look=None, lens=LENS):
    cv2.imwrite(str(path), photograph(lens, PRINTED, *pose, np.random.default_rng(seed), look))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Seven views; in folders beside them the board on the table, a blurred view, and one without a board."""
    images = tmp_path_factory.mktemp("images")
    rng = np.random.default_rng(3)
    for number in range(7):
        x, y = [(-0.5, -0.4), (0.5, -0.4), (-0.5, 0.4), (0.5, 0.4), (0, 0), (0.3, 0.0), (-0.3, 0.1)][number]
        middle = [0.16 * x * 0.4, 0.12 * y * 0.4, 0.4]
        photo(
            images / f"{number}.png",
            facing(PRINTED, middle, rng.uniform(0.4, 0.7), 0.9 * number, 0.3 * number),
            number,
        )
    for extra in ("table", "blurred", "empty"):
        (images / extra).mkdir()
    R = WORLD_CAMERA[:3, :3].T
    photo(images / "table" / "lying.png", (R, R @ (np.array([0.0, 0.0, 0.003]) - WORLD_CAMERA[:3, 3])), 20)
    photo(
        images / "blurred" / "b.png", facing(PRINTED, [0.01, 0.01, 0.33], 0.3, 2.0, 0.1), 21, Look(blur=1.8)
    )
    cv2.imwrite(str(images / "empty" / "e.png"), np.full((246, 328), 120, np.uint8))
    return images


def test_calibration_is_written_into_the_rig_file(folder, tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG)
    out = run(folder, *SQUARES, "--rig", rig, "--write", "-o", tmp_path / "camera.toml", "--json")
    assert out.exit_code == 0, out.output
    found = json.loads(next(line for line in out.stdout.splitlines() if line.startswith("{")))
    for name, true in (("fx", LENS.fx), ("fy", LENS.fy), ("cx", LENS.cx), ("cy", LENS.cy)):
        assert abs(found["numbers"][name]["value"] - true) < 4 * found["numbers"][name]["sd"]
    assert found["numbers"]["fx"]["sd"] < 0.002 * LENS.fx
    assert found["gravity_tilt_sd_rad"] == 0.0021
    assert any("the vertical" in note for note in found["notes"])
    read = read_rig(rig)
    assert read.camera.calibration.K[0][0] == pytest.approx(found["numbers"]["fx"]["value"], abs=1e-3)
    assert read.camera.calibration.T_world_camera[0][3] == 0.03
    assert read.striker.kind == "manual"
    kept = [
        line
        for line in RIG.splitlines()
        if line and not line.startswith(("K", "  [", "]", "T_", "width = 328", "height"))
    ]
    assert [line for line in kept if line not in rig.read_text()] == []
    written = tomllib.loads((tmp_path / "camera.toml").read_text())["camera"]["calibration"]
    assert written == tomllib.loads(rig.read_text())["camera"]["calibration"]
    assert cv2.imread(str(tmp_path / "camera.png")).shape[1] > 1000


def test_notes_without_rig_and_table_are_for_videos_too(folder):
    out = run(folder, *SQUARES, "--json")
    assert out.exit_code == 0, out.output
    (note,) = json.loads(out.stdout)["notes"]
    assert "for videos `analyze import` finds it" in note
    assert "for a rig give --table IMAGE" in note


def test_camera_pose_from_the_board_on_the_table(folder):
    out = run(folder, *SQUARES, "--table", folder / "table" / "lying.png", "--mark-mm", "0,0,3", "--json")
    assert out.exit_code == 0, out.output
    place = json.loads(out.stdout)["place"]
    T = np.array(place["T_world_camera"])
    assert np.all(np.abs(T - WORLD_CAMERA)[:3, 3] < 4 * np.array(place["position_sd_m"]))
    assert max(place["position_sd_m"]) < 3e-4
    turned = np.degrees(np.arccos(min(1.0, 0.5 * (np.trace(T[:3, :3].T @ WORLD_CAMERA[:3, :3]) - 1))))
    assert turned < 4 * np.degrees(np.linalg.norm(place["turn_sd_rad"]))


def test_videos_of_the_board_give_the_same_calibration(folder, tmp_path):
    """Each view is held for a while, as by hand; of the table's video the first image is used."""
    views = [cv2.imread(str(folder / f"{number}.png"), cv2.IMREAD_GRAYSCALE) for number in range(7)]
    lying = cv2.imread(str(folder / "table" / "lying.png"), cv2.IMREAD_GRAYSCALE)
    still = write_video(
        tmp_path / "board.mkv", [view for view in views for _ in range(30)], codec="ffv1", pixels="gray"
    )
    table = write_video(tmp_path / "table.MP4", [lying] * 3, qp="0", preset="ultrafast", pixels="gray")
    measured = run(
        still, *SQUARES, "--table", table, "--mark-mm", "0,0,3", "--json", "-o", tmp_path / "camera.toml"
    )
    assert measured.exit_code == 0, measured.output
    said = json.loads(next(line for line in measured.stdout.splitlines() if line.startswith("{")))
    for name, true in (("fx", LENS.fx), ("fy", LENS.fy), ("cx", LENS.cx), ("cy", LENS.cy)):
        assert abs(said["numbers"][name]["value"] - true) < 4 * said["numbers"][name]["sd"]
    assert np.all(
        np.abs(np.array(said["place"]["T_world_camera"]) - WORLD_CAMERA)[:3, 3]
        < 4 * np.array(said["place"]["position_sd_m"])
    )
    bare = run(
        write_video(
            tmp_path / "bare.mkv", [np.full((246, 328), 120, np.uint8)] * 3, codec="ffv1", pixels="gray"
        ),
        *SQUARES,
    )
    assert bare.exit_code == 1
    assert bare.output.count("\n") <= 2


def test_printed_calibration_table(folder):
    out = run(f"{folder}/?.png", folder / "0.png", folder / "blurred", folder / "empty", *SQUARES)
    assert out.exit_code == 0, out.output
    text = " ".join(out.stdout.split())
    for said in (
        "pinhole, 328 x 246 px, 7 views",
        "fx 71",
        "at worst",
        "no board in",
        "e.png",
        "b.png: blurred, 1.",
        "T_world_camera",
    ):
        assert said in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere",), "nowhere: no such file or folder: check the path"),
        (
            ("{images}/empty", *SQUARES),
            "the image shows no board with tags of 5x5_100: the board must be in focus",
        ),
        (("{images}/0.png", "--family", "4x4_100"), "tags of 5x5_100: try --family 5x5_100"),
        (
            ("{images}",),
            "another board: its tags are not arranged as on a board of 7x9 squares: try --squares 5x7",
        ),
        (
            ("{images}", "--squares", "5x5"),
            (
                "another board: it shows tag 16, but the last tag of a board of 5x5 squares is 11: try "
                "--squares 5x7"
            ),
        ),
        (
            ("{images}/[012].png", *SQUARES),
            "3 views of the board from 3 images: at least 6 are needed, 15 are good",
        ),
        (("{images}", *SQUARES, "--rig", "{rig}"), "0.png has 328 x 246 px, the rig's camera 656 x 492"),
        (
            ("{images}", *SQUARES, "--table", "{images}/empty/e.png"),
            "e.png: shows too little of the board (0 tags)",
        ),
        (("{rig}",), "rig.toml: not a readable image"),
        (("{images}", "--squares", "seven"), "--squares seven: not understood"),
    ],
)
def test_unusable_input_is_one_line_with_the_remedy(folder, tmp_path, arguments, said):
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.replace("width = 328", "width = 656", 1).replace("height = 246", "height = 492", 1))
    out = run(*(argument.format(images=folder, rig=rig) for argument in arguments))
    assert out.exit_code == 1
    (line,) = out.stderr.splitlines()
    assert line.startswith("analyze: ")
    assert said in line


def test_a_full_disk_leaves_no_camera_file(folder, tmp_path):
    with full_disk(50):
        out = run(folder, *SQUARES, "-o", tmp_path / "camera.toml")
    assert out.exit_code == 1
    (line,) = out.stderr.splitlines()
    assert line.startswith(f"analyze: {tmp_path / 'camera.'}")
    assert ": cannot be written: " in line
    assert not list(tmp_path.iterdir())


def test_bent_board_is_left_out_and_a_finger_does_no_harm(folder, tmp_path):
    R, p = facing(PRINTED, [0.01, -0.01, 0.38], 0.5, 3.0, 0.4)
    bent = photograph(LENS, TrueBoard(5, 7, bend=0.004), R, p, np.random.default_rng(30))
    cv2.imwrite(str(tmp_path / "bent.png"), bent)
    finger = cv2.imread(str(folder / "4.png"), cv2.IMREAD_GRAYSCALE)
    cv2.ellipse(finger, (150, 246), (18, 130), 12, 0, 360, 150, -1)
    cv2.imwrite(str(tmp_path / "finger.png"), finger)
    out = run(*(folder / f"{number}.png" for number in (0, 1, 2, 3, 5, 6)), tmp_path, *SQUARES, "--json")
    assert out.exit_code == 0, out.output
    found = json.loads(out.stdout)
    (left,) = found["dropped"]
    assert left["name"].endswith("bent.png")
    assert "the board was bent" in left["reason"]
    used = {view["name"].rsplit("/", 1)[-1]: view for view in found["views"]}
    assert 6 <= used["finger.png"]["corners"] < 24
    for name, true in (("fx", LENS.fx), ("cx", LENS.cx)):
        assert abs(found["numbers"][name]["value"] - true) < 4 * found["numbers"][name]["sd"]
    assert found["scatter"] < 1.3


@pytest.mark.slow
def test_fisheye_calibration(tmp_path):
    lens = TrueLens(328, 246, 200.0, 200.2, 166.0, 121.0, (0.05, -0.02, 0.003, -0.001), LensModel.FISHEYE)
    rng = np.random.default_rng(5)
    for number in range(16):
        across, down = np.radians([-32, -10, 10, 32][number % 4]), np.radians([-24, -8, 8, 24][number // 4])
        middle = 0.12 * np.array([np.tan(across), np.tan(down), 1.0])
        R, p = facing(PRINTED, middle, rng.uniform(0.2, 0.5), rng.uniform(0, 6.28), rng.uniform(0, 6.28))
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), photograph(lens, PRINTED, R, p, rng, pieces=2))
    out = run(tmp_path, *SQUARES, "--model", "fisheye", "--json")
    assert out.exit_code == 0, out.output
    found = json.loads(out.stdout)
    z = [
        (found["numbers"][name]["value"] - value) / found["numbers"][name]["sd"]
        for name, value in zip(
            ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
            (200.0, 200.2, 166.0, 121.0, *lens.k),
            strict=True,
        )
    ]
    assert np.abs(z).max() < 4.5
    assert found["pixel_sd"]["median_px"] < 0.1


def test_recording_gives_each_board_position_once(folder, tmp_path):
    path = tmp_path / "board.mcap"
    writer = McapWriter(path)
    write_head(writer, canonical_json(manifest(time_source=TimeSource.CONTAINER_PTS)))
    topic, encoder = writer.add_topic(topics.raw_image("main")), RawImageEncoder("camera", 328, 246)
    pictures = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted(folder.glob("*.png"))]
    for number in range(30 * len(pictures)):  # 60 frames per second, half a second a place
        time_ns = START_NS + number * 16_666_667
        writer.write(topic, time_ns, encoder.encode(time_ns, pictures[number // 30]), sequence=number)
    writer.finish()
    out = run(path, *SQUARES, "--json")
    assert out.exit_code == 0, out.output
    found = json.loads(out.stdout)
    assert len(found["views"]) == len(pictures)
    assert found["images"] < 5 * 0.5 * len(pictures) + 2
    assert found["alike"] == found["images"] - len(pictures)
    assert "board.mcap at 0." in found["views"][0]["name"]


def test_views_beyond_the_most_are_not_counted_as_repeated_places(folder, monkeypatch):
    monkeypatch.setattr(choose, "MOST_VIEWS", 6)
    found = json.loads(run(folder, *SQUARES, "--json").stdout)
    assert (len(found["views"]), found["alike"], found["surplus"]) == (6, 0, 1)
    text = run(folder, *SQUARES).stdout
    assert "1 of 7 images not used: 40 views, which differ more, are enough" in text
    assert "in the same place" not in text


def test_rig_without_camera_pose_is_refused_before_calibrating(folder, tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text('[camera]\naddress = "10.0.0.2"\nwidth = 328\nheight = 246\n')
    out = run("nowhere", *SQUARES, "--rig", rig, "--write")
    assert out.exit_code == 1
    assert "has no camera pose (T_world_camera), and none is measured here: add --table IMAGE" in out.stderr


def test_images_of_different_sizes_are_refused(folder, tmp_path):
    cv2.imwrite(str(tmp_path / "large.png"), np.zeros((480, 640), np.uint8))
    out = run(folder / "0.png", tmp_path / "large.png", *SQUARES)
    assert out.exit_code == 1
    assert "large.png has 640 x 480 px" in out.stderr
    assert "328 x 246: all must come from one camera with one region" in out.stderr


def test_undetermined_lens_is_refused_and_drawn(tmp_path):
    for number in range(6):
        photo(
            tmp_path / f"{number}.png",
            facing(
                PRINTED, [0.012 * (number - 3), 0.005, 0.33 + 0.02 * number], 0.01, 0.9 * number, 0.5 * number
            ),
            number,
        )
    out = run(tmp_path, *SQUARES, "-o", tmp_path / "camera.toml")
    assert out.exit_code == 1
    assert "6 views do not determine the lens: focal length" in out.stderr
    assert "all boards face the camera within" in out.stderr
    assert (tmp_path / "camera.png").exists()
    assert not (tmp_path / "camera.toml").exists()


def test_usage():
    assert run("x.png", "--write").exit_code == 2
    assert run("x.png", "--upright").exit_code == 2
    assert run("x.png", "--mark-mm", "1,2").exit_code == 2
