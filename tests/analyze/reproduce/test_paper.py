"""The reproduction on simulated sessions without images, through tables, figures and page."""

from __future__ import annotations

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from markupsafe import escape

from analyze.cli import main
from analyze.reproduce.paper.published import published_centres, published_masses
from analyze.reproduce.paper.record import Condition, SessionRecord, ThetaSource, sealed_json
from analyze.reproduce.paper.scores import distance, metric
from analyze.reproduce.paper.session import Sweeps, session_record
from analyze.reproduce.paper.targets import missed_targets
from tests.analyze.balanced_html import Balanced
from tests.analyze.coarse_regions import coarse_region_masses
from tests.analyze.reproduce.theta_sessions import theta_session

SWEPT = Sweeps((0.0, 1.85), (0.0, 0.05), (5e-3,))
NOT_SWEPT = Sweeps((0.0,))
OBJECTS = {"carton": 9, "spray": 6, "juice": 6, "salt": 6, "parcel": 9}
"""number of strikes planned on three axes, by object: the paper's four, and one that is no shell with two
parts"""
SLOW = "spray", "juice", "parcel"
"""`make test-slow`: meshes like the salt, and a box like the carton"""
DRAWN = [name for name in OBJECTS if name not in SLOW]
"""objects on the page"""

each_object = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in OBJECTS]
)


@cache
def record_of(name: str) -> SessionRecord:
    """Record of one session on an object, shared by all tests.

    The carton's includes the sweeps; only its region masses are compared with the truth, and fine.
    """
    session = theta_session(name, 1, OBJECTS[name])
    if name == "carton":
        return session_record(*session, ThetaSource.SIMULATED, SWEPT)
    with coarse_region_masses():
        return session_record(*session, ThetaSource.SIMULATED, NOT_SWEPT)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory) -> Path:
    """Folder that the command wrote."""
    folder = tmp_path_factory.mktemp("reproduced")
    (folder / "sessions").mkdir()
    for record in map(record_of, DRAWN):
        (folder / "sessions" / f"{record.name}.json").write_text(sealed_json(record), encoding="utf-8")
    done = CliRunner().invoke(main, ["reproduce", "paper", "-o", str(folder)])
    assert done.exit_code == 0, done.output
    assert "centre of mass" in done.output.lower()
    return folder


def test_published_results_score_as_printed():
    centres, masses = published_centres(), published_masses()
    assert len(centres) == len(masses) == 9
    assert 1e3 * np.mean([each.distance_m for each in centres]) == pytest.approx(12.49, abs=0.01)
    assert np.mean([each.misplaced for each in masses]) == pytest.approx(0.174, abs=0.001)
    assert np.mean([each.metric for each in masses]) == pytest.approx(0.115, abs=0.002)
    third = [each for each in masses if each.object == "spray"][2]
    assert third.metric == pytest.approx(0.204, abs=0.001)


@each_object
def test_strikes_on_three_axes_reach_the_targets(name):
    record = record_of(name)
    assert record.object == name
    assert record.axes == 3
    assert record.strikes >= OBJECTS[name]
    assert distance(record.ours[Condition.EXACT], record) < 1e-3
    assert distance(record.ours[Condition.DRAWN], record) < 3e-3
    # The targets are 2 % + 2 mm/R about the edge and 8 % about c; six strikes determine the moment about an
    # edge near c less precisely, and their stated sd is larger.
    assert all(
        abs(axis.i_edge_off) < 0.02 + 2e-3 / axis.distance_m for axis in record.ours[Condition.EXACT].moments
    )
    assert all(
        abs(axis.i_com_off) < max(0.08, 2.5 * axis.i_com_sd) for axis in record.ours[Condition.EXACT].moments
    )


def test_cartons_region_masses_and_its_c_under_scan_noise():
    carton = record_of("carton")
    assert metric(carton.ours[Condition.EXACT].masses_kg, carton) < 0.06
    assert carton.scan_noise_com[0].ours[0] < 3e-3


