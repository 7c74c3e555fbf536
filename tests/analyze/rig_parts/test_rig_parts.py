"""Printable parts of a rig: closed surfaces, walls, and parts that fit each other and the arm's length."""

from __future__ import annotations

import io
import json
import re
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from analyze.cli import main
from analyze.errors import FixtureError
from analyze.fixture.checks import MIN_WALL, check_print
from analyze.fixture.print_files import stl_bytes, three_mf_bytes
from analyze.geometry import polyhedron
from analyze.rig_parts.all_parts import RigPrints, rig_prints
from analyze.rig_parts.arm_part import arm
from analyze.rig_parts.bought import SERVOS
from analyze.rig_parts.drawing import drawing_svg
from analyze.rig_parts.solids import RigPart, circle_of
from schemas.rig import StrikerConfig
from tests.places import ROOT
from tests.rig_text import CALIBRATION

NAMES = (
    "arm",
    "horn-xm430",
    "servo-xm430",
    "horn-xl330",
    "servo-xl330",
    "bearing-hub",
    "spacer-short",
    "spacer-long",
    "axle-plate",
    "solenoid-holder",
    "camera-holder",
    "lamp-holder",
    "mat-clamp",
)


@cache
def prints() -> RigPrints:
    return rig_prints(0.12)


def part(name: str) -> RigPart:
    return next(each.part for each in prints().parts if each.part.name == name)


@cache
def drawn(name: str) -> str:
    return drawing_svg(part(name))


def solid_at(name: str, points: list[tuple[float, float, float]]) -> list[bool]:
    mesh = part(name).mesh
    return polyhedron.inside(mesh.vertices, mesh.faces, np.array(points)).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_the_files_are_watertight_for_other_programs(name: str) -> None:
    mesh = part(name).mesh
    read = trimesh.load_mesh(io.BytesIO(stl_bytes(mesh)), file_type="stl")
    assert read.is_watertight
    assert read.is_winding_consistent
    assert read.body_count == 1
    own = polyhedron.mass_properties(mesh.vertices, mesh.faces).volume
    assert read.volume == pytest.approx(own, rel=1e-4)
    assert read.volume > 0
    with zipfile.ZipFile(io.BytesIO(three_mf_bytes(mesh, name))) as archive:
        model = ET.fromstring(archive.read("3D/3dmodel.model"))
    triangles = [each for each in model.iter() if each.tag.endswith("triangle")]
    assert len(triangles) == len(mesh.faces)


def test_every_part_can_be_printed() -> None:
    for each in prints().parts:
        assert each.checks.problems == []
        assert each.checks.wall >= MIN_WALL
        assert each.part.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("length_m", [0.06, pytest.param(0.095, marks=pytest.mark.slow), 0.12, 0.18])
