"""The recordings that are checked in: each schema version's sample stays readable, gives the right answer, and opens in rerun."""

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


def test_this_schema_version_has_its_sample():
    assert RECORDINGS / f"sample-{SCHEMA_VERSION}.mcap" in SAMPLES


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda path: path.stem)
def test_a_sample_gives_the_right_answer(sample):
    done = CliRunner().invoke(analyze, ["estimate", str(sample), "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    result = Result.model_validate_json(done.stdout)
    assert math.dist(result.centre_of_mass.value, read_truth(sample).body.com_object) < 0.0005
    assert all(strike.used for strike in result.strikes)


@pytest.mark.slow
def test_marker_masses_are_part_of_what_tips_and_taken_off_the_answer(tmp_path):
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
def test_rerun_opens_a_sample_as_it_is(sample, tmp_path):
    """rerun's own MCAP loader, in a process of its own: it installs signal handlers and threads."""
    program = (
        "import json, sys\n"
        "from rerun.chunk import McapReader, RrdReader\n"
        "McapReader(sys.argv[1]).stream().write_rrd(sys.argv[2], application_id='percuss', recording_id='sample')\n"
        "print(json.dumps([str(column) for column in RrdReader(sys.argv[2]).store().schema().component_columns()]))\n"
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
