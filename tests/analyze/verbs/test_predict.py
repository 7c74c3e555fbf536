"""`analyze predict` on the sample recording: table, JSON, exit codes."""

from __future__ import annotations

import json
import math

import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from schemas.document import SCHEMA_VERSION
from schemas.predictions import PredictionsResult
from tests.places import RECORDINGS

SAMPLE = str(RECORDINGS / f"sample-{SCHEMA_VERSION}.mcap")


def test_a_missing_file_is_one_line():
    done = CliRunner().invoke(analyze, ["predict", "nowhere.mcap"])
    assert done.exit_code == 1
    assert "nowhere.mcap" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.slow
def test_the_estimated_body_predicts_a_filmed_strike():
    done = CliRunner().invoke(analyze, ["predict", SAMPLE, "--strike", "s2.2", "--json"])
    assert done.exit_code == 0, done.stderr
    found = PredictionsResult.model_validate(json.loads(done.stdout))
    (strike,) = found.strikes
    assert strike.errors.estimated.rms_rad < math.radians(1)
    assert strike.errors.estimated.rms_rad < strike.errors.uniform.rms_rad / 5
    assert strike.friction_is_bound
    assert 0.3 < strike.friction < 0.66


@pytest.mark.slow
def test_strikes_that_cannot_be_predicted_are_named_with_exit_code_3():
    done = CliRunner().invoke(analyze, ["predict", SAMPLE])
    assert done.exit_code == 3
    assert "s1.1: not predicted: without it the other strikes leave" in " ".join(done.stdout.split())
    assert "median" in done.stdout


@pytest.mark.slow
def test_an_unknown_strike_is_refused():
    done = CliRunner().invoke(analyze, ["predict", SAMPLE, "--strike", "s9.9"])
    assert done.exit_code == 1
    assert "s9.9 cannot be predicted" in done.stderr
