"""Committed sample recordings, one per schema version: readable, with the right answer, opened by rerun."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from schemas.document import SCHEMA_VERSION
from schemas.result import Result
from tests.places import RECORDINGS

SAMPLES = sorted(RECORDINGS.glob("sample-*.mcap"))


def test_current_schema_version_has_a_sample():
    assert RECORDINGS / f"sample-{SCHEMA_VERSION}.mcap" in SAMPLES


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda path: path.stem)
def test_every_sample_gives_the_right_answer(sample):
    done = CliRunner().invoke(analyze, ["estimate", str(sample), "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    result = Result.model_validate_json(done.stdout)
    truth = read_truth(sample).body
    assert math.dist(result.centre_of_mass.value, truth.com_object) < 0.0005
    assert all(strike.used for strike in result.strikes)
    friction = result.contact_properties.friction
    assert not friction.coefficient.observed
    assert 0.3 < friction.at_least < truth.friction
    assert result.contact_properties.table == "the table of this recording"


@pytest.mark.slow
def test_marker_masses_are_included_in_the_tip_and_subtracted_from_the_answer(tmp_path):
    sample = RECORDINGS / f"sample-{SCHEMA_VERSION}.mcap"
    with open_recording(sample) as recording:
        own = recording.attachments["object.toml"].decode()
    weighed = own.replace("mass_includes_markers = true", "mass_includes_markers = false").replace(
        "id = 0\n", "id = 0\nmass_kg = 0.002\n"
    )
    (tmp_path / "o.toml").write_text(weighed, encoding="utf-8")
    done = CliRunner().invoke(
        analyze,
        ["estimate", str(sample), "--json", "--object", str(tmp_path / "o.toml")],
        catch_exceptions=False,
    )
    result = Result.model_validate_json(done.stdout)
    assert result.mass.value == pytest.approx(0.044), "46 g tipped"
    assert "markers_subtracted" in {warning.code.value for warning in result.warnings}


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda path: path.stem)
def test_rerun_opens_every_sample_unchanged(sample, tmp_path):
    """rerun's MCAP loader runs in a separate process, because it installs signal handlers and threads."""
    program = (
        "import json, sys\n"
        "from rerun.chunk import McapReader, RrdReader\n"
        "source, copy = sys.argv[1:]\n"
        "McapReader(source).stream().write_rrd(copy, application_id='percuss', recording_id='sample')\n"
        "columns = RrdReader(copy).store().schema().component_columns()\n"
        "print(json.dumps([str(column) for column in columns]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(sample), str(tmp_path / "s.rrd")],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    columns = " ".join(json.loads(done.stdout))
    with open_recording(sample) as recording:
        for topic in recording.topics():
            assert topic.name in columns, topic.name
