"""Report as JSON and CSV tables: contents, consistency with the page, and destinations."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from analyze.cli import main as analyze
from analyze.report.report_document import report_json
from analyze.report.sensitivity_plot import largest_source_text, source_rows
from analyze.result.answer import answer_evidence
from schemas.report import Report
from tests.analyze.simulated_session import carton, session


@pytest.fixture(scope="module")
def estimate():
    return answer_evidence(session(carton(), np.random.default_rng(3), repeats=1))


@pytest.fixture
def run(estimate, tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.verbs.report.estimate_files", lambda *_: estimate)
    monkeypatch.setattr("analyze.result.score.score_if_virtual", lambda *_: None)
    monkeypatch.setattr("analyze.report.report.render_report", lambda *_: "<page>")
    monkeypatch.setattr("analyze.report.report.camera_stills", lambda *_: [])
    (tmp_path / "r.mcap").touch()

    def run(*arguments: object) -> Result:
        return CliRunner().invoke(analyze, ["report", str(tmp_path / "r.mcap"), *map(str, arguments)])

    return run


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_json_goes_to_standard_output_without_files(estimate, run, tmp_path):
    done = run("--json")
    assert done.exit_code == 0, done.stderr
    found = Report.model_validate_json(done.stdout)
    assert found.result == estimate.result
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap"]
    whole = np.sum([each.covariance for each in found.sensitivity.sources], axis=0)
    assert np.allclose(whole, estimate.estimate.com.covariance, rtol=1e-6, atol=1e-15)
    assert sum(each.share_worst for each in found.sensitivity.sources) == pytest.approx(1.0)
    assert [each.strike_id for each in found.sensitivity.strikes] == [
        plane.strike_id for plane in estimate.estimate.planes
    ]


def test_same_answer_gives_the_same_bytes(estimate):
    assert report_json(estimate, "said") == report_json(estimate, "said")


def test_json_and_page_on_request(run, tmp_path):
    done = run("--json", "-o", tmp_path / "page.html")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["object"] == "test box"
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "<page>"


def test_csv_tables_hold_the_answer(estimate, run, tmp_path):
    done = run("--csv", tmp_path / "tables")
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "r.html").exists()
    folder = tmp_path / "tables"
    assert {path.stem for path in folder.iterdir()} == {
        "answer",
        "strikes",
        "error_sources",
        "motions",
        "recordings",
        "warnings",
        "regions",
    }
    (recorded,) = table(folder / "recordings.csv")
    assert (recorded["recording_id"], recorded["time_source"], recorded["frame_rate_hz"]) == (
        "r1",
        "device_mapped",
        "120.0",
    )
    answer = {row["quantity"]: row for row in table(folder / "answer.csv")}
    result = estimate.result
    for i, axis in enumerate("xyz"):
        row = answer[f"centre_of_mass_{axis}"]
        assert [float(row["value"]), float(row["sd"]), row["unit"]] == [
            result.centre_of_mass.value[i],
            result.centre_of_mass.sd[i],
            "m",
        ]
        assert [float(row["low95"]), float(row["high95"])] == result.centre_of_mass.interval95[i]
    assert float(answer["inertia_xz"]["value"]) == result.inertia.value[0][2]
    assert answer["inertia_xz"]["source"] == ("measured" if result.inertia_measured[0][2] else "prior")
    strikes = table(folder / "strikes.csv")
    assert [float(row["phi_rad"]) for row in strikes] == [strike.phi.value for strike in result.strikes]
    moved = [[float(row[f"com_{axis}_by_phi_m_rad"]) for axis in "xyz"] for row in strikes]
    assert np.allclose(moved, [each.by_phi for each in estimate.estimate.sensitivity.strikes], rtol=1e-9)
    masses = [float(row["mass_kg"]) for row in table(folder / "regions.csv")]
    assert masses == [region.mass.value for region in result.regions.regions]
    assert len(table(folder / "motions.csv")) == sum(
        len(motion.angle.theta) for motion in estimate.estimate.evidence.motions
    )


def test_theta_is_fitted_angle_plus_residual_in_the_motions_table(estimate, run, tmp_path):
    run("--csv", tmp_path / "tables")
    fitted = [row for row in table(tmp_path / "tables" / "motions.csv") if row["fitted_rad"]]
    assert len(fitted) == sum(len(motion.fit.residual) for motion in estimate.estimate.evidence.motions)
    for row in fitted[::50]:
        assert float(row["fitted_rad"]) + float(row["residual_rad"]) == pytest.approx(
            float(row["theta_rad"]), abs=1e-12
        )
        assert row["phase"] in {"strike", "stage_one", "stage_two"}


def test_folder_without_parent_is_refused_before_the_estimate(run, tmp_path):
    done = run("--csv", tmp_path / "no" / "tables")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "there is no folder" in done.stderr
    done = run("--csv", tmp_path / "r.mcap")
    assert done.exit_code == 1
    assert "is a file: give a folder for the tables" in done.stderr


def test_largest_error_source_is_named_with_its_remedy(estimate):
    rows = source_rows(estimate.estimate.sensitivity, estimate.estimate.com.covariance)
    assert [row.share for row in rows] == sorted((row.share for row in rows), reverse=True)
    text = largest_source_text(rows)
    assert text.startswith(f"{100 * rows[0].share:.0f} % of the variance is {rows[0].source.value}")
    assert "Most effective remedy: " in text
