"""Contents that move, in the Result document, the verdict, the terminal and the report."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.fill_level import Marginal
from analyze.estimation.settled_contents import SettledContents
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.loose_contents import LooseContents
from analyze.report.report import render_report
from analyze.report.summary import render_summary
from analyze.result.answer import Answer, answer_evidence
from analyze.result.assessment import assessment
from analyze.result.contents import contents_lines, contents_text, pose_rows
from analyze.result.document import result_document
from schemas.contents_result import ContentsAnswer
from schemas.result import Result, WarningCode
from schemas.terminal import Terminal
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")
FAST, RISE, K_RATIO = 1.6, np.radians(0.8), 0.96


def lagging(evidence: Evidence) -> Evidence:
    """Session whose second strike over each edge is a fast one that leaves the contents behind."""
    motions = []
    for motion in evidence.motions:
        if motion.strike_id.endswith("#1.1"):
            assert motion.fit is not None
            assert motion.fit.k is not None
            fit = replace(motion.fit, phi=motion.fit.phi + RISE, k=K_RATIO * motion.fit.k)
            motions.append(replace(motion, fit=fit, energy_ratio=FAST))
        else:
            motions.append(motion)
    return replace(evidence, motions=tuple(motions))


@pytest.fixture(scope="module")
def sound() -> Answer:
    return answer_evidence(session(carton(), np.random.default_rng(3)))


@pytest.fixture(scope="module")
def moving() -> Answer:
    evidence = lagging(session(carton(), np.random.default_rng(3)))
    return answer_evidence(replace(evidence, motions=evidence.motions[:6]))


def printed(answer: Answer) -> str:
    out = io.StringIO()
    render_summary(answer, Terminal(file=out, width=120))
    return out.getvalue()


def test_rigid_session_says_what_would_have_shown_and_never_rigid(sound):
    contents = sound.result.contents
    assert contents is not None
    assert contents.answer is ContentsAnswer.NOTHING_MOVES
    assert contents.text.startswith("nothing moves that would show (liquid below ")
    assert contents.detectable_share is not None
    assert contents.detectable_share < 0.2
    assert any(sentence.startswith("trust the centre of mass") for sentence in sound.result.verdict or [])
    assert "Is it rigid? nothing moves" in printed(sound)


def test_nothing_of_a_body_with_moving_contents_is_trusted(moving):
    result = moving.result
    verdict = result.verdict or []
    assert verdict[0].startswith("doubt everything: not rigid: over ")
    assert not [sentence for sentence in verdict if sentence.startswith(("trust", "repeat"))]
    assert WarningCode.NOT_RIGID in {warning.code for warning in result.warnings}
    assert result.contents is not None
    assert len(result.contents.poses) == len({plane.face for plane in moving.estimate.planes})
    first = result.contents.edges[0]
    assert first.energy_ratios == [1.05, FAST]
    assert first.phi_change_rad == pytest.approx(RISE, abs=np.radians(0.15))
    assert first.k_change_relative == pytest.approx(K_RATIO - 1, abs=0.015)


def test_terminal_and_report_list_the_poses(moving):
    text = printed(moving)
    assert "Centre of mass by pose, mm, 95 %" in text
    page = render_report(moving, [])
    assert "Is it rigid?" in page
    for row in pose_rows(moving.result):
        assert row[0] in text
        assert row[0] in page


def test_result_reads_back_and_older_ones_have_no_entry(moving):
    text = moving.result.model_dump_json()
    assert Result.model_validate_json(text).contents == moving.result.contents
    older = moving.result.model_copy(update={"contents": None})
    assert "contents" not in older.model_dump()
    assert contents_lines(older) == []
    assert pose_rows(older) == []


def test_filled_share_of_a_stated_container_is_a_line(moving):
    estimate = moving.estimate
    filled = Marginal(0.4, 0.02, (0.36, 0.44), True)
    settled = SettledContents(filled, Marginal(0.11, 0.01, (0.09, 0.13), True), 0.5)
    result = result_document(replace(estimate, contents=LooseContents(estimate.contents.rigidity, settled)))
    (line,) = contents_lines(result)
    assert line == "By the poses its container is filled to 40.0 ± 4.0 %, with 110 ± 20 g (95 %)"


def test_strikes_that_differ_without_a_sign_of_contents_are_said_to_test_nothing(sound):
    rigidity = sound.estimate.contents.rigidity
    energies = replace(rigidity.energies, chi_squared=900.0, k_probability=0.5, trend_probability=0.5)
    text = contents_text(LooseContents(replace(rigidity, energies=energies)))
    assert text.startswith("not tested: strikes over one edge differ by more than their errors")


def test_strikes_that_jump_are_no_ground_for_trust_where_nothing_was_tested(sound):
    estimate = sound.estimate
    rigidity = estimate.contents.rigidity
    weak = replace(
        rigidity,
        energies=replace(rigidity.energies, share=0.9),
        poses=replace(rigidity.poses, share=0.8),
    )
    untested = LooseContents(weak)
    assert contents_text(untested).startswith("not tested: needs strikes over one edge at three energies")
    assert assessment(replace(estimate, contents=untested))[0].startswith("trust the centre of mass")
    jumped = assessment(replace(estimate, contents=LooseContents(weak, jolted=("s1.1", "s4.1"))))
    assert jumped[0].startswith("doubt everything: not tested: the speed of s1.1, s4.1 jumped")
    assert not [sentence for sentence in jumped if sentence.startswith("trust")]