def test_every_arm_can_be_printed_and_has_its_length(length_m: float) -> None:
    length = 1000 * length_m
    mesh = arm(length).mesh
    checks = check_print(mesh)
    assert checks.problems == []

    def solid_in_arm(points: list[tuple[float, float, float]]) -> list[bool]:
        return polyhedron.inside(mesh.vertices, mesh.faces, np.array(points)).tolist()

    # The hinge's axis is in the middle of a round hole, the pad's mark at the arm's length from it.
    hinge = [(9.9 * x, 9.9 * y, 6.0) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    assert not any(solid_in_arm(hinge))
    assert all(solid_in_arm([(1.03 * x, 1.03 * y, z) for x, y, z in hinge]))
    assert solid_in_arm([(length, y, 6.0) for y in (-4.9, -5.9, -7.0)]) == [False, False, True]
    nose = [(length + x, -5.1, z) for x in (-5.5, 5.5) for z in (0.5, 11.5)]  # the bumper, 11 mm, lies on it
    assert all(solid_in_arm(nose))


def test_overhangs_are_small_enough_to_print_without_supports() -> None:
    """Flat ceilings are nut pockets and the shoulder of a bearing's seat, at most 2 mm from their rim."""
    for each in prints().parts:
        name = each.part.name
        flat = [found for found in each.checks.overhangs if found.area > 20.0]
        allowed = {"horn-xm430": 1, "horn-xl330": 1, "bearing-hub": 2}.get(name, 0)
        assert len(flat) <= allowed, (name, flat)


def test_bought_parts_fit() -> None:
    for servo in SERVOS:
        screws = [(x, y, 0.2) for x, y in circle_of(4, servo.circle, 0.0)]
        assert not any(solid_at(f"horn-{servo.name}", screws))
    assert not any(solid_at("camera-holder", [(3.3, y, 3.0) for y in (12.0, 22.0, 32.0)]))  # 1/4 inch: 6.35
    assert all(solid_at("camera-holder", [(3.5, y, 3.0) for y in (12.0, 22.0, 32.0)]))


def test_the_arms_effective_mass_is_that_of_its_parts() -> None:
    """Compared with a rod and a point: between its tip alone and all of it at the tip."""
    made = prints()
    alone = made.parts[0].mass_kg
    assert alone / 6 < made.arm_effective_kg < alone / 2
    for wanted in (0.09, 0.17, 0.2):
        ballast = made.ballast(wanted)
        assert made.effective_kg(ballast) == pytest.approx(wanted, abs=0.009)
        assert made.effective_kg(ballast) - made.arm_effective_kg == pytest.approx(
            ballast.mass_kg * (0.12**2 + 0.02**2) / 0.12**2
        )
    assert made.ballast(0.001).mass_kg == 0.0


def test_a_pendulums_speed_is_that_of_a_point_mass_and_of_a_fall() -> None:
    """Compared with the energy of all mass in the ballast, and with a released swing step by step."""
    made = prints()
    ballast = made.ballast(0.2)
    point = replace(made, arm_inertia_kg_m2=1e-12, arm_moment_kg_m=(0.0, 0.0))
    for angle in (0.2, 0.6):
        # The ballast hangs 20 mm behind the line to the pad: it falls by L (1 - cos a) + 20 mm sin a.
        fall = 0.12 * (1 - np.cos(angle)) + 0.02 * np.sin(angle)
        expected = 0.12 * np.sqrt(2 * 9.81 * fall) / np.hypot(0.12, 0.02)
        assert point.pendulum_speed(ballast, angle) == pytest.approx(expected, rel=1e-6)
    speeds = made.pin_speeds(ballast)
    assert list(speeds) == [10, 20, 30, 40, 50, 60]
    assert list(speeds.values()) == sorted(speeds.values())
    turn, rate, step = -np.radians(30.0), 0.0, 1e-5
    below = made.arm_moment_kg_m[0] + ballast.mass_kg * 0.12
    behind = made.arm_moment_kg_m[1] + ballast.mass_kg * 0.02
    while turn < 0.0:  # torque of gravity about the hinge, by small steps
        torque = -9.81 * (below * np.sin(turn) - behind * np.cos(turn))
        rate += step * torque / (made.effective_kg(ballast) * 0.12**2)
        turn += step * rate
    assert 0.12 * rate == pytest.approx(speeds[30], rel=1e-3)


def test_an_arm_that_no_bed_takes_is_refused_with_a_remedy() -> None:
    with pytest.raises(FixtureError, match=r"300 mm is not printed in one piece.*aluminium"):
        rig_prints(0.3)


@pytest.mark.parametrize("name", NAMES)
def test_drawings_show_the_lengths_of_the_mesh(name: str) -> None:
    text = drawn(name)
    ET.fromstring(text)
    assert "nan" not in text
    written = {float(each) for each in re.findall(r">(?:⌀ )?([0-9.]+)</text>", text)}
    size = np.ptp(part(name).mesh.vertices, axis=0)
    assert any(abs(size[0] - each) < 0.05 for each in written)
    assert any(abs(size[2] - each) < 0.05 for each in written)


def test_the_guides_drawing_is_that_of_the_arm() -> None:
    texts = [
        re.findall(r">([^<>]+)</text>", svg)
        for svg in (
            (ROOT / "docs/images/rig-arm.svg").read_text(encoding="utf-8"),
            drawn("arm"),
        )
    ]
    assert texts[0] == texts[1]


def test_the_command_takes_the_arm_of_the_rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Both runs make the same parts, and the drawings are those of the tests above but for the arm.
    monkeypatch.setattr("analyze.rig_parts.all_parts.rig_prints", cache(rig_prints))
    monkeypatch.setattr("analyze.rig_parts.drawing.drawing_svg", lambda each: drawn(each.name))
    rig = tmp_path / "rig.toml"
    striker = "[striker]\narm_length_m = 0.1\neffective_mass_kg = 0.15\n"
    rig.write_text(f'[camera]\naddress = "192.168.10.2"\n{CALIBRATION}{striker}', encoding="utf-8")
    folder = tmp_path / "out" / "parts"
    done = CliRunner().invoke(main, ["rig-parts", str(rig), "-o", str(folder), "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert [each["name"] for each in answer["parts"]] == list(NAMES)
    assert answer["parts"][0]["size_mm"][0] == pytest.approx(100 + 20 + 9, abs=0.01)
    hinges = {each["where"]: each for each in answer["ballast"]}
    assert hinges["on ball bearings"]["effective_mass_kg"] == pytest.approx(0.15, abs=0.009)
    assert hinges["on an XM430"]["washers"] < hinges["on ball bearings"]["washers"]
    assert answer["pendulum_speed_m_s_by_angle_deg"]["10"] > 0
    assert answer["arm_length_m"] == 0.1
    assert {path.suffix for path in folder.iterdir()} == {".stl", ".3mf", ".svg"}
    again = CliRunner().invoke(main, ["rig-parts", str(rig), "-o", str(folder)])
    assert again.exit_code == 0, again.output  # older parts are replaced
    assert "screw" in again.output
    assert StrikerConfig().arm_length_m == 0.12  # the default without a rig file
