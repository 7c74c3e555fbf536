"""Inputs that the answer of the sample recording depends on, and inputs that it must not depend on."""

from __future__ import annotations

import json
import re
import shutil

import pytest
from click.testing import CliRunner

from acquire.recorder.recover.edit import append_topics
from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from tests.places import SAMPLE
from tests.removed_topics import remove_topics

pytestmark = pytest.mark.usefixtures("coarse_regions")


def run(*arguments: object) -> str:
    result = CliRunner().invoke(analyze, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def answer() -> str:
    return run("estimate", SAMPLE, "--json")


def test_result_bytes_are_reproducible_and_independent_of_the_ground_truth(answer, tmp_path):
    bare = tmp_path / "bare.mcap"
    remove_topics(SAMPLE, bare, topics.TRUTH_PREFIX)
    lying = shutil.copyfile(bare, tmp_path / "lying.mcap")
    body = pb.TruthBody(mass_kg=1.0, com_object=[0.5, 0.5, 0.5], inertia_com=[1.0] * 9)
    append_topics(lying, [(topics.TRUTH_BODY, 1_700_000_000_000_000_000, body.SerializeToString())])
    assert run("estimate", lying, "--json") == answer
    with open_recording(SAMPLE) as a, open_recording(lying) as b:
        assert a.content_id == b.content_id


def test_score_has_all_documented_keys():
    score = json.loads(run("score", SAMPLE, "--json"))
    strikes = len(score["strike_ids"])
    assert score["centre_of_mass_error_m"] < 0.002
    assert len(score["phi_error_rad"]) == len(score["i_edge_relative_error"]) == strikes
    assert score["region_mass_error_relative"] >= 0


def test_excluding_a_strike_gives_a_warning_and_changes_the_answer(answer):
    whole = json.loads(answer)
    used = [s["id"] for s in whole["strikes"] if s["used"]]
    less = json.loads(run("estimate", SAMPLE, "--json", "--exclude", used[0]))
    assert "strikes_excluded" in {w["code"] for w in less["warnings"]}
    assert not next(s for s in less["strikes"] if s["id"] == used[0])["used"]
    assert less["centre_of_mass"]["value"] != whole["centre_of_mass"]["value"]


def test_report_is_one_self_contained_file(tmp_path, undrawn):
    """Plots are not drawn here; report/test_report.py draws them."""
    run("report", SAMPLE, "-o", tmp_path / "r.html")
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "centre of mass" in html.lower()
    assert not re.search(r"""(src|href)\s*=\s*["']?https?:|url\(["']?https?:|@import""", html)
    assert 'src="data:' in html or "<svg" in html


def test_edge_radius_given_afterwards_shifts_the_centre_of_mass(answer, tmp_path):
    """Each 0.1 mm of radius moves the rounding's centre line by 0.1 mm from both faces."""
    with open_recording(SAMPLE) as recording:
        own = recording.attachments["object.toml"].decode()
    assert "edge_radius_m = 0.001\n" in own
    (tmp_path / "o.toml").write_text(
        own.replace("edge_radius_m = 0.001\n", "edge_radius_m = 0.002\n"), encoding="utf-8"
    )
    before, after = (
        json.loads(answer),
        json.loads(run("estimate", SAMPLE, "--json", "--object", tmp_path / "o.toml")),
    )
    moved = max(
        abs(a - b)
        for a, b in zip(after["centre_of_mass"]["value"], before["centre_of_mass"]["value"], strict=True)
    )
    assert 1e-4 < moved < 2e-3
    assert "object_overridden" in {warning["code"] for warning in after["warnings"]}
