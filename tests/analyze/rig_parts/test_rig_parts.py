"""Printable parts of a rig: closed surfaces, walls, and parts that fit each other and the arm's length."""

from __future__ import annotations

import io
import json
import re
import zipfile
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from analyze.cli import main
from analyze.errors import FixtureError
from analyze.fixture.checks import MIN_WALL
from analyze.fixture.print_files import stl_bytes, three_mf_bytes
from analyze.geometry import polyhedron
from analyze.rig_parts.all_parts import RigPrints, rig_prints
from analyze.rig_parts.drawing import drawing_svg
from analyze.rig_parts.solids import RigPart, circle_of
from analyze.rig_parts.striker_parts import HORNS, HUB_CIRCLE
from schemas.rig import StrikerConfig
from tests.places import ROOT
from tests.rig_text import CALIBRATION

NAMES = ("arm", "pad", "horn-xm430", "horn-xl330", "bearing-hub", "camera-holder", "mat-clamp")


@cache
def prints(length_m: float = 0.12) -> RigPrints:
    return rig_prints(length_m)


def part(name: str, length_m: float = 0.12) -> RigPart:
    return next(each.part for each in prints(length_m).parts if each.part.name == name)


def solid_at(name: str, points: list[tuple[float, float, float]], length_m: float = 0.12) -> list[bool]:
    mesh = part(name, length_m).mesh
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


@pytest.mark.parametrize("length_m", [0.06, pytest.param(0.095, marks=pytest.mark.slow), 0.12, 0.18])
def test_every_arm_can_be_printed_and_has_its_length(length_m: float) -> None:
    length = 1000 * length_m
    for each in prints(length_m).parts:
        assert each.checks.problems == []
        assert each.checks.wall >= MIN_WALL
        assert each.part.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    # The hinge's axis is in the middle of a round hole, the tip's bolt at the arm's length from it.
    hinge = [(5.9 * x, 5.9 * y, 6.0) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    assert not any(solid_at("arm", hinge, length_m))
    bolt = [
        (length + 2.1 * x, y, 6.0 + 2.1 * z)
        for x, z in ((1, 0), (0, 1), (-1, 0), (0, -1))
        for y in (-8.0, 8.0)
    ]
    assert not any(solid_at("arm", bolt, length_m))
    around = [(length + 2.4 * x, 0.0, 6.0 + 2.4 * z) for x, z in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    assert all(solid_at("arm", around, length_m))


def test_arm_adapters_and_hub_have_one_circle_of_screws() -> None:
    places = circle_of(4, HUB_CIRCLE)
    for name in ("arm", "horn-xm430", "horn-xl330", "bearing-hub"):
        high = float(part(name).mesh.vertices[:, 2].max())
        through = [
            (x + 1.5 * a, y + 1.5 * b, z)
            for x, y in places
            for a, b in ((1, 0), (0, -1))
            for z in (0.2, high - 0.2)
        ]
        assert not any(solid_at(name, through)), name
        beside = [(x * 1.17, y * 1.17, high - 0.2) for x, y in places]
        assert all(solid_at(name, beside)), name


def test_bought_parts_fit() -> None:
    for horn in HORNS:
        screws = [(x, y, 0.2) for x, y in circle_of(4, horn.circle, 0.0)]
        assert not any(solid_at(f"horn-{horn.name}", screws))
    around = [(11.0 * np.cos(a), 11.0 * np.sin(a)) for a in np.linspace(0, 6, 7)]
    assert not any(solid_at("bearing-hub", [(x, y, z) for x, y in around for z in (0.1, 6.9, 9.1, 15.9)]))
    assert all(solid_at("bearing-hub", [(x, y, 8.0) for x, y in around]))  # the shoulder between the bearings
    assert not any(solid_at("pad", [(3.4, 0.0, z) for z in (4.2, 12.0)]))  # M4 nut, 7 mm across flats
    assert all(solid_at("pad", [(3.4, 0.0, 3.8)]))  # the floor on which it bears
    assert not any(
        solid_at("camera-holder", [(3.3, 43.0, z) for z in (26.0, 40.0, 52.0)])
    )  # 1/4 inch: 6.35 mm


def test_the_arms_effective_mass_is_that_of_its_parts() -> None:
    """Compared with a rod and a point: between its tip alone and all of it at the tip."""
    made = prints()
    arm, pad = made.parts[0], made.parts[1]
    at_tip = pad.mass_kg + 0.0065
    assert at_tip + arm.mass_kg / 6 < made.arm_effective_kg < at_tip + arm.mass_kg / 2
    assert made.ballast_kg(0.2) == pytest.approx(0.2 - made.arm_effective_kg)
    assert made.ballast_kg(0.001) == 0.0


def test_an_arm_that_no_bed_takes_is_refused_with_a_remedy() -> None:
    with pytest.raises(FixtureError, match=r"300 mm is not printed in one piece.*aluminium"):
        rig_prints(0.3)


@pytest.mark.parametrize("name", NAMES)
def test_drawings_show_the_lengths_of_the_mesh(name: str) -> None:
    drawn = part(name)
    text = drawing_svg(drawn)
    ET.fromstring(text)
    assert "nan" not in text
    written = {float(each) for each in re.findall(r">(?:⌀ )?([0-9.]+)</text>", text)}
    size = np.ptp(drawn.mesh.vertices, axis=0)
    assert any(abs(size[0] - each) < 0.05 for each in written)
    assert any(abs(size[2] - each) < 0.05 for each in written)


def test_the_guides_drawing_is_that_of_the_arm() -> None:
    texts = [
        re.findall(r">([^<>]+)</text>", svg)
        for svg in (
            (ROOT / "docs/images/rig-arm.svg").read_text(encoding="utf-8"),
            drawing_svg(part("arm")),
        )
    ]
    assert texts[0] == texts[1]


def test_the_command_takes_the_arm_of_the_rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Both runs make the same parts.
    monkeypatch.setattr("analyze.rig_parts.all_parts.rig_prints", cache(rig_prints))
    rig = tmp_path / "rig.toml"
    striker = "[striker]\narm_length_m = 0.1\neffective_mass_kg = 0.15\n"
    rig.write_text(f'[camera]\naddress = "192.168.10.2"\n{CALIBRATION}{striker}', encoding="utf-8")
    folder = tmp_path / "out" / "parts"
    done = CliRunner().invoke(main, ["rig-parts", str(rig), "-o", str(folder), "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert [each["name"] for each in answer["parts"]] == list(NAMES)
    assert answer["parts"][0]["size_mm"][0] == pytest.approx(100 + 20 + 9, abs=0.01)
    assert answer["arm_length_m"] == 0.1
    assert {path.suffix for path in folder.iterdir()} == {".stl", ".3mf", ".svg"}
    again = CliRunner().invoke(main, ["rig-parts", str(rig), "-o", str(folder)])
    assert again.exit_code == 0, again.output  # older parts are replaced
    assert "screw" in again.output
    assert StrikerConfig().arm_length_m == 0.12  # the default without a rig file
