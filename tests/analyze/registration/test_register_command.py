"""`analyze register` on the recording that is checked in: the places that its object file gives are found again without them."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main as analyze
from schemas.object_spec import read_object_spec

SAMPLE = Path(__file__).resolve().parents[3] / "recordings" / "sample-1.0.mcap"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    output = tmp_path_factory.mktemp("register") / "found.toml"
    result = CliRunner().invoke(analyze, ["register", str(SAMPLE), "--json", "-o", str(output)], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout), output


def test_places_are_those_of_the_file(done):
    answer, _ = done
    assert {entry["marker"] for entry in answer["markers"]} == {1, 2, 5}
    for entry in answer["markers"]:
        assert entry["observed"]
        assert entry["against_file"]["distance_m"] < 3e-4
        assert np.degrees(entry["against_file"]["turn_rad"]) < 0.2
        assert entry["on_surface"]


def test_the_object_file_holds_them_and_all_else_as_it_was(done):
    answer, output = done
    spec = read_object_spec(output)
    written = {marker.name: marker.T_object_marker for marker in spec.marker}
    for entry in answer["markers"]:
        assert np.allclose(written[entry["marker"]], entry["T_object_marker"], atol=1e-6)
    text = tomllib.loads(output.read_text(encoding="utf-8"))
    assert text["name"] == answer["object_name"]
    assert len(text["marker"]) == 6


def test_without_places_estimate_gives_phi_and_names_the_command(done, tmp_path):
    _, output = done
    bare = tmp_path / "bare.toml"
    text = output.read_text(encoding="utf-8").splitlines()
    kept, inside = [], False
    for line in text:
        if line.startswith("T_object_marker"):
            inside = line.count("[") != line.count("]")
            continue
        if inside:
            inside = line.strip() != "]"
            continue
        kept.append(line)
    bare.write_text("\n".join(kept) + "\n", encoding="utf-8")
    assert all(marker.T_object_marker is None for marker in read_object_spec(bare).marker)
    result = CliRunner().invoke(analyze, ["estimate", str(SAMPLE), "--object", str(bare), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    estimate = json.loads(result.stdout)
    assert all(strike["phi"]["observed"] for strike in estimate["strikes"])
    said = next(warning["text"] for warning in estimate["warnings"] if warning["code"] == "markers_unplaced")
    assert "analyze register" in said


def test_undetermined_places_are_refused_in_one_line():
    left = [option for strike in ("s1.1", "s2.2", "s3.1", "s4.1") for option in ("--exclude", strike)]
    result = CliRunner().invoke(analyze, ["register", str(SAMPLE), *left])
    assert result.exit_code == 1
    assert len(result.stderr.strip().splitlines()) == 1
    assert "no strike shows a marker at rest" in result.stderr
