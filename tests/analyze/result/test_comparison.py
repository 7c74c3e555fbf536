"""Comparison of repeated sessions of one object: agreement, outlier, repeatability, refusals."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.errors import EstimationError, MergeError
from analyze.pipeline.estimate import EstimateOptions
from analyze.report.comparison_document import comparison_document, upper_factor
from analyze.report.comparison_page import comparison_json, comparison_summary
from analyze.result.comparison import SessionComparison, compare_evidence
from schemas.comparison import Comparison
from tests.analyze.balanced_html import Balanced
from tests.analyze.estimation.bodies import box_body
from tests.analyze.pipeline.merged_sessions import recording
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")

OTHER = box_body((0.08, 0.06, 0.15), (0.026, 0.0125, 0.0055), 0.005, (0.5, -0.35, 0.79), 1e-3)
"""box like the carton of simulated_session.py, but with 1.5 g of the upper part below the dividing plane"""
ELSEWHERE = {"rig": {"name": "another"}}


def one(number: int, body=None, **manifest: object):
    """Session `number` (1, 2, ...) on `body`, recorded as the same object."""
    plain = session(carton(), np.random.default_rng(3), repeats=1)
    made = (
        plain
        if body is None and number == 1
        else session(body or carton(), np.random.default_rng(20 + number), repeats=1)
    )
    struck = replace(
        made, spec=plain.spec, model=plain.model, plan=plain.plan, object_sha256=plain.object_sha256
    )
    head = plain.recordings[0].manifest
    return recording(struck, "r" * number, object=head.object, object_sha256=head.object_sha256, **manifest)


@pytest.fixture(scope="module")
def alike() -> SessionComparison:
    """Three sessions on one body: two of one set-up, one of another."""
    return compare_evidence([one(2), one(3, **ELSEWHERE), one(1)])


@pytest.fixture(scope="module")
def odd() -> SessionComparison:
    return compare_evidence([one(1), one(2, OTHER), one(3)])


def test_sessions_of_one_body_agree(alike):
    found = comparison_document(alike)
    assert found.may_join
    assert found.agreement.chance > 1e-3
    assert [each.recording.recording_id for each in found.sessions] == ["r", "rr", "rrr"]
    assert [each.setup for each in found.sessions] == [1, 1, 2]
    assert not any(each.stands_out for each in found.sessions)
    assert found.verdict[0].startswith("trust that all 3 sessions have one centre of mass")


def test_agreement_is_tested_with_the_chosen_estimator(alike):
    read = [each.answer.estimate.evidence for each in alike.sessions[:2]]
    found = compare_evidence(read, EstimateOptions(estimator="sign_change"))
    expected = found.joint.estimate.agreements.recordings.chi_squared
    assert found.together.chi_squared == expected
    for each in found.sessions:
        assert each.against_others.chi_squared == pytest.approx(expected, rel=1e-3)
    by_default = compare_evidence(read)
    assert by_default.together.chi_squared != pytest.approx(expected, rel=1e-3)


def test_precision_follows_from_the_answers(alike):
    found = comparison_document(alike)
    for i, axis in enumerate("xyz"):
        (row,) = [each for each in found.precision if each.name == f"centre of mass {axis}"]
        a, b, _ = (each.answer.estimate.com.position[i] for each in alike.sessions)
        assert row.s_r == pytest.approx(abs(a - b) / np.sqrt(2), rel=1e-6)
        assert row.s_R is not None
        assert row.s_R >= row.s_r
        assert (row.freedom_r, row.freedom_R) == (1, 1)
        assert row.together is not None
        assert row.together.value == pytest.approx(alike.joint.estimate.com.position[i], rel=1e-6)
        # The sessions scatter no more than their intervals allow.
        assert row.s_R < 2 * np.sqrt(alike.sessions[0].answer.estimate.com.covariance[i, i])
    kinds = [each.kind for each in found.precision]
    assert {kind: kinds.count(kind) for kind in kinds} == {
        "centre_of_mass": 3,
        "moment": 6,
        "region": 3,
        "phi": 6,
    }
    for row in found.precision:
        if row.kind == "phi":
            assert row.grouped_by == "session"
            assert row.s_r is None  # one strike per edge and session
            assert row.s_R < 5 * 4e-4


def test_session_with_another_filling_is_the_outlier(odd):
    found = comparison_document(odd)
    assert not found.may_join
    assert [each.stands_out for each in found.sessions] == [False, True, False]
    assert found.verdict[0].startswith("doubt that the sessions are of one body")
    assert found.verdict[1].startswith("repeat session 2, rr.mcap: it stands out")
    assert "without it the others repeat to 0.0" in found.verdict[1]
    assert comparison_summary(found).startswith("The 3 sessions do not agree; session 2 stands out.")


def test_json_reads_back(alike):
    assert Comparison.model_validate_json(comparison_json(alike)) == comparison_document(alike)


def test_different_objects_are_refused():
    other = session(
        box_body((0.09, 0.06, 0.15), (0.026, 0.014, 0.004), 0.005), np.random.default_rng(1), repeats=1
    )
    with pytest.raises(MergeError, match="are of different shapes: estimate each by itself"):
        compare_evidence([one(1), recording(other, "rr")])


def test_error_names_the_session_with_too_few_strikes():
    short = one(2)
    with pytest.raises(EstimationError, match=r"rr\.mcap: .*leave this recording out of the comparison"):
        compare_evidence([one(1), replace(short, motions=short.motions[:2])])


def test_upper_factor_of_an_sd_from_few_sessions():
    """The 5 % points of chi squared with 1 and 10 degrees of freedom are 0.00393 and 3.940."""
    assert upper_factor(1) == pytest.approx(np.sqrt(1 / 0.00393), rel=1e-3)
    assert upper_factor(10) == pytest.approx(np.sqrt(10 / 3.940), rel=1e-3)


def test_command_writes_page_and_tables(odd, tmp_path, monkeypatch):
    files = [tmp_path / name for name in ("a.mcap", "b.mcap")]
    for file in files:
        file.touch()
    monkeypatch.setattr("analyze.result.comparison.compare_recordings", lambda *_: odd)
    page, tables = tmp_path / "c.html", tmp_path / "tables"
    done = CliRunner().invoke(
        analyze, ["report", "--compare", *map(str, files), "--json", "--csv", str(tables), "-o", str(page)]
    )
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["may_join"] is False
    assert f"report: {page}" in done.stderr
    html = page.read_text(encoding="utf-8")
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    # A panel each: three of the centre of mass, six of moments, three of regions, six of angles.
    assert parser.tags.count("svg") == parser.tags.count("figure") == 18
    assert "script" not in parser.tags
    assert "stands out" in html
    assert all(each.head.content_id in html for each in odd.sessions)
    assert sorted(path.name for path in tables.iterdir()) == ["precision.csv", "results.csv", "sessions.csv"]
    with (tables / "sessions.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["c_x_m"]) for row in rows] == pytest.approx(
        [each.answer.estimate.com.position[0] for each in odd.sessions]
    )


def test_comparison_of_one_file_is_refused(tmp_path: Path):
    done = CliRunner().invoke(analyze, ["report", "--compare", str(tmp_path / "a.mcap")])
    assert done.exit_code == 2
    assert "--compare needs two recordings or more" in done.stderr
