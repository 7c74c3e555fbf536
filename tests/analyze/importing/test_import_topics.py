"""A tip in a Foxglove MCAP file or a ROS 2 bag is imported as a recording and analysed."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.rosbag2 import StoragePlugin

from analyze.cli import main
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.reading.recording import open_recording
from schemas.session_manifest import TimeSource
from schemas.strike_result import Verdict
from tests.analyze.importing.foreign_files import START_NS, write_bag, write_foxglove
from tests.analyze.importing.tip_videos import FOCAL, HEIGHT, PHI, RATE, WIDTH, K, setting, tip

INTRINSICS = [FOCAL, 0.0, 159.5, 0.0, FOCAL, 119.5, 0.0, 0.0, 1.0]


def run(folder, source, *more, lens=True):
    object_path, plan_path, camera_path = setting(folder)
    camera = ["--camera", str(camera_path)] if lens else []
    output = folder / "imported.mcap"
    arguments = [
        "import",
        str(source),
        "--object",
        str(object_path),
        "--plan",
        str(plan_path),
        *camera,
        "-o",
        str(output),
        *more,
    ]
    return CliRunner().invoke(main, arguments), output


@pytest.mark.parametrize("kind", ["foxglove", "sqlite3", "mcap"])
def test_imported_tip_is_analysed(tmp_path, kind):
    if kind == "foxglove":
        source = write_foxglove(tmp_path / "a.mcap", list(tip()), "bgr8", intrinsics=INTRINSICS)
    else:
        source = write_bag(
            tmp_path / "bag", list(tip()), "png", StoragePlugin[kind.upper()], intrinsics=INTRINSICS
        )
    done, output = run(tmp_path, source)
    assert done.exit_code == 0, done.output
    [motion] = read_evidence(read_head(output)).motions
    assert motion.verdict is Verdict.GOOD, motion.reason
    assert motion.fit.phi == pytest.approx(PHI, abs=np.radians(0.1))
    assert motion.fit.k == pytest.approx(K, rel=0.01)
    with open_recording(output) as recording:
        images = list(recording.images())
        assert abs(images[0].time_ns - START_NS) < 2 * 10**9
        assert np.array_equal(images[-1].image, tip()[-1])
        assert recording.manifest.time_source is TimeSource.CONTAINER_PTS
        assert recording.manifest.cameras[0].frame_rate_hz == pytest.approx(RATE, rel=1e-4)


def test_lens_from_the_bag_and_pose_from_the_object(tmp_path):
    source = write_bag(tmp_path / "bag", list(tip()), intrinsics=INTRINSICS)
    done, output = run(tmp_path, source, lens=False)
    assert done.exit_code == 0, done.output
    assert f"the lens is that of {source}:/cam/camera_info" in " ".join(done.output.split())
    with open_recording(output) as recording:
        spec = recording.manifest.cameras[0].calibration
        assert (spec.width, spec.height, np.ravel(spec.K).tolist()) == (WIDTH, HEIGHT, INTRINSICS)
        assert recording.attachments["camera/camera_info.json"]
    [motion] = read_evidence(read_head(output)).motions
    assert motion.fit.phi == pytest.approx(PHI, abs=np.radians(0.2))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--topic", "/other"], "no such topic: it has /cam/image"),
        (["--capture-fps", "240"], "--capture-fps does not apply to message files"),
        ([], "its lens is unknown: give --camera"),
    ],
)
def test_wrong_import_options_are_one_line(tmp_path, more, said):
    source = write_foxglove(tmp_path / "a.mcap", list(tip())[:3], calibrated=False)
    done, output = run(tmp_path, source, *more, lens=bool(more))
    assert done.exit_code == 1
    assert said in " ".join(done.output.split())
    assert not output.exists()


def test_topic_option_is_refused_for_other_sources(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"")
    done, _ = run(tmp_path, tmp_path / "a.mp4", "--topic", "/cam/image")
    assert "--topic applies to MCAP files and ROS 2 bags" in done.output
    (tmp_path / "a.bag").write_bytes(b"")
    done, _ = run(tmp_path, tmp_path / "a.bag")
    assert "is a ROS 1 bag: convert it with `rosbags-convert" in done.output
