import io
import json
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.pipeline.estimate import EstimateOptions
from analyze.report.summary import render_summary
from analyze.result.answer import answer_evidence
from analyze.result.digits import signed
from analyze.result.score import render_score, score_answer, tip_truth
from analyze.types import RollingContact, TipMotion
from schemas.proto import percuss_pb2 as pb
from schemas.result import Result, WarningCode
from schemas.strike_result import Verdict
from schemas.terminal import Terminal
from tests.analyze.estimation.bodies import tip
from tests.analyze.simulated_session import carton, session

BODY = carton()


@pytest.fixture(scope="module")
def evidence():
    return session(BODY, np.random.default_rng(3))


@pytest.fixture(scope="module")
def estimate(evidence):
    return answer_evidence(evidence)


def truth_body():
    return pb.TruthBody(
        mass_kg=BODY.mass,
        com_object=BODY.com,
        inertia_com=BODY.inertia.ravel(),
        edge_radius_m=BODY.edge_radius,
        region_mass_kg=BODY.regions,
        region_plane=[*(np.array([0.5, -0.35, 0.79]) / np.linalg.norm([0.5, -0.35, 0.79])), 0.005],
    )


def codes(estimate):
    return {warning.code for warning in estimate.result.warnings}


def test_estimate_of_a_simulated_session_reaches_the_targets(estimate):
    assert np.linalg.norm(estimate.estimate.com.position - BODY.com) < 1e-3
    for moment in estimate.result.moments:
        truth = np.array(moment.direction) @ BODY.inertia @ moment.direction
        assert moment.i_com.value == pytest.approx(truth, rel=0.08)
    assert np.abs(estimate.estimate.distribution.masses - BODY.regions).mean() / BODY.mass < 0.04


@pytest.mark.usefixtures("coarse_regions_here")
def test_unknown_shell_thickness_is_estimated_and_widens_region_masses(evidence, estimate):
    spec = evidence.spec.model_copy(update={"shell_thickness_m": None})
    found = answer_evidence(replace(evidence, spec=spec))
    low, high = found.result.regions.shell_thickness.interval95
    assert low < BODY.pitch < high
    assert high < 0.8 * found.estimate.distribution.shell.swept[1], (
        "the moments narrow the range of thicknesses"
    )
    assert np.all(found.estimate.distribution.intervals[:, 0] < BODY.regions)
    assert np.all(found.estimate.distribution.intervals[:, 1] > BODY.regions)
    assert (
        np.ptp(found.estimate.distribution.intervals, axis=1).sum()
        > np.ptp(estimate.estimate.distribution.intervals, axis=1).sum()
    )
    assert estimate.result.regions.shell_thickness is None
    assert "shell_thickness" not in json.loads(estimate.json())["regions"]


def test_same_evidence_gives_the_same_bytes(evidence, estimate):
    assert answer_evidence(evidence).json() == estimate.json()


def test_json_is_a_valid_result(estimate):
    data = json.loads(estimate.json())
    assert Result.model_validate(data) == estimate.result
    assert "NaN" not in estimate.json()
    assert data["centre_of_mass"]["frame"] == "O"
    assert sum(strike["information_share"] for strike in data["strikes"]) == pytest.approx(1)


@pytest.mark.usefixtures("coarse_regions_here")
def test_excluded_strike_is_not_used_and_gives_a_warning(evidence):
    name = evidence.motions[0].strike_id
    found = answer_evidence(evidence, EstimateOptions(exclude=frozenset({name})))
    row = found.result.strikes[0]
    assert (row.verdict, row.used, row.information_share) == (Verdict.EXCLUDED, False, 0)
    assert WarningCode.STRIKES_EXCLUDED in codes(found)
    assert len(found.estimate.planes) == len(evidence.motions) - 1


@pytest.mark.usefixtures("coarse_regions_here")
def test_unusable_strike_is_listed_with_its_reason(evidence):
    lost = TipMotion(
        evidence.motions[2].strike_id,
        evidence.motions[2].plan_strike_id,
        Verdict.MARKER_LOST,
        "hidden",
        None,
        None,
        None,
        (),
        None,
    )
    found = answer_evidence(replace(evidence, motions=(*evidence.motions[:2], lost, *evidence.motions[3:])))
    assert found.result.strikes[2].reason == "hidden"
    assert not found.result.strikes[2].used


