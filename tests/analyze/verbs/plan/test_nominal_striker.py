"""Plans without a rig file for objects that the nominal striker is too light or too heavy for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.verbs.plan.plan_object import PlanOptions, plan_object
from tests.analyze.geometry.shapes import stl
from tests.analyze.planning.random_bodies import convex_triangles

TAGS = "".join(f"\n[[marker]]\nid = {i}\nsize_m = 0.012\n" for i in range(3))


def _file(folder: Path, mass_kg: float, size: str) -> Path:
    path = folder / "object.toml"
    text = f'name = "thing"\nmass_kg = {mass_kg}\nmass_sd_kg = 0.0001\n\n[shape]\n'
    path.write_text(text + f"box = {{ size_m = {size} }}\n{TAGS}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("mass_kg", "size", "grams"),
    [
        (2.0, "[0.09, 0.07, 0.17]", 1200),
        (2.8, "[0.09, 0.07, 0.17]", 1600),
        (0.015, "[0.03, 0.006, 0.05]", 50),
    ],
)
def test_objects_of_any_mass_are_planned_for_a_striker_that_suits_them(tmp_path, mass_kg, size, grams):
    planned = plan_object(_file(tmp_path, mass_kg, size), PlanOptions()).plan
    [note] = [each for each in planned.warnings if "striker with an effective mass" in each]
    assert f"mass of {grams} g" in note
    assert planned.hypothesis is not None
    assert 1000 * planned.hypothesis.striker.effective_mass_kg == pytest.approx(grams)
    speeds = [each.tip_speed_m_s.target for each in planned.strikes]
    assert 0.06 <= min(speeds) <= max(speeds) <= 0.96


def test_a_heavier_striker_is_assumed_where_the_nominal_one_leaves_the_centre_of_mass_rough(tmp_path):
    """Lying on its sides a tall tapered body shows little of the height of its centre of mass."""
    ends = [
        [x * size / 2, y * size / 2, z] for size, z in ((60, 0), (44, 180)) for x in (-1, 1) for y in (-1, 1)
    ]
    (tmp_path / "post.stl").write_bytes(stl(convex_triangles(np.array(ends, float))))
    path = _file(tmp_path, 0.8, "[1, 1, 1]")
    text = path.read_text(encoding="utf-8").replace(
        "box = { size_m = [1, 1, 1] }", 'file = "post.stl"\nunit = "mm"'
    )
    path.write_text(text, encoding="utf-8")
    plan = plan_object(path, PlanOptions()).plan
    assert any("effective mass of 400 g" in note for note in plan.warnings)
    assert plan.prediction.com_rms_m < 0.0008
    rig = tmp_path / "rig.toml"
    rig.write_text("[striker]\neffective_mass_kg = 0.2\n", encoding="utf-8")
    assert plan_object(path, PlanOptions(rig_path=rig)).plan.prediction.com_rms_m > 0.002


def test_mat_and_heavy_striker_are_assumed_together(tmp_path):
    path = _file(tmp_path, 0.8, "[1, 1, 1]")
    text = path.read_text(encoding="utf-8").replace(
        "box = { size_m = [1, 1, 1] }", "cylinder = { radius_m = 0.05, height_m = 0.1 }"
    )
    path.write_text(text, encoding="utf-8")
    [note] = [each for each in plan_object(path, PlanOptions()).plan.warnings if "does not suffice" in each]
    assert "mat" in note
    assert "1200 g" in note


def test_the_roughest_mat_is_tried_with_a_heavier_striker_too(tmp_path):
    planned = plan_object(_file(tmp_path, 0.8, "[0.06, 0.06, 0.06]"), PlanOptions()).plan
    [note] = [each for each in planned.warnings if "does not suffice" in each]
    assert re.search(r"at least 0\.7 .* and an arm with an effective mass", note)


def test_a_stated_striker_is_kept(tmp_path):
    """A rig file's own striker is never replaced: the refusal names its speed."""
    rig = tmp_path / "rig.toml"
    rig.write_text("[striker]\neffective_mass_kg = 0.2\n", encoding="utf-8")
    with pytest.raises(PlanError, match="at another speed than the striker's"):
        plan_object(_file(tmp_path, 2.0, "[0.09, 0.07, 0.17]"), PlanOptions(rig_path=rig))


def test_usual_objects_keep_the_nominal_striker(tmp_path):
    planned = plan_object(_file(tmp_path, 0.18, "[0.08, 0.06, 0.15]"), PlanOptions()).plan
    assert planned.hypothesis is not None
    assert planned.hypothesis.striker.effective_mass_kg == pytest.approx(0.2)
    assert not any("effective mass" in each for each in planned.warnings)


def test_a_cube_is_planned_for_a_mat_on_which_it_does_not_slide(tmp_path):
    """A mat that a rig file states is kept, and the remedy has the figure that gives a plan."""
    cube = _file(tmp_path, 0.1, "[0.06, 0.06, 0.06]")
    planned = plan_object(cube, PlanOptions()).plan
    [note] = [each for each in planned.warnings if "does not suffice" in each]
    assert re.search(r"at least 0\.[67] ", note)
    assert max(each.friction_needed for each in planned.strikes) > 0.4
    rig = tmp_path / "table.toml"
    rig.write_text("table_friction = 0.45\n", encoding="utf-8")
    with pytest.raises(PlanError, match=r": use a mat with more friction, at least 0\.[67] ") as caught:
        plan_object(cube, PlanOptions(rig_path=rig))
    least = re.findall(r"at least (0\.\d)", str(caught.value))[0]
    rig.write_text(f"table_friction = {least}\n", encoding="utf-8")
    assert plan_object(cube, PlanOptions(rig_path=rig)).plan.strikes


def test_too_few_axes_are_named_as_the_reason(tmp_path):
    box = _file(tmp_path, 0.18, "[0.08, 0.06, 0.15]")
    with pytest.raises(
        PlanError, match=r"1 axis cannot determine the centre of mass: allow 3 or more \(--axes\)"
    ):
        plan_object(box, PlanOptions(most_axes=1))
