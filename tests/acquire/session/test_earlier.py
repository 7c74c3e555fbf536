"""Strikes of earlier recordings, with which a session goes on."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from acquire.errors import SessionError
from acquire.session.earlier import read_earlier
from analyze.reading.recording import open_recording
from schemas.session_manifest import PLAN_ATTACHMENT

SAMPLE = Path("recordings/sample-1.0.mcap")
PLAN = Path("plan.json")


@pytest.fixture(scope="module")
def plan_json() -> str:
    with open_recording(SAMPLE) as recording:
        return recording.attachments[PLAN_ATTACHMENT].decode()


def test_strikes_and_attempts_of_a_recording_are_read(plan_json: str) -> None:
    found = read_earlier([SAMPLE], plan_json, PLAN)
    with open_recording(SAMPLE) as recording:
        strikes = list(recording.strikes)
    assert [each.strike_id for each in found.strikes] == [each.strike_id for each in strikes]
    assert found.paths == (str(SAMPLE.resolve()),)
    for each in strikes:
        assert found.attempts[each.plan_strike_id] >= each.attempt
    assert found.good == {each.plan_strike_id for each in strikes if each.verdict_code == "good"}


def test_no_recording_gives_no_strikes(plan_json: str) -> None:
    assert read_earlier([], plan_json, PLAN).strikes == ()


def test_a_recording_of_another_plan_is_refused(plan_json: str) -> None:
    with pytest.raises(SessionError, match=r"another plan than plan\.json"):
        read_earlier([SAMPLE], plan_json + " ", PLAN)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.mcap", None, "cannot be read: No such file"),
        ("empty.mcap", b"", "cannot be read"),
        ("text.mcap", b"no recording at all", "is no recording"),
        ("cut.mcap", "cut", "damaged|is no recording"),
    ],
)
def test_other_files_are_refused_with_a_remedy(
    tmp_path: Path, plan_json: str, name: str, content: bytes | str | None, message: str
) -> None:
    path = tmp_path / name
    if content == "cut":
        path.write_bytes(SAMPLE.read_bytes()[:5000])
    elif isinstance(content, bytes):
        path.write_bytes(content)
    with pytest.raises(SessionError, match=message) as caught:
        read_earlier([path], plan_json, PLAN)
    assert "\n" not in str(caught.value)


def test_a_file_that_was_not_finished_names_recover(tmp_path: Path, plan_json: str) -> None:
    shutil.copy(SAMPLE, tmp_path / "r.mcap.part")
    with pytest.raises(SessionError, match=r"acquire recover .*r\.mcap\.part"):
        read_earlier([tmp_path / "r.mcap"], plan_json, PLAN)