@pytest.mark.usefixtures("coarse_regions_here")
def test_warning_names_planned_strikes_that_were_not_made(evidence, estimate):
    assert WarningCode.RECORDING_INCOMPLETE not in codes(estimate)
    found = answer_evidence(replace(evidence, motions=evidence.motions[:-2]))
    text = next(each.text for each in found.result.warnings if each.code is WarningCode.RECORDING_INCOMPLETE)
    missing = ", ".join(motion.plan_strike_id for motion in evidence.motions[-2:])
    assert text == f"10 of 12 planned strikes were struck; missing: {missing}"


@pytest.mark.usefixtures("coarse_regions_here")
def test_warning_says_what_a_recovery_lost(evidence, estimate):
    assert WarningCode.RECORDING_RECOVERED not in codes(estimate)
    head = replace(evidence.recordings[0], recovery_losses=("lost: 1 damaged record",))
    found = answer_evidence(replace(evidence, recordings=(head,)))
    text = next(each.text for each in found.result.warnings if each.code is WarningCode.RECORDING_RECOVERED)
    assert text == "the recording was rebuilt by `acquire recover`: lost: 1 damaged record"


@pytest.mark.usefixtures("coarse_regions_here")
def test_warning_says_what_a_compaction_lost(evidence, estimate):
    assert WarningCode.RECORDING_COMPACTED not in codes(estimate)
    head = replace(evidence.recordings[0], losses=("kept where something moves (1 strike compared)",))
    found = answer_evidence(replace(evidence, recordings=(head,)))
    text = next(each.text for each in found.result.warnings if each.code is WarningCode.RECORDING_COMPACTED)
    assert text == (
        "images of the recording were compacted with loss: kept where something moves (1 strike compared)"
    )


def test_refusal_of_strikes_that_rolled_aside_says_what_helps(evidence):
    motions = [replace(motion, verdict=Verdict.ROLLED) for motion in evidence.motions[2:]]
    with pytest.raises(EstimationError, match="most rolled aside on the rim: turn its heavy side towards"):
        answer_evidence(replace(evidence, motions=(*evidence.motions[:2], *motions)))


def test_too_few_strikes_are_refused_with_count_and_remedy(evidence):
    with pytest.raises(EstimationError, match=r"^2 good strikes of 2, 3 are needed.*strike again$"):
        answer_evidence(replace(evidence, motions=evidence.motions[:2]))


def test_too_few_strikes_message_separates_excluded_and_unusable_strikes(evidence):
    four = evidence.motions[:4]
    slid = replace(four[3], verdict=Verdict.SLID, fit=None)
    names = [motion.strike_id for motion in four]
    found = replace(
        evidence,
        motions=(*four[:3], slid),
        plan=evidence.plan.model_copy(update={"strikes": evidence.plan.strikes[:4]}),
    )
    with pytest.raises(EstimationError) as caught:
        answer_evidence(found, EstimateOptions(exclude=frozenset(names[:2])))
    assert str(caught.value) == (
        f"1 good strike of 4, 3 are needed (excluded on request: {names[0]}, {names[1]}; not usable:"
        f" {names[3]} slid): exclude fewer"
    )
    both = found.plan.model_copy(update={"strikes": evidence.plan.strikes[:2]})
    with pytest.raises(
        EstimationError,
        match=r"^0 good strikes of 2, 3 are needed \(excluded on request: [^;]*\): strike again$",
    ):
        answer_evidence(
            replace(found, motions=four[:2], plan=both), EstimateOptions(exclude=frozenset(names[:2]))
        )
    with pytest.raises(
        EstimationError, match=r"2 of 12 planned strikes were struck; missing: .*: strike again$"
    ):
        answer_evidence(replace(evidence, motions=evidence.motions[:2]))


