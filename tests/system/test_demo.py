"""The whole path: plan, place, strike, film, record, estimate, score."""

from __future__ import annotations

import json
import math

import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from schemas import topics
from schemas.result import Result
from tests.removed_topics import remove_topics

pytestmark = pytest.mark.timeout(240)


def run(*arguments: object) -> str:
    result = CliRunner().invoke(analyze, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    return result.stdout


def test_every_frame_of_the_session_is_there_or_counted_and_every_topic(session):
    """The camera sends 120 frames per second; each is in the recording or counted as lost.

    Frames are lost when other tests leave too little processor time.
    """
    found = json.loads(run("inspect", session.path, "--json"))
    names = {topic["name"] for topic in found["topics"]}
    assert {
        "/camera/main/image",
        "/camera/main/meta",
        "/camera/main/calibration",
        "/striker/sample",
        "/striker/event",
    } <= names
    assert {
        "/clock/sample",
        "/session/state",
        "/session/strike",
        "/log",
        "/truth/pose",
        "/truth/contact",
        "/truth/body",
    } <= names
    rate = next(topic["rate_hz"] for topic in found["topics"] if topic["name"] == "/camera/main/meta")
    frames, lost = session.report["frames"], session.report["lost"]
    assert rate * (frames + lost) / frames == pytest.approx(120.0, abs=0.5)
    with open_recording(session.path) as recording:
        frame = next(iter(recording.images()))
        assert frame.image.shape == (492, 656)
        assert len({record.plan_strike_id for record in recording.strikes}) == 3


def test_the_centre_of_mass_is_within_its_interval(session):
    result = Result.model_validate_json(run("estimate", session.path, "--json"))
    truth = read_truth(session.path).body
    com = result.centre_of_mass
    assert com.observed
    error = math.dist(com.value, truth.com_object)
    assert error < 0.002
    for value, true, (low, high) in zip(com.value, truth.com_object, com.interval95, strict=True):
        margin = high - low  # one and a half times the half width on either side: 3 sigma
        assert low - margin / 4 <= true <= high + margin / 4, (value, true)


@pytest.mark.slow
def test_the_same_bytes_of_a_whole_session(session, tmp_path):
    first = run("estimate", session.path, "--json")
    assert run("estimate", session.path, "--json") == first
    bare = tmp_path / "bare.mcap"
    remove_topics(session.path, bare, topics.TRUTH_PREFIX)
    assert run("estimate", bare, "--json") == first
