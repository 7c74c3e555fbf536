import re
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import OutputError
from analyze.pipeline import estimate_evidence
from analyze.results.document import quantity
from analyze.results.report import Still, render_report, write_report
from tests.analyze.balanced_html import Balanced
from tests.analyze.simulated_session import carton, session

STILL = Still("z-/x+", "strike 1", "data:image/jpeg;base64,AAAA")


@pytest.fixture(scope="module")
def estimate():
    return estimate_evidence(session(carton(), np.random.default_rng(3), repeats=1))


@pytest.fixture(scope="module")
def short():
    """Of three strikes: half as many plots to draw."""
    evidence = session(carton(), np.random.default_rng(3), repeats=1)
    return estimate_evidence(replace(evidence, motions=evidence.motions[:3]))


@pytest.fixture(scope="module")
def html(estimate):
    return render_report(estimate, [STILL])


def test_it_is_whole_and_loads_nothing_from_elsewhere(html):
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    assert parser.tags.count("svg") == 3 + 6
    assert "script" not in parser.tags
    assert "link" not in parser.tags
    assert not re.search(r'(?:src|href)="(?!data:|#)', html)


def test_it_holds_the_numbers(estimate, html):
    for value in estimate.com.position:
        assert f"{1e3 * value:.2f}" in html
    for region in estimate.result.regions.regions:
        assert f"{1e3 * region.mass.value:.1f}" in html
    for strike in estimate.result.strikes:
        assert strike.id in html
        assert f"{np.degrees(strike.phi.value):.2f}" in html
    assert estimate.result.inputs.content_id in html
    assert STILL.data_url in html


def test_the_same_estimate_gives_the_same_page(short):
    assert render_report(short, [STILL]) == render_report(short, [STILL])


def test_truth_is_shown_only_where_there_is_a_score(short, html):
    assert "truth" not in html.lower().replace("against the truth", "")
    score = {
        "centre_of_mass_error_m": 4e-4,
        "centre_of_mass_true_m": carton().com.tolist(),
        "region_mass_error_relative": 0.02,
        "region_names": ["surface", "upper", "lower"],
        "region_mass_true_kg": [0.026, 0.014, 0.004],
        "region_mass_error_relative_baselines": {"surface": 0.27, "uniform": 0.2},
        "i_com_relative_error": {axis.axis_id: 0.01 for axis in short.inertial.axes},
        "strike_ids": [strike.id for strike in short.result.strikes],
        "phi_error_rad": [1e-3] * len(short.result.strikes),
    }
    scored = render_report(short, [], score)
    assert "0.40" in scored
    assert "+0.057°" in scored


def test_a_name_cannot_break_the_page(short):
    spec = short.evidence.spec.model_copy(update={"name": "<script>x</script>"})
    evil = render_report(replace(short, evidence=replace(short.evidence, spec=spec)), [])
    assert "<script>" not in evil


def test_nothing_half_written_is_left(short, tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.results.report.stills", lambda *_: [])
    monkeypatch.setattr("analyze.output_file.os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "disk full")))
    with pytest.raises(OutputError, match="cannot be written: disk full"):
        write_report(short, tmp_path / "r.mcap", tmp_path / "r.html")
    assert list(tmp_path.iterdir()) == []


def test_an_interval_ends_where_the_quantity_does():
    assert quantity(0.001, 0.001, "kg", lowest=0.0).interval95[0] == 0