@pytest.mark.usefixtures("coarse_regions_here")
def test_parallel_axes_give_a_result_with_the_unobserved_direction(evidence):
    along_y = tuple(motion for motion in evidence.motions if motion.strike_id.startswith(("z-/x", "x-/z")))
    found = answer_evidence(replace(evidence, motions=along_y))
    com = found.result.centre_of_mass
    assert not com.observed
    assert abs(com.unobserved_direction[1]) > 0.99
    assert WarningCode.DIRECTION_UNOBSERVED in codes(found)


@pytest.mark.usefixtures("coarse_regions_here")
def test_result_holds_the_papers_estimates(estimate):
    assert estimate.result.centre_of_mass_paper is not None
    assert estimate.result.strikes[0].alternatives[0].estimator == "sign_change"
    by_paper = answer_evidence(estimate.estimate.evidence, EstimateOptions(estimator="sign_change"))
    ours, theirs = (np.linalg.norm(found.estimate.com.position - BODY.com) for found in (estimate, by_paper))
    assert ours < theirs


def test_true_phi_and_i_edge_are_about_the_roundings_centre_line(evidence):
    strike = evidence.plan.strikes[0]
    phi, k = tip(BODY, strike)
    truth = tip_truth(strike, truth_body())
    assert truth.phi == pytest.approx(phi, abs=1e-12)
    assert truth.i_edge == pytest.approx(BODY.mass * 9.81 * truth.distance / k, rel=1e-9)


@pytest.mark.usefixtures("coarse_regions_here")
def test_verdict_names_trusted_quantities_and_strikes_to_repeat(evidence, estimate):
    words = estimate.result.verdict
    assert words[0].startswith("trust the centre of mass, to ")
    assert not any(each.startswith("repeat") for each in words)
    assert len([each for each in words if "region masses" in each]) == 1
    every = np.array(estimate.result.inertia_measured).all()
    assert estimate.result.inertia.source == ("measured" if every else "prior")
    assert all(each.consistent for each in estimate.estimate.predictions)
    # Many frames of one strike may be outside together, because they share the error of its phi.
    assert np.mean([each.motion.outside for each in estimate.estimate.predictions]) < 0.15
    assert [strike.prediction.consistent for strike in estimate.result.strikes] == [True] * len(
        evidence.motions
    )
    assert np.array(estimate.result.parameters_covariance).shape == (10, 10)
    odd = evidence.motions[3]
    off = replace(odd, fit=replace(odd.fit, phi=odd.fit.phi + np.radians(2)))
    found = answer_evidence(replace(evidence, motions=(*evidence.motions[:3], off, *evidence.motions[4:])))
    assert next(each for each in found.result.verdict if each.startswith("repeat")).startswith(
        f"repeat strike {odd.strike_id}: φ differs by +"
    )
    assert WarningCode.STRIKE_NOT_PREDICTED in codes(found)
    assert [strike.id for strike in found.result.strikes if not strike.prediction.consistent] == [
        odd.strike_id
    ]


def test_score_has_the_documented_keys(estimate, monkeypatch, tmp_path):
    monkeypatch.setattr(
        "analyze.result.score.read_truth", lambda path: type("Truth", (), {"body": truth_body()})
    )
    score = score_answer(tmp_path / "r.mcap", estimate)
    assert score["centre_of_mass_error_m"] < 1e-3
    assert len(score["phi_error_rad"]) == len(score["i_edge_relative_error"]) == len(estimate.estimate.planes)
    assert np.abs(score["phi_error_rad"]).max() < np.radians(0.3)
    assert np.abs(score["i_edge_relative_error"]).max() < 0.03
    assert score["region_mass_error_relative"] < 0.04
    assert 0 <= score["mass_in_wrong_region"] < 0.06


