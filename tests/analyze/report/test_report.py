import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

from analyze.report.page import manifest_time
from analyze.report.report import Still, answer_summary, render_report, write_report
from analyze.report.truth import shown_truth
from analyze.result.answer import answer_evidence
from analyze.result.digits import decimals, inertia_unit, number, open_interval, signed, with_interval
from analyze.result.headline import headline
from analyze.result.quantities import quantity
from analyze.result.score import score_answer
from schemas.output_file import OutputError
from schemas.proto import percuss_pb2 as pb
from schemas.result import ResultWarning, WarningCode
from tests.analyze.balanced_html import Balanced
from tests.analyze.simulated_session import carton, session

STILL = Still("z-/x+", "strike 1", "data:image/jpeg;base64,AAAA")


@pytest.fixture(scope="module")
def estimate():
    return answer_evidence(session(carton(), np.random.default_rng(3), repeats=1))


@pytest.fixture(scope="module")
def short():
    """Answer from four strikes: fewer plots to draw, and enough to check each by the others."""
    evidence = session(carton(), np.random.default_rng(3), repeats=1)
    return answer_evidence(replace(evidence, motions=evidence.motions[:4]))


@pytest.fixture(scope="module")
def html(short):
    return render_report(short, [STILL])


def test_page_is_complete_and_self_contained(html, short):
    parser = Balanced()
    parser.feed(html)
    assert parser.open == []
    edges = {strike.axis_id for strike in short.result.strikes}
    # Three views, sources, influences, regions, moments, voxels from three sides with their scale; edges,
    # predictions, and a plot per strike.
    assert parser.tags.count("svg") == 11 + len(edges) + len(short.estimate.predictions) + 4
    assert "script" not in parser.tags
    assert "link" not in parser.tags
    assert not re.search(r'(?:src|href)="(?!data:|#)', html)


def test_page_shows_the_results_numbers(estimate, undrawn):
    html = render_report(estimate, [STILL]).replace("\u00a0±\u00a0", " ± ")
    shown = headline(estimate.result)
    for entry in (*shown.com, *(each for row in shown.tensor for each in row)):
        assert entry.marked in html
    assert Markup.escape(shown.urdf) in html
    for region in estimate.result.regions.regions:
        assert html.count(open_interval(region.mass, 1e3)) == 2  # card and table
    assert "<dd>not named," in html  # its camera states neither vendor nor model
    for strike in estimate.result.strikes:
        assert strike.id in html
        assert f"</span>{with_interval(strike.phi, 180 / np.pi)}<" in html
        assert f"{strike.edge_name} ({strike.axis_id})" in html
    assert estimate.result.inputs.content_id in html
    assert STILL.data_url in html


@pytest.mark.parametrize(
    ("intervals", "expected"),
    [
        (
            [(0.011, 0.044), (0, 0.03), (0, 0.03)],
            "The strikes do not determine which part of it is the heaviest.",
        ),
        (
            [(0.020, 0.0215), (0.01, 0.012), (0.011, 0.012)],
            "The largest part of the mass (48\u00a0%) is in the shell.",
        ),
        ([(0.030, 0.032), (0.004, 0.006), (0.006, 0.008)], "Most of the mass (72\u00a0%) is in the shell."),
    ],
)
def test_heaviest_region_is_named_only_if_the_intervals_determine_it(estimate, intervals, expected):
    ends = np.array(intervals)
    names = ("shell", "upper", "lower")
    determined = replace(
        estimate.estimate.distribution, names=names, masses=ends.mean(axis=1), intervals=ends, explained=True
    )
    answer = replace(estimate, estimate=replace(estimate.estimate, distribution=determined))
    assert expected in answer_summary(answer)
    unexplained = answer_summary(
        replace(
            answer, estimate=replace(estimate.estimate, distribution=replace(determined, explained=False))
        )
    )
    assert "The strikes do not determine which part of it is the heaviest." in unexplained


def test_inconsistent_strike_is_marked_and_reported_once(short, undrawn):
    first, *others = short.estimate.predictions
    missed = replace(first, left_out=replace(first.left_out, sigmas=6.3))
    expected = f"strike {first.left_out.strike_id}: φ differs by -1.50°"
    result = short.result.model_copy(
        update={
            "verdict": [f"repeat {expected}"],
            "warnings": [ResultWarning(code=WarningCode.STRIKE_NOT_PREDICTED, text=expected)],
        }
    )
    page = render_report(
        replace(short, estimate=replace(short.estimate, predictions=(missed, *others)), result=result),
        [STILL],
    )
    assert f"<b>{first.left_out.strike_id}</b> is not as predicted" in page
    assert (
        f'<span class="tag repeat">repeat</span><span>strike {first.left_out.strike_id}: φ differs by'
        " −1.50°</span>" in page
    )
    assert page.count("φ differs by −1.50°") == 1


