"""Answers from recordings whose frame rate only a video file states, with right and wrong rates."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest

from analyze.pipeline.frame_rate import stated_scale
from analyze.pipeline.merge import merge_evidence
from analyze.report.report import render_report
from analyze.report.summary import render_summary
from analyze.result.answer import answer_evidence
from schemas.result import Result, WarningCode
from schemas.session_manifest import TimeSource
from schemas.terminal import Terminal
from tests.analyze.pipeline.merged_sessions import recording
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")

BODY = carton()


def stated(slow):
    return session(BODY, np.random.default_rng(3), repeats=1, slow=slow, time_source=TimeSource.CONTAINER_PTS)


@pytest.fixture(scope="module")
def right():
    return answer_evidence(stated(1.0))


@pytest.fixture(scope="module")
def wrong():
    return answer_evidence(stated(8.0))


def codes(estimate):
    return {warning.code for warning in estimate.result.warnings}


def test_consistent_rate_is_reported_with_its_error(right):
    (times,) = right.result.frame_times
    assert times.possible
    assert times.rate_limits[0] < 1 < times.rate_limits[1]
    assert abs(times.rate_ratio.value - 1) < 3 * times.rate_ratio.sd
    assert times.contact_sd_s == pytest.approx(2.4e-3, rel=0.2)
    assert not codes(right) & {WarningCode.FRAME_RATE_WRONG, WarningCode.FRAME_RATE_UNCHECKED}
    console = Terminal(file=io.StringIO(), width=300)
    render_summary(right, console)
    said = console.file.getvalue()
    assert (
        "time source: container time stamps (± 0.02 ms), 120 frames a second as stated; contact from the"
        " motion's onset, ± 4.5 ms" in said
    )
    assert "frame rate: 1.00" in said


def test_slow_motion_of_960_stated_as_120_is_detected_and_not_used(wrong):
    (times,) = wrong.result.frame_times
    assert not times.possible
    assert times.likely_rate_hz == 960
    (sentence,) = [each for each in wrong.result.verdict if "frame rate" in each]
    assert "import again with --capture-fps 960" in sentence
    assert WarningCode.FRAME_RATE_WRONG in codes(wrong)
    assert not codes(wrong) & {
        WarningCode.GRAVITY_DISAGREES,
        WarningCode.MOMENT_IMPOSSIBLE,
        WarningCode.STRIKE_NOT_PREDICTED,
    }
    assert np.linalg.norm(wrong.estimate.com.position - BODY.com) < 1e-3
    for moment in wrong.result.moments:
        truth = np.array(moment.direction) @ BODY.inertia @ moment.direction
        assert abs(moment.i_com.value - truth) < 3 * moment.i_com.sd
    for strike in wrong.result.strikes:
        assert strike.i_edge.value < 6e-4, "g cm^2: as in the motion, not 64 times that"


def test_json_reads_back_and_device_times_have_no_frame_rate_entry(wrong):
    assert Result.model_validate(json.loads(wrong.json())) == wrong.result
    own = answer_evidence(session(BODY, np.random.default_rng(3), repeats=1))
    assert "frame_times" not in json.loads(own.json())


def test_k_is_discarded_only_for_the_recording_with_a_wrong_rate(right):
    mixed = answer_evidence(merge_evidence([recording(stated(1.0), "a"), recording(stated(8.0), "bb")]))
    assert [times.possible for times in mixed.result.frame_times] == [True, False]
    assert {plane.strike_id.split(":")[0] for plane in mixed.estimate.planes if plane.k is None} == {"2"}
    assert np.linalg.norm(mixed.estimate.com.position - BODY.com) < 1e-3


@pytest.mark.usefixtures("undrawn")
def test_unchecked_rate_is_reported_as_such_in_summary_and_report():
    evidence = stated(1.0)
    few = answer_evidence(replace(evidence, motions=evidence.motions[:3]))
    (times,) = few.result.frame_times
    assert times.rate_ratio is None
    (text,) = [
        warning.text for warning in few.result.warnings if warning.code is WarningCode.FRAME_RATE_UNCHECKED
    ]
    assert "these strikes only show that the frame rate lies" in text
    assert "analyze frame-rate" in text
    page = render_report(few, [])
    assert "Time source: container time stamps" in page
    assert "film a drop" in page


def test_rate_measured_by_a_drop_has_the_drops_sd(right):
    evidence = stated(1.0)
    (head,) = evidence.recordings
    cameras = [head.manifest.cameras[0].model_copy(update={"frame_rate_sd_hz": 1.2})]
    measured = replace(
        evidence, recordings=(replace(head, manifest=head.manifest.model_copy(update={"cameras": cameras})),)
    )
    assert stated_scale(measured).gravity_sd / 9.81 == pytest.approx(0.02, rel=0.01)
    assert stated_scale(evidence).gravity_sd / 9.81 == pytest.approx(0.004, rel=0.01)
    found = answer_evidence(replace(measured, motions=evidence.motions[:3]))
    assert found.result.frame_times[0].frame_rate_sd_hz == 1.2
    assert WarningCode.FRAME_RATE_UNCHECKED not in codes(found)
    console = Terminal(file=io.StringIO(), width=300)
    render_summary(found, console)
    assert "120 frames a second ± 2.4 as measured" in console.file.getvalue()