@each_object
def test_papers_method_on_the_same_strikes(name):
    record = record_of(name)
    found = record.paper[Condition.EXACT]
    assert len(found) == OBJECTS[name] // 3, "one result per round of three strikes"
    assert all(distance(answer, record) < 3e-3 for answer in found), (
        "with our angles, far finer than the paper's"
    )
    # Equation (5) differentiates 0.03 deg of noise twice: in these sessions its error is 3 % in the median
    # and 10 % at most.
    assert all(abs(axis.i_edge_off) < 0.15 for answer in found for axis in answer.moments)


def test_page_tables_and_figure_data(drawn):
    text = (drawn / "index.html").read_text(encoding="utf-8")
    balanced = Balanced()
    balanced.feed(text)
    assert not balanced.open
    for title in (
        "Table 1",
        "Table 2",
        "Fig. 6",
        "Fig. 9(a)",
        "Fig. 9(b, c)",
        "Fig. 10",
        "Fig. 11",
        "Fig. 12",
    ):
        assert title in text
    assert text.count("<svg") == 6
    assert "nan" not in text.lower().replace("nanometre", "")
    with (drawn / "table1.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["object"] for row in rows if row["method"] == "ours"} >= set(DRAWN)
    assert {row["method"] for row in rows if row["object"] == "carton"} >= {
        "ours",
        "the paper's method here",
        "naive: centroid of the volume",
    }
    names = {path.stem for path in drawn.glob("*.csv")}
    assert names >= {"targets", "table1", "table2", "moments", "honesty", "sessions"}
    assert names >= {"fig6", "fig9a", "fig9b", "fig9c", "fig10a", "fig10b", "fig11", "fig12"}


def test_moments_table_compares_paper_ours_and_ground_truth(drawn):
    with (drawn / "moments.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["object"] for row in rows} == set(DRAWN)
    carton = [row for row in rows if row["object"] == "carton"]
    assert len(carton) == 3
    assert all(0.0 < float(row["ground truth, median [10⁻³ kg m²]"]) < 2.0 for row in carton)
    assert all(0.0 <= float(row["frames left out [%]"]) < 80.0 for row in carton)
    corrected = [
        float(row["corrected I: error, median [%]"])
        for row in carton
        if row["corrected I: error, median [%]"]
    ]
    assert corrected
    assert max(corrected) < 15.0


def test_missed_target_has_a_physical_reason(drawn):
    text = (drawn / "index.html").read_text(encoding="utf-8")
    names = [record_of(name) for name in DRAWN]
    for quantities, reason in missed_targets(names):
        assert len(reason) > 40
        assert str(escape(quantities)) in text
    salt = record_of("salt")
    near = salt.model_copy(
        update={"naive_kg": {"shell": [salt.true_masses_kg[0] + 1e-5, *salt.true_masses_kg[1:]]}}
    )
    why = dict(missed_targets([near]))["region masses over the best naive answer's, salt"]
    assert "“shell” happens to be nearly right for the salt" in why
    assert "% of the mass is in the shell" in why


@pytest.mark.parametrize(("entry", "value"), [("angles", "none"), ("mass_kg", 0.5), ("ours", {})])
def test_damaged_record_is_named_with_the_remedy(tmp_path, entry, value):
    carton = record_of("carton")
    damaged = json.loads(sealed_json(carton))
    damaged["record"][entry] = value
    (tmp_path / "sessions").mkdir()
    (tmp_path / "sessions" / f"{carton.name}.json").write_text(json.dumps(damaged), encoding="utf-8")
    refused = CliRunner().invoke(main, ["reproduce", "paper", "-o", str(tmp_path)])
    assert refused.exit_code == 1
    assert f"{carton.name}.json" in refused.output
    assert "analyse its recording again" in refused.output


def test_folder_without_sessions_is_refused_with_the_remedy(tmp_path):
    done = CliRunner().invoke(main, ["reproduce", "paper", "-o", str(tmp_path)])
    assert done.exit_code == 1
    assert "make reproduce" in done.output


@pytest.mark.parametrize(
    ("words", "where"), [(["foo"], "analyze reproduce"), (["paper", "--foo"], "analyze reproduce paper")]
)
def test_wrong_usage_names_the_command_once(words, where):
    done = CliRunner().invoke(main, ["reproduce", *words])
    assert done.exit_code == 2
    assert done.stderr.startswith("analyze: No such ")
    assert done.stderr.endswith(f"(see {where} --help)\n")
    assert done.stderr.count("\n") == 1
