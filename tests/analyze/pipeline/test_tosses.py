"""Strikes and tosses of one box together: what tosses add, and tosses that contradict the strikes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.flight.toss import TossMotion, analyse_toss
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import merge_evidence, resolve_exclusions
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.solved import EstimateOptions
from analyze.pipeline.tosses import answer_of_flights, thrown_body
from analyze.report.report import render_report
from analyze.result.answer import answer_evidence
from schemas.object_spec import MarkerSpec
from schemas.result import WarningCode
from schemas.session_manifest import CameraCalibrationSpec
from schemas.toss_result import TossVerdict
from tests.analyze.flight.thrown_box import CAMERA, ThrownBox, tossed, tracks
from tests.analyze.pipeline.merged_sessions import recording
from tests.analyze.simulated_session import carton, session

BODY = carton()
BOX = ThrownBox(BODY.size, BODY.mass, BODY.com, BODY.inertia, tag_size=0.03)


@cache
def evidence(shift: float = 0.0, tosses: int = 2) -> Evidence:
    """Session on the carton; c of the body that is tossed lies `shift` [m] higher."""
    plain = session(BODY, np.random.default_rng(5))
    markers = [
        MarkerSpec(
            id=int(each.id),
            size_m=each.size,
            T_object_marker=np.array(each.T_object_marker).tolist(),
            place_sd_m=1e-4,
            turn_sd_rad=2e-3,
        )
        for each in BOX.markers()
    ]
    spec = plain.spec.model_copy(update={"marker": markers, "mass_includes_markers": True})
    (head,) = plain.recordings
    calibration = CameraCalibrationSpec(
        width=CAMERA.width,
        height=CAMERA.height,
        K=CAMERA.K.tolist(),
        T_world_camera=CAMERA.T_world_camera.tolist(),
    )
    cameras = [head.manifest.cameras[0].model_copy(update={"calibration": calibration})]
    manifest = head.manifest.model_copy(update={"cameras": cameras, "object": spec})
    body, prior = thrown_body(spec, plain.model, manifest)
    found: list[TossMotion] = []
    for number in range(tosses):
        box = replace(BOX, com=BOX.com + np.array([0.0, 0.0, shift]))
        views, tags = tossed(box, np.random.default_rng((7, number)), noise_px=0.05)
        found.append(
            analyse_toss((f"t{number}.1", f"t{number}"), tracks(views, tags), CAMERA, tags, body, prior)
        )
    heads = (replace(head, manifest=manifest),)
    return replace(plain, spec=spec, recordings=heads, tosses=tuple(found))


def test_tosses_determine_the_products_of_inertia() -> None:
    both = answer_evidence(evidence())
    alone = answer_evidence(replace(evidence(), tosses=()))
    products = np.array([BODY.inertia[0, 1], BODY.inertia[0, 2], BODY.inertia[1, 2]])
    found = both.estimate.inertial
    off = np.array([found.inertia[0, 1], found.inertia[0, 2], found.inertia[1, 2]]) - products
    largest = np.linalg.eigvalsh(BODY.inertia).max()
    assert np.abs(off).max() < 0.005 * largest
    assert found.measured.all()
    assert not alone.estimate.inertial.measured.all()
    flight = both.result.flight
    assert flight is not None
    assert flight.used
    assert [toss.verdict for toss in flight.tosses] == [TossVerdict.GOOD] * 2
    assert flight.inertia_from is not None
    assert flight.inertia_from[0][1] == "tosses with the size by strikes"
    assert any("strikes and tosses measured them" in line for line in both.result.verdict or [])
    assert alone.result.flight is None


def test_tosses_that_contradict_the_strikes_are_not_used() -> None:
    """Another body thrown than was struck: c 8 mm off."""
    answer = answer_evidence(evidence(0.008))
    alone = answer_evidence(replace(evidence(), tosses=()))
    assert answer.result.flight is not None
    assert not answer.result.flight.used
    assert answer.estimate.com.position.tolist() == alone.estimate.com.position.tolist()
    codes = [warning.code for warning in answer.result.warnings]
    assert WarningCode.TOSSES_NOT_USED in codes


def test_a_toss_can_be_left_out() -> None:
    (head,) = evidence().recordings
    head = replace(head, toss_ids=("t0.1", "t1.1"))
    assert resolve_exclusions([head], frozenset({"t0.1"})) == {"t0.1"}
    other = replace(head, path=head.path.with_name("b.mcap"))
    assert resolve_exclusions([head, other], frozenset({"2:t1.1"})) == {"2:t1.1"}
    result = answer_evidence(evidence(), EstimateOptions(exclude=frozenset({"t0.1"}))).result
    assert result.flight is not None
    assert [(toss.verdict, toss.used) for toss in result.flight.tosses] == [
        (TossVerdict.EXCLUDED, False),
        (TossVerdict.GOOD, True),
    ]


def test_tosses_of_two_recordings_are_averaged_without_a_gain() -> None:
    whole = evidence()
    one = recording(replace(whole, tosses=whole.tosses[:1]), "a")
    other = recording(replace(whole, tosses=whole.tosses[1:]), "bb")
    merged = merge_evidence([one, other])
    assert [toss.toss_id for toss in merged.tosses] == ["1:t0.1", "2:t1.1"]
    markers = placed_markers(whole.spec)
    both = answer_of_flights(merged, markers, frozenset())
    first = answer_of_flights(merged, markers, frozenset({"2:t1.1"}))
    second = answer_of_flights(merged, markers, frozenset({"1:t0.1"}))
    assert both is not None
    assert first is not None
    assert second is not None
    precisions = [np.linalg.inv(each.estimate.covariance) for each in (both, first, second)]
    mean = 0.5 * (precisions[1] + precisions[2])
    assert np.abs(precisions[0] - mean).max() < 1e-6 * np.abs(mean).max()
    assert answer_of_flights(merged, markers, frozenset({"1:t0.1", "2:t1.1"})) is None


def test_tosses_alone_give_the_centre_of_mass_and_the_ratios() -> None:
    answer = answer_evidence(replace(evidence(), motions=()))
    com = answer.estimate.com
    off = (com.position - BODY.com) / np.sqrt(np.diag(com.covariance))
    assert np.abs(off).max() < 4.0
    assert np.linalg.norm(com.position - BODY.com) < 1e-3
    ratio = answer.estimate.inertial.inertia / np.trace(answer.estimate.inertial.inertia)
    assert np.abs(ratio - BODY.inertia / np.trace(BODY.inertia)).max() < 0.01
    assert np.diag(answer.estimate.inertial.measured).tolist() == [False] * 3
    verdict = answer.result.verdict or []
    assert verdict[0].startswith("trust the centre of mass")
    assert "2 tosses agree on it" in verdict[0]
    assert any("the size of the tensor comes from the shape" in text for text in verdict)
    assert answer.result.centre_of_mass_paper is None
    assert answer.result.flight is not None
    assert answer.result.flight.inertia_from is not None
    assert answer.result.flight.inertia_from[0][1] == "tosses with the size by the shape"
    page = render_report(answer, [])
    assert "2 tosses were used, and no strike." in page
    assert "Motion of every strike" not in page


def test_one_strike_beside_tosses_measures_the_size() -> None:
    whole = evidence()
    answer = answer_evidence(replace(whole, motions=whole.motions[:1]))
    found = answer.estimate.inertial
    assert found.measured.all()
    sd = np.diag(found.inertia_sd)
    assert np.all(sd < 0.05 * np.diag(BODY.inertia))
    assert np.abs(np.diag(found.inertia - BODY.inertia) / sd).max() < 4.0
    few = [each.text for each in answer.result.warnings if each.code is WarningCode.FEW_STRIKES]
    assert few == [
        "the size of the tensor rests on 1 strike, which nothing checks: make three or more, about two edges"
    ]


def test_one_toss_alone_is_doubted() -> None:
    answer = answer_evidence(replace(evidence(tosses=1), motions=()))
    verdict = answer.result.verdict or []
    assert verdict[0].startswith("doubt the centre of mass")
    assert "one toss, which nothing checks: toss again" in verdict[0]
    assert not any(text.startswith("trust") for text in verdict)


def test_a_strike_that_contradicts_the_tosses_is_no_answer() -> None:
    shifted = evidence(shift=0.004)
    with pytest.raises(EstimationError, match=r"the tosses contradict the 2 strikes .*--exclude"):
        answer_evidence(replace(shifted, motions=shifted.motions[:2]))


def test_without_strikes_and_good_tosses_there_is_no_answer() -> None:
    whole = evidence()
    bad = tuple(
        replace(toss, verdict=TossVerdict.SLOW, reason="1.0 turns a second: spin it faster")
        for toss in whole.tosses
    )
    with pytest.raises(EstimationError, match=r"no good toss of 2 \(t0.1 slow, t1.1 slow\).*spin it faster"):
        answer_evidence(replace(whole, motions=(), tosses=bad))


def test_excluding_every_toss_says_so() -> None:
    whole = replace(evidence(), motions=())
    options = EstimateOptions(exclude=frozenset(toss.toss_id for toss in whole.tosses))
    with pytest.raises(EstimationError, match=r"every toss is excluded on request \(2\).*exclude fewer"):
        answer_evidence(whole, options)