def test_same_estimate_gives_the_same_page(short, html):
    assert render_report(short, [STILL]) == html


@pytest.fixture(scope="module")
def score(short):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "analyze.result.score.read_truth", lambda path: type("Truth", (), {"body": truth_body()})
        )
        return score_answer(Path("r.mcap"), short)


def truth_body():
    body, normal = carton(), np.array([0.5, -0.35, 0.79])
    return pb.TruthBody(
        mass_kg=body.mass,
        com_object=body.com,
        inertia_com=body.inertia.ravel(),
        edge_radius_m=body.edge_radius,
        region_mass_kg=body.regions,
        region_plane=[*(normal / np.linalg.norm(normal)), 0.005],
    )


def test_ground_truth_is_shown_with_the_estimates(short, score, undrawn):
    page = render_report(short, [], score)
    parser = Balanced()
    parser.feed(page)
    assert parser.open == []
    shown = re.findall(
        r'class="(?:n )?true">(?:<span class="label">[^<]*</span>)?([^<]*)</(?:td|span)>', page
    )
    shown.remove("ground truth")  # the key
    factor = inertia_unit(short.result.inertia.value).factor
    com, phi = (
        [
            number(1e3 * v, decimals(1.96e3 * sd))
            for v, sd in zip(score["centre_of_mass_true_m"], score["centre_of_mass_sd_m"], strict=True)
        ],
        [number(np.degrees(v), 3) for v in score["phi_true_rad"]],
    )
    edge = [number(factor * v, 3) for v in score["i_edge_true_kg_m2"]]
    about_c = [
        number(factor * float(axis.direction @ carton().inertia @ axis.direction), 3)
        for axis in short.estimate.inertial.axes
    ]
    masses = [number(1e3 * v, 1) for v in score["region_mass_true_kg"]]
    assert len(shown) == 3 + 2 * 4 + 3 + 2 * 4
    assert sorted(shown) == sorted([*com, *phi, *edge, *masses, *edge, *about_c])
    for wrong in score["phi_error_rad"]:
        assert f"</span> ({signed(np.degrees(wrong), 3)})</td>" in page


def test_page_without_ground_truth_has_no_truth_column(html):
    assert "truth" not in html.lower()
    assert "true" not in re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)


def test_true_interior_masses_follow_the_estimates_region_names(short, score):
    """The score uses the true dividing plane's names; they swap if the estimated normal is opposite."""
    names = short.estimate.distribution.names
    shell, upper, lower = score["region_mass_true_kg"]
    same = shown_truth(score | {"region_mass_kg": short.estimate.distribution.masses.tolist()}, short)
    assert same.regions == dict(zip(names, (shell, upper, lower), strict=True))
    other = shown_truth(
        score | {"region_mass_kg": short.estimate.distribution.masses[[0, 2, 1]].tolist()}, short
    )
    assert other.regions == dict(zip(names, (shell, lower, upper), strict=True))


def test_number_formats():
    assert [signed(value, 2) for value in (0.004, -0.004, 0.25, -0.25)] == ["0.00", "0.00", "+0.25", "−0.25"]
    assert number(-1234.5, 0) == "−1234"
    assert manifest_time("2026-11-21T21:19:32+01:00") == "2026-11-21 20:19 UTC"
    assert manifest_time("long ago") == "long ago"


def test_object_name_is_escaped(short, undrawn):
    spec = short.estimate.evidence.spec.model_copy(update={"name": "<script>x</script>"})
    evidence = replace(short.estimate.evidence, spec=spec)
    evil = render_report(replace(short, estimate=replace(short.estimate, evidence=evidence)), [])
    assert "<script>" not in evil


def test_failed_write_leaves_no_partial_file(short, undrawn, tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.report.report.camera_stills", lambda *_: [])
    monkeypatch.setattr(
        "schemas.output_file.os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "disk full"))
    )
    with pytest.raises(OutputError, match="cannot be written: disk full"):
        write_report(short, tmp_path / "r.html")
    assert list(tmp_path.iterdir()) == []


def test_mass_interval_ends_at_zero():
    assert quantity(0.001, 0.001, "kg", lowest=0.0).interval95[0] == 0
