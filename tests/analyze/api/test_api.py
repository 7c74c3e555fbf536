"""Public API of `analyze` on the committed sample, used as in a notebook."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import analyze
from analyze.api import InertiaTensor
from analyze.pipeline.estimate_recordings import estimate_recordings
from tests.places import ROOT, SAMPLE

pytestmark = pytest.mark.usefixtures("coarse_regions")


@pytest.fixture(scope="module")
def recording() -> analyze.Recording:
    return analyze.load(str(SAMPLE))


@pytest.fixture(scope="module")
def found(recording: analyze.Recording) -> analyze.ObjectEstimate:
    return analyze.estimate(recording)


def test_import_loads_no_heavy_module():
    code = "import analyze, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_every_public_name_exists_and_is_documented():
    for name in analyze.__all__:
        assert getattr(analyze, name) is not None
        assert name in dir(analyze)
    for name in ("load", "estimate", "plan", "Recording", "ObjectEstimate", "InertiaTensor"):
        assert getattr(analyze, name).__doc__
    with pytest.raises(AttributeError, match="has no attribute 'solve'"):
        _ = analyze.solve


def test_recording_has_strikes_with_theta_of_t(recording):
    strike = recording["s1.1"]
    assert strike.time.shape == strike.theta.shape == strike.theta_sd.shape
    assert strike.time[0] == 0
    assert list(strike.phases) == ["rest", "strike", "stage_one", "stage_two", "landing"]
    fit = strike.fit
    assert fit.theta.shape == fit.time.shape == fit.residual.shape
    window = np.isin(strike.time, fit.time)
    assert np.allclose(fit.theta + fit.residual, strike.theta[window], atol=1e-12)
    with pytest.raises(KeyError, match=r"no strike 's9': its strikes are s1.1, s2.2"):
        _ = recording["s9"]


def test_estimate_equals_that_of_the_pipeline(found):
    reference = estimate_recordings([SAMPLE])
    assert np.array_equal(found.centre_of_mass.position, reference.com.position)
    assert np.array_equal(found.centre_of_mass.covariance, reference.com.covariance)
    assert np.array_equal(found.inertia.tensor, reference.inertial.inertia)
    assert np.array_equal(found.inertia.measured, reference.inertial.measured)
    assert json.loads(found.to_json()) == found.to_dict()


def test_each_tensor_entry_is_marked_measured_or_prior(found):
    text = repr(found.inertia)
    for i in range(3):
        for j in range(i, 3):
            entry = next(part for part in text.split(", ") if f"I{'xyz'[i]}{'xyz'[j]}" in part)
            assert ("(prior)" in entry) == (not found.inertia.measured[i, j])
    moments, axes = found.inertia.principal_moments, found.inertia.principal_axes
    assert np.allclose(axes @ np.diag(moments) @ axes.T, found.inertia.tensor)


def test_region_masses_add_up_to_the_mass(found):
    assert sum(region.mass for region in found.regions) == pytest.approx(found.mass, rel=1e-4)
    assert [region.name for region in found.regions] == ["shell", "upper", "lower"]
    assert found.parts == ()


def test_estimate_prints_within_a_screen_and_as_html_tables(recording, found):
    for shown in (recording, recording.strikes[0], found, found.centre_of_mass, found.inertia):
        assert len(repr(shown).splitlines()) <= 40
    html = found._repr_html_()
    assert html.count("<table>") == html.count("</table>") == 3
    assert "<table>" in recording._repr_html_()


def test_object_file_for_a_loaded_recording_is_refused(recording):
    with pytest.raises(ValueError, match=r"give it to analyze\.load"):
        analyze.estimate(recording, object_file="object.toml")


def test_dataframes(recording, found):
    strikes = recording.to_dataframe()
    assert list(strikes["id"]) == list(recording.strike_ids)
    motion = recording.strikes[0].to_dataframe()
    assert len(motion) == len(recording.strikes[0].time)
    quantities = found.to_dataframe().set_index("quantity")
    assert quantities.loc["centre_of_mass_x", "value"] == pytest.approx(found.centre_of_mass.position[0])
    json.dumps(recording.to_dict())


def test_urdf_holds_the_ten_inertial_parameters(found):
    inertial = ET.fromstring(found.urdf())
    assert float(inertial.find("mass").get("value")) == pytest.approx(found.mass)
    origin = [float(value) for value in inertial.find("origin").get("xyz").split()]
    assert np.allclose(origin, found.centre_of_mass.position, rtol=1e-9)
    assert float(inertial.find("inertia").get("izz")) == pytest.approx(found.inertia.tensor[2, 2], rel=1e-9)


def test_report_and_export_accept_paths_as_text(found, tmp_path: Path, undrawn):
    assert found.report(str(tmp_path / "r.html")).read_text().startswith("<!DOCTYPE html>")
    (path,) = found.export(str(tmp_path / "carton.urdf"))
    assert path.exists()
    with pytest.raises(analyze.AnalyzeError, match="format 'step' is unknown: use urdf, sdf, mjcf, usd"):
        found.export(tmp_path / "carton.step", format="step")


def test_exported_body_has_the_stated_friction(found, tmp_path: Path, monkeypatch):
    """The friction is put in by the test, as the sample's rig file states none."""
    monkeypatch.setattr("analyze.export.export_source.stated_friction", lambda rigs: 0.63)
    (path,) = found.export(tmp_path / "carton.xml", format="mjcf")
    assert 'friction="0.63' in path.read_text()


def test_excluded_strikes_are_not_used(recording):
    fewer = analyze.estimate(recording, exclude={"s3.1"})
    assert [row["id"] for row in fewer.to_dict()["strikes"] if row["used"]] == ["s1.1", "s2.2", "s4.1"]
    with pytest.raises(ValueError, match="no recording: give one or several"):
        analyze.estimate()


def test_plan_can_be_written_and_read(tmp_path: Path):
    plan = analyze.plan(ROOT / "docs" / "examples" / "teabox.toml", strikes=3)
    assert len(plan.to_dataframe()) == len(plan.document.strikes) == 3
    written = plan.write(tmp_path / "plan.json")
    assert json.loads(written.read_text())["strikes"][0]["id"] == plan.document.strikes[0].id


def test_an_entry_that_rounds_to_zero_has_no_sign() -> None:
    """The sign of rounding noise differs from machine to machine."""
    tensor = InertiaTensor(np.diag([1e-4, 1e-4, 1e-4]) - 1e-12, np.full((3, 3), 1e-6), np.ones((3, 3), bool))
    assert "Ixy 0.000 ± " in repr(tensor)
