"""`analyze plan` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from analyze.cli import main
from analyze.planning.earlier_results import EarlierResult, StrikeMade
from analyze.verbs.plan.table import axis_text
from tests.full_disk import full_disk
from tests.places import CARTON, ROOT


def run(*arguments: str):
    return CliRunner().invoke(main, ["plan", *arguments])


def test_help_describes_every_option():
    text = " ".join(run("--help").output.split())
    for said in (
        "of additional strikes",
        "root mean square distance",
        "whether more strikes help",
        "the paper's own steps",
        "--rig",
    ):
        assert said in text


def test_plan_prints_expected_accuracy(tmp_path: Path):
    done = run(str(CARTON), "-o", str(tmp_path / "plan.json"), "--strikes", "6")
    assert done.exit_code == 0, done.output
    for said in (
        "6 strikes",
        "centre of mass x, y, z",
        "inertia tensor about it [10⁻⁴ kg m²]",
        "not determined",
        "mass, shell",
        "number of strikes",
        "advice:",
    ):
        assert said in done.output
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert plan["method"] == "ours"
    assert plan["prediction"]["com_rms_m"] == plan["predicted_com_sd_m"]
    assert len(plan["strikes"]) == 6


def test_a_full_disk_leaves_no_plan(tmp_path: Path):
    with full_disk(50):
        done = run(str(CARTON), "-o", str(tmp_path / "plan.json"), "--strikes", "3")
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"analyze: {tmp_path / 'plan.json'}: cannot be written: ")
    assert not list(tmp_path.iterdir())


def test_plan_by_the_papers_method():
    done = run(str(CARTON), "--method", "paper")
    assert done.exit_code == 0, done.output
    assert "by the paper's method" in done.output
    assert "singular" in done.output
    assert json.loads(run(str(CARTON), "--method", "paper", "--json").output)["method"] == "paper"


@pytest.mark.parametrize("option", [("--target-com-mm", "1"), ("--given", "r.mcap")])
def test_papers_method_refuses_target_and_given(option):
    done = run(str(CARTON), "--method", "paper", *option)
    assert done.exit_code == 2
    assert "leave them out" in done.output


def test_target_accuracy(tmp_path: Path):
    done = run(str(CARTON), "--target-com-mm", "0.5", "--json")
    plan = json.loads(done.output)
    assert plan["prediction"]["target_reached"] is True
    assert plan["prediction"]["com_rms_m"] <= 0.0005
    far = json.loads(run(str(CARTON), "--target-com-mm", "0.0001", "--json").output)
    assert far["prediction"]["target_reached"] is False
    assert "out of reach" in far["prediction"]["advice"]


def test_target_that_is_nan_is_wrong_usage():
    done = run(str(CARTON), "--target-com-mm", "nan")
    assert done.exit_code == 2
    assert "nan is not a number" in done.output


def test_papers_plan_reports_strikes_beyond_the_striker():
    """The plan needs 0.98 to 1.13 m/s; the striker reaches 0.96 m/s."""
    done = run(str(CARTON.parents[3] / "docs" / "examples" / "teabox.toml"), "--method", "paper", "--json")
    plan = json.loads(done.output)
    warned = {entry["axis_id"]: entry for entry in plan["rejected"] if entry["code"] == "speed"}
    fast = {strike["axis_id"] for strike in plan["strikes"] if strike["tip_speed_m_s"]["target"] > 0.96}
    assert fast
    assert set(warned) == fast
    assert all(entry["text"].startswith("kept, though it needs a tip speed of") for entry in warned.values())


def test_tag_off_the_surface_is_one_line(tmp_path: Path):
    thing = tmp_path / "carton.toml"
    thing.write_text(CARTON.read_text().replace("[0, 0, 1, 0.04]", "[0, 0, 1, 0.09]"))
    done = run(str(thing))
    assert done.exit_code == 1
    assert done.output.startswith("analyze: carton: marker 0 lies 50 mm outside the surface")
    assert done.output.count("\n") == 1


def test_a_missing_result_is_one_line():
    done = run(str(CARTON), "--given", "gone.json")
    assert done.exit_code == 1
    assert "gone.json: no such file" in done.output


def test_tosses_alone_are_added_to_strikes_that_were_made(tmp_path: Path, monkeypatch):
    thing = "acquire/virtual/object_data/carton.toml"
    made = EarlierResult(
        "r.json", np.array([0.001, 0.0, 0.009]), 1e-8 * np.eye(3), None, (StrikeMade("p2e0", 1e-3, 0.01),)
    )
    so_far = SimpleNamespace(given=made, touches=())
    monkeypatch.setattr("analyze.result.given_results.read_given", lambda *_: so_far)
    arguments = ("--strikes", "0", "--tosses", "2", "--json")
    done = run(thing, "--given", "r.json", *arguments)
    assert done.exit_code == 0, done.stderr
    plan = json.loads(done.stdout)
    assert (len(plan["strikes"]), len(plan["tosses"])) == (0, 2)
    assert not any("size" in warning for warning in plan["warnings"])
    alone = json.loads(run(thing, *arguments).stdout)
    assert any("size" in warning for warning in alone["warnings"])


def test_reach_and_gravity_come_from_the_rig_file(tmp_path: Path):
    rig = tmp_path / "rig.toml"
    rig.write_text(
        "table_friction = 0.6\ng_m_s2 = 9.82\ngravity_tilt_sd_rad = 0.02\n"
        '[striker]\nreach_m = [0.02, 0.10]\n[camera]\naddress = "x"\n'
        "[camera.calibration]\nwidth = 656\nheight = 492\nK = [[1430, 0, 327.5], [0, 1430, 245.5], [0, 0, "
        "1]]\n"
        "T_world_camera = [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]]\n"
    )
    plan = json.loads(run(str(CARTON), "--rig", str(rig), "--strikes", "3", "--json").output)
    assert max(strike["impact_height_m"] for strike in plan["strikes"]) <= 0.10
    plain = json.loads(run(str(CARTON), "--strikes", "3", "--json").output)
    assert (
        plan["prediction"]["error_sources_m"]["tilt of gravity"]
        > plain["prediction"]["error_sources_m"]["tilt of gravity"]
    )
    rig.write_text(rig.read_text().replace("[0.02, 0.10]", "[0.3, 0.1]"))
    done = run(str(CARTON), "--rig", str(rig))
    assert done.exit_code == 1
    assert "reach_m = [0.3, 0.1]" in done.output


def test_camera_rig_and_object_files_in_each_others_place_are_named(tmp_path: Path):
    lens = tmp_path / "camera.toml"
    lens.write_text(
        "[camera.calibration]\nwidth = 656\nheight = 492\n"
        "K = [[1430, 0, 327.5], [0, 1430, 245.5], [0, 0, 1]]\n"
    )
    done = run(str(CARTON), "--rig", str(lens))
    assert done.exit_code == 1
    assert "camera.toml: is a camera file, not a rig file" in done.output
    assert "give it with --camera" in done.output
    assert run(str(CARTON), "--camera", str(lens), "--json").exit_code == 0
    done = run(str(CARTON), "--camera", str(CARTON))
    assert done.exit_code == 1
    assert "is an object file, not a camera or rig file: `analyze calibrate BOARD.mp4" in done.output
    assert done.output.count("\n") == 1


def test_a_rig_file_may_state_the_friction_only(tmp_path: Path):
    rig = tmp_path / "table.toml"
    rig.write_text("table_friction = 0.7\n")
    plan = json.loads(run(str(CARTON), "--rig", str(rig), "--strikes", "3", "--json").output)
    assert max(strike["friction_needed"] for strike in plan["strikes"]) <= 0.7
    rig.write_text("table_friction = 0.02\n")
    done = run(str(CARTON), "--rig", str(rig), "--strikes", "3")
    assert done.exit_code == 1
    assert "slipping" in done.output


def test_strikes_by_hand_take_the_friction_of_a_rig_file_that_states_no_device(tmp_path: Path):
    lens, rig = tmp_path / "phone.toml", tmp_path / "table.toml"
    lens.write_text(
        "[camera.calibration]\nwidth = 1920\nheight = 1080\nK = [[1600, 0, 960], [0, 1600, 540], [0, 0, 1]]\n"
    )
    rig.write_text("table_friction = 0.02\n")
    given = (str(CARTON), "--camera", str(lens), "--strikes", "3", "--rig", str(rig))
    done = run(*given)
    assert done.exit_code == 1
    assert "slipping" in done.output
    rig.write_text("[striker]\narm_length_m = 0.2\n")
    done = run(*given)
    assert done.exit_code == 1
    assert "leave out [striker], or --camera" in done.output


def test_the_object_of_the_tutorial_can_be_planned(tmp_path: Path):
    example = ROOT / "docs" / "examples" / "teabox.toml"
    done = run(str(example), "-o", str(tmp_path / "plan.json"))
    assert done.exit_code == 0, done.output
    assert "plan-cards.html" in done.output
    entry = next(line for line in example.read_text().splitlines() if line.startswith("T_object_marker"))
    assert entry in (ROOT / "docs" / "tutorial" / "phone.md").read_text()


def test_refusal_keeps_warnings_about_the_shape(tmp_path: Path):
    """Two balls side by side are refused, and the message also says that the mesh has two bodies."""
    import trimesh

    balls = [
        trimesh.creation.icosphere(3, radius=40.0).apply_translation([place, 0, 0]) for place in (0.0, 5.0)
    ]
    trimesh.util.concatenate(balls).export(tmp_path / "b.stl")
    thing = tmp_path / "b.toml"
    thing.write_text(
        'name = "b"\nmass_kg = 0.2\nmass_sd_kg = 0.001\n'
        '[shape]\nfile = "b.stl"\nunit = "mm"\n[[marker]]\nid = 0\nsize_m = 0.03\n'
    )
    done = run(str(thing))
    assert done.exit_code == 1
    lines = done.stderr.splitlines()
    assert "is a ball" in lines[-2]
    assert "2 bodies" in lines[-1]
    assert lines[-1].startswith("note: ")


def test_units_in_brackets_are_printed(tmp_path: Path):
    """Rich takes [mm] for markup unless markup is switched off."""
    done = run(str(ROOT / "docs" / "examples" / "teabox.toml"), "-o", str(tmp_path / "plan.json"))
    assert "[10⁻⁴ kg m²]" in done.output
    assert "[mm]" in done.output


def test_axes_that_differ_by_a_sign_have_names_of_their_own():
    assert axis_text([0.7071, 0.7071, 0.0]) == axis_text([-0.7071, -0.7071, 0.0]) == "0.71, 0.71, 0.00"
    assert axis_text([0.7071, -0.7071, 0.0]) == "0.71, -0.71, 0.00"


def test_tosses_are_planned_and_printed(tmp_path: Path):
    done = run(str(CARTON), "-o", str(tmp_path / "plan.json"), "--strikes", "3", "--tosses", "2")
    assert done.exit_code == 0, done.output
    said = "2 tosses by hand, t1–t2: 3 turns a second, 0.42 s in the air, 1230 mm behind the line; spin axes"
    assert said in " ".join(done.output.split())
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert plan["schema_version"] == "1.2"
    assert [toss["id"] for toss in plan["tosses"]] == ["t1", "t2"]
    assert 'id="t2"' in (tmp_path / "plan-cards.html").read_text(encoding="utf-8")


def test_tosses_alone_need_no_edge(tmp_path: Path):
    done = run(str(CARTON), "-o", str(tmp_path / "plan.json"), "--strikes", "0", "--tosses", "2", "--json")
    assert done.exit_code == 0, done.output
    plan = json.loads(done.stdout)
    assert plan["strikes"] == []
    assert [toss["id"] for toss in plan["tosses"]] == ["t1", "t2"]
    assert any("one strike measures it" in warning for warning in plan["warnings"])
    assert (tmp_path / "plan-cards.html").exists()


def test_one_strike_beside_tosses_is_on_the_edge_that_measures_the_size_best():
    done = run(str(CARTON), "--strikes", "1", "--tosses", "1", "--json")
    plan = json.loads(done.stdout)
    assert [strike["id"] for strike in plan["strikes"]] == ["s1"]
    assert plan["prediction"] is None
    assert plan["hypothesis"] is not None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--strikes", "0"], "--strikes 0 plans nothing: ask for strikes, or for tosses (--tosses 3)"),
        (["--strikes", "0", "--tosses", "1", "--gravity"], "--strikes 0 plans tosses alone: leave out"),
        (["--strikes", "2"], "ask for 3 or more, or for tosses too (--tosses 3)"),
    ],
)
def test_too_few_strikes_are_refused_with_what_to_ask_for(arguments: list[str], said: str):
    done = run(str(CARTON), *arguments)
    assert done.exit_code != 0
    assert said in done.stderr


def test_an_object_that_only_rolls_is_offered_tosses(tmp_path: Path):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=45.0)
    ball.export(tmp_path / "ball.stl")
    text = 'name = "ball"\nmass_kg = 0.2\nmass_sd_kg = 0.001\n[shape]\nfile = "ball.stl"\nunit = "mm"\n'
    for number, turn in enumerate(np.vstack([np.eye(3), -np.eye(3)])):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.align_vectors([turn], [[0.0, 0.0, 1.0]])[0].as_matrix()
        pose[:3, 3] = 0.0448 * turn
        text += f"[[marker]]\nid = {number}\nsize_m = 0.024\nT_object_marker = {pose.tolist()}\n"
    (tmp_path / "ball.toml").write_text(text)
    done = run(str(tmp_path / "ball.toml"))
    assert done.exit_code == 1
    assert "or toss it (`--strikes 0 --tosses 3`)" in done.stderr
    done = run(str(tmp_path / "ball.toml"), "--strikes", "0", "--tosses", "3")
    assert done.exit_code == 0, done.stderr
