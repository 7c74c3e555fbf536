"""`analyze advise` on a recording: the answer so far, and the next strike."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import RecordingError
from analyze.pipeline.estimate_recordings import estimate_recordings
from analyze.verbs.advise.serve import advise_session
from schemas.document import canonical_json
from schemas.watch_lines import AdviceRequest, SessionEstimate

SAMPLE = Path("recordings/sample-1.0.mcap")


def ask(*lines: str, path: Path = SAMPLE) -> list[SessionEstimate]:
    """Answers to some lines of input."""
    out = io.StringIO()
    advise_session(path, io.StringIO("".join(f"{line}\n" for line in lines)), out)
    return [SessionEstimate.model_validate(json.loads(line)) for line in out.getvalue().splitlines()]


def request(number: int, newest: str, **given: object) -> str:
    return canonical_json(AdviceRequest(number=number, strike_id=newest, left=10, **given))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole():
    return estimate_recordings([SAMPLE])


@pytest.fixture(scope="module")
def newest(whole) -> str:
    return whole.evidence.motions[-1].strike_id


@pytest.fixture(scope="module")
def answers(newest: str) -> list[SessionEstimate]:
    lines = ["no request", "[]", '{"kind": "judge"}']
    lines += [
        request(1, newest, target_com_m=5e-3),
        request(2, newest, target_com_m=1e-4),
        request(3, newest, target_inertia=1e-3),
        request(4, newest, target_com_m=1e-4, excluded=["s1"]),
    ]
    return ask(*lines)


def test_every_request_is_answered_and_other_lines_are_ignored(answers) -> None:
    assert [each.number for each in answers] == [1, 2, 3, 4]


def test_the_answer_is_that_of_the_whole_estimate(answers, whole, newest: str) -> None:
    first = answers[0]
    assert first.strike_id == newest
    assert first.strikes == len(whole.planes)
    np.testing.assert_allclose(first.com_m, whole.com.position, atol=1e-6)
    np.testing.assert_allclose(first.com_covariance_m2, whole.com.covariance, atol=1e-10)
    assert first.com_half_width_m == pytest.approx(
        1.96 * float(np.sqrt(np.linalg.eigvalsh(whole.com.covariance)[-1])), rel=1e-3
    )


def test_the_next_strike_is_one_of_the_plan_with_a_reason(answers, whole) -> None:
    chosen = answers[1].next
    assert chosen is not None or answers[1].target.reason
    if chosen is not None:
        assert chosen.strike_id in {strike.id for strike in whole.evidence.plan.strikes}
        assert "centre of mass" in chosen.reason
    if answers[3].next is not None:
        assert answers[3].next.strike_id != "s1"


def test_a_target_that_is_out_of_reach_is_not_met(answers) -> None:
    assert not answers[1].target.met
    assert not answers[2].target.met


def test_outlines_enclose_the_object(answers, whole) -> None:
    lower, upper = whole.evidence.model.bounds
    for outline, axes in zip(answers[0].hull, ((1, 2), (0, 2), (0, 1)), strict=True):
        points = np.array(outline)
        np.testing.assert_allclose(points.min(axis=0), np.asarray(lower)[list(axes)], atol=1e-4)
        np.testing.assert_allclose(points.max(axis=0), np.asarray(upper)[list(axes)], atol=1e-4)


def test_earlier_recordings_count_as_well(newest: str, capsys) -> None:
    (found,) = ask(request(1, newest, target_com_m=1e-3, earlier=[str(SAMPLE)]))[:1] or [None]
    assert found is None  # the same recording given twice may not count twice
    assert "strike" in capsys.readouterr().err


def test_a_file_that_is_no_recording_is_named(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(b"no recording at all")
    with pytest.raises(RecordingError, match=r"r\.mcap"):
        ask(request(1, ""), path=path)


def test_a_recording_that_does_not_come_gets_no_answer(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("analyze.verbs.advise.serve.MAX_WAIT_FOR_RECORD_S", 0.2)
    assert ask(request(1, ""), path=tmp_path / "r.mcap.part") == []