def test_score_shows_each_moment_error_in_its_strikes_row(estimate, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(
        "analyze.result.score.read_truth", lambda path: type("Truth", (), {"body": truth_body()})
    )
    whole = score_answer(tmp_path / "r.mcap", estimate)["i_edge_relative_error"]
    rows = list(estimate.result.strikes)
    rows[1] = rows[1].model_copy(update={"k": None, "i_edge": None})
    score = score_answer(
        tmp_path / "r.mcap",
        replace(estimate, result=estimate.result.model_copy(update={"strikes": rows})),
    )
    assert score["i_edge_relative_error"] == [whole[0], None, *whole[2:]]
    render_score(score)
    shown = {
        line.split()[0]: line.split()[-1] for line in capsys.readouterr().out.splitlines() if line.strip()
    }
    assert shown[rows[1].id] == "–"
    assert shown[rows[2].id] == signed(100 * whole[2], 2)
    json.dumps(score, allow_nan=False)


def test_score_says_whether_the_intervals_hold_the_truth(estimate, monkeypatch, tmp_path, capsys):
    body = truth_body()
    monkeypatch.setattr("analyze.result.score.read_truth", lambda path: type("Truth", (), {"body": body}))
    com = estimate.result.centre_of_mass
    wide = com.model_copy(
        update={
            "interval95": [[-0.1, 0.1], *com.interval95[1:]],
            "value": [com.value[0] + 0.02, *com.value[1:]],
            "unobserved_direction": [1.0, 0.0, 0.0],
        }
    )
    vague = replace(estimate, result=estimate.result.model_copy(update={"centre_of_mass": wide}))
    score = score_answer(tmp_path / "r.mcap", vague)
    assert score["centre_of_mass_in_interval95"] == [True, True, True]
    render_score(score)
    text = " ".join(capsys.readouterr().out.split())
    assert "95 % intervals, x −100." in text
    assert "hold the truth" in text
    assert "the strikes do not determine it along (1.00, 0.00, 0.00)" in text
    wrong = wide.model_copy(update={"interval95": [[0.09, 0.1], *com.interval95[1:]]})
    off = replace(estimate, result=estimate.result.model_copy(update={"centre_of_mass": wrong}))
    render_score(score_answer(tmp_path / "r.mcap", off))
    assert "miss it along x" in " ".join(capsys.readouterr().out.split())


def test_summary_shows_the_answer(estimate):
    console = Terminal(width=80, record=True, file=io.StringIO())
    render_summary(estimate, console)
    text = console.export_text()
    places = [text.index(each) for each in ("Centre of mass, mm", "Inertia tensor", "<inertial>", "Region")]
    assert places == sorted(places), "the answer comes first"
    assert "shell" in text
    assert "[level]" in " ".join(text.split()), "text in brackets is no markup"


def _rolling_texts(evidence, options=None):
    found = answer_evidence(evidence, options)
    return [warning.text for warning in found.result.warnings if warning.code is WarningCode.ROLLING_CONTACT]


@pytest.mark.usefixtures("coarse_regions_here")
def test_rolling_contact_warnings_only_where_they_apply(evidence):
    assert not _rolling_texts(evidence)
    axis = evidence.plan.strikes[0].axis_id
    strikes = [
        strike.model_copy(update={"rolls": strike.axis_id == axis}) for strike in evidence.plan.strikes
    ]
    (text,) = _rolling_texts(replace(evidence, plan=evidence.plan.model_copy(update={"strikes": strikes})))
    assert axis in text
    assert "intervals include" in text

    def on_a_flank(motion, radius_sd):
        hinge = replace(motion.fit, violated=("it rolls",))
        rolling = RollingContact(0.0, 0.0, 0.02, 5e-5, 1.05, of_shape=True, radius_sd=radius_sd)
        return replace(
            motion,
            fit=replace(motion.fit, estimator="rolling_fit", rolling=rolling),
            alternatives=(*motion.alternatives, hinge),
        )

    def with_flank(radius_sd):
        return replace(evidence, motions=(on_a_flank(evidence.motions[0], radius_sd), *evidence.motions[1:]))

    assert not _rolling_texts(with_flank(2e-4)), "rolling_fit models it"
    (text,) = _rolling_texts(with_flank(4e-3))
    assert "±20%" in text
    (text,) = _rolling_texts(with_flank(2e-4), EstimateOptions(estimator="pivot_fit"))
    assert "which pivot_fit does not model" in text


def test_stages_that_the_benchmark_times_exist():
    from tests.benchmarks.estimate_time import STAGES, stage_owner

    assert all(callable(getattr(stage_owner(name), name)) for name in STAGES)
