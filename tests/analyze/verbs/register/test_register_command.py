"""`analyze register` on the sample recording, whose object file states the marker poses to be found."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.pipeline.read_evidence import read_head
from analyze.registration.register import register
from analyze.registration.table import UNKNOWN_TABLE
from analyze.verbs.register.marker_poses import RegisterAnswer, RegisterOptions, level_note, write_table
from schemas.object_spec import read_object_spec
from tests.analyze.registration.tagged_boxes import about, draw_box, seen_strikes
from tests.places import FIRST_SAMPLE


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    output = tmp_path_factory.mktemp("register") / "found.toml"
    result = CliRunner().invoke(
        analyze, ["register", str(FIRST_SAMPLE), "--json", "-o", str(output)], catch_exceptions=False
    )
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout), output


def test_estimated_poses_agree_with_the_object_file(done):
    answer, _ = done
    assert {entry["marker"] for entry in answer["markers"]} == {1, 2, 5}
    for entry in answer["markers"]:
        assert entry["observed"]
        assert entry["against_file"]["distance_m"] < 3e-4
        assert np.degrees(entry["against_file"]["turn_rad"]) < 0.2
        assert entry["on_surface"]


def test_object_file_gets_the_poses_and_is_otherwise_unchanged(done):
    answer, output = done
    spec = read_object_spec(output)
    written = {marker.name: marker.T_object_marker for marker in spec.marker}
    for entry in answer["markers"]:
        assert np.allclose(written[entry["marker"]], entry["T_object_marker"], atol=1e-6)
    sds = {marker.name: (marker.place_sd_m, marker.turn_sd_rad) for marker in spec.marker}
    for entry in answer["markers"]:
        assert sds[entry["marker"]] == pytest.approx((entry["place_sd_m"], entry["turn_sd_rad"]), abs=1e-6)
    text = tomllib.loads(output.read_text(encoding="utf-8"))
    assert text["name"] == answer["object_name"]
    assert len(text["marker"]) == 6


def test_estimate_without_marker_poses_gives_phi_and_names_the_command(done, tmp_path):
    _, output = done
    bare = tmp_path / "bare.toml"
    text = output.read_text(encoding="utf-8").splitlines()
    kept, inside = [], False
    for line in text:
        if line.startswith("T_object_marker"):
            inside = line.count("[") != line.count("]")
            continue
        if inside:
            inside = line.strip() != "]"
            continue
        kept.append(line)
    bare.write_text("\n".join(kept) + "\n", encoding="utf-8")
    assert all(marker.T_object_marker is None for marker in read_object_spec(bare).marker)
    result = CliRunner().invoke(
        analyze, ["estimate", str(FIRST_SAMPLE), "--object", str(bare), "--json"], catch_exceptions=False
    )
    assert result.exit_code == 0, result.stderr
    estimate = json.loads(result.stdout)
    assert all(strike["phi"]["observed"] for strike in estimate["strikes"])
    said = next(warning["text"] for warning in estimate["warnings"] if warning["code"] == "markers_unplaced")
    assert "analyze register" in said


def test_undetermined_poses_are_refused_in_one_line():
    left = [option for strike in ("s1.1", "s2.2", "s3.1", "s4.1") for option in ("--exclude", strike)]
    result = CliRunner().invoke(analyze, ["register", str(FIRST_SAMPLE), *left])
    assert result.exit_code == 1
    assert len(result.stderr.strip().splitlines()) == 1
    assert "no strike shows a marker at rest" in result.stderr


def rig_file(folder, T_world_camera, level=""):
    seen = read_head(FIRST_SAMPLE).manifest.cameras[0].calibration
    path = folder / "rig.toml"
    lens = f"width = {seen.width}\nheight = {seen.height}\nK = {seen.K}\ndistortion = {list(seen.distortion)}"
    place = "[\n" + "".join(f"  {row},  # as set up\n" for row in T_world_camera) + "]"
    path.write_text(
        'name = "bench"\n\n[camera]\naddress = "10.0.0.2"\n\n'
        f"[camera.calibration]\nT_world_camera = {place}\n{lens}\n{level}",
        encoding="utf-8",
    )
    return path


def run(*arguments):
    return CliRunner().invoke(analyze, ["register", *map(str, arguments)])


def test_estimated_table_is_written_into_the_rig_file(tmp_path):
    rng = np.random.default_rng(3)
    box = replace(draw_box(rng), table=np.array([math.radians(2.0), math.radians(-1.5), 0.004]))
    found = register(seen_strikes(box, rng), box.sizes, box.thickness, box.model, UNKNOWN_TABLE)
    recorded = box.camera.T_world_camera
    rig = rig_file(
        tmp_path,
        recorded.tolist(),
        '\n[level]\ntowards_x_rad = 0.001\ntowards_x_sd_rad = 0.0002\nread_by = "plumb line"\n',
    )
    before = tomllib.loads(rig.read_text(encoding="utf-8"))
    evidence = SimpleNamespace(recordings=())
    write_table(RegisterAnswer(found, evidence, "", (), RegisterOptions(find_table=True, rig=rig)), rig)
    after = tomllib.loads(rig.read_text(encoding="utf-8"))
    written = np.array(after["camera"]["calibration"].pop("T_world_camera"))
    del before["camera"]["calibration"]["T_world_camera"]
    assert after == before, "all else as it was"
    # The table's own normal and height over it, as the camera really stands.
    E = about([1, 0, 0], box.table[0]) @ about([0, 1, 0], box.table[1])
    up = recorded[:3, :3].T @ E[:, 2]
    assert np.degrees(np.arccos(min(1.0, written[2, :3] @ up))) < 0.6
    over = E[:, 2] @ (recorded[:3, 3] - [0, 0, box.table[2]])
    assert abs(written[2, 3] - over) < 6e-3 * math.hypot(*recorded[:2, 3]) + 5e-4
    assert "repeat analyze gravity" in level_note(rig)


def test_undetermined_table_is_not_written(tmp_path):
    rig = rig_file(tmp_path, read_head(FIRST_SAMPLE).manifest.cameras[0].calibration.T_world_camera)
    text = rig.read_text(encoding="utf-8")
    done = run(FIRST_SAMPLE, "--table", "--rig", rig, "--write")
    assert done.exit_code == 1
    assert "do not determine" in done.stderr
    assert rig.read_text(encoding="utf-8") == text


def test_rig_file_with_another_camera_pose_is_left_alone(tmp_path):
    moved = np.array(read_head(FIRST_SAMPLE).manifest.cameras[0].calibration.T_world_camera)
    moved[0, 3] += 0.001
    rig = rig_file(tmp_path, moved.tolist())
    text = rig.read_text(encoding="utf-8")
    done = run(FIRST_SAMPLE, "--table", "--rig", rig, "--write")
    assert done.exit_code == 1
    assert "its T_world_camera differs from that of" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert rig.read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    "options", [["--rig", "rig.toml"], ["--table", "--write"], ["--rig", "rig.toml", "--write"]]
)
def test_writing_the_table_takes_all_three_options(options):
    done = run(FIRST_SAMPLE, *options)
    assert done.exit_code == 2
    assert "--table, --rig RIG.toml and --write must be given together" in done.stderr
