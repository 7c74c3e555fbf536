"""Commands on two recordings of one object, made from the sample's four strikes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from acquire.recorder.recover.edit import append_topics
from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from schemas import topics
from schemas.object_spec import object_sha256
from schemas.proto import percuss_pb2 as pb
from tests.analyze.split_recording import as_two_sessions, rewritten
from tests.places import SAMPLE
from tests.removed_topics import remove_topics


def run(*arguments: object) -> Result:
    return CliRunner().invoke(analyze, [str(a) for a in arguments], catch_exceptions=False)


def answer(*arguments: object) -> dict:
    done = run(*arguments)
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions")
    with open_recording(SAMPLE) as recording:
        between = (recording.strikes[1].window_end_ns + recording.strikes[2].window_start_ns) // 2
        for name in ("object.toml", "rig.toml"):
            (folder / name).write_bytes(recording.attachments[name])
    as_two_sessions(SAMPLE, folder / "a.mcap", folder / "b.mcap", between)
    return folder


@pytest.mark.slow
def test_two_sessions_are_estimated_jointly(folder: Path, tmp_path: Path) -> None:
    a, b = folder / "a.mcap", folder / "b.mcap"
    whole, joint = answer("estimate", SAMPLE, "--json"), answer("estimate", a, b, "--json")
    assert answer("estimate", b, a, "--json") == joint
    assert math.dist(whole["centre_of_mass"]["value"], joint["centre_of_mass"]["value"]) < 1e-9
    assert np.allclose(
        whole["centre_of_mass"]["covariance"], joint["centre_of_mass"]["covariance"], rtol=1e-6
    )
    assert [each["recording_id"] for each in joint["inputs"]["recordings"]] == ["one", "two"]
    assert [each["id"].partition(":")[2] for each in joint["strikes"]] == [
        each["id"] for each in whole["strikes"]
    ]
    done = run("estimate", b, a, "--exclude", joint["strikes"][0]["id"])
    assert done.exit_code == 0
    assert "2 recordings" in done.stdout
    assert "1: a.mcap" in done.stdout
    assert answer("score", a, b, "--json")["centre_of_mass_error_m"] < 0.002
    done = run("report", a, b, "-o", tmp_path / "joint.html")
    assert done.exit_code == 0, done.stderr
    html = (tmp_path / "joint.html").read_text(encoding="utf-8")
    assert html.count('src="data:image/jpeg') == len({each["axis_id"] for each in joint["strikes"]})
    for each in joint["inputs"]["recordings"]:
        assert each["content_id"] in html


@pytest.mark.slow
def test_plan_continues_from_both_sessions(folder: Path, tmp_path: Path) -> None:
    a, b, thing = folder / "a.mcap", folder / "b.mcap", folder / "object.toml"
    both = answer("plan", thing, "--given", b, "--given", a, "--strikes", 2, "--json")
    assert [each["id"] for each in both["strikes"]] == ["s5", "s6"]
    # The impact of the virtual rig's arm has a restitution of about 0.4, which the planner has to learn.
    striker = both["hypothesis"]["striker"]
    assert striker["restitution_sd"] < 0.08
    assert abs(striker["restitution"] - 0.4) < 2 * striker["restitution_sd"]
    assert any("estimated from 4 strikes" in warning for warning in both["warnings"])
    (tmp_path / "r.json").write_text(run("estimate", a, b, "--json").stdout, encoding="utf-8")
    # A printed result does not name the rig on which it was made.
    from_result = answer(
        "plan", thing, "--given", tmp_path / "r.json", "--rig", folder / "rig.toml", "--strikes", 2, "--json"
    )
    assert from_result["predicted_com_sd_m"] == pytest.approx(both["predicted_com_sd_m"], rel=1e-6)
    assert [each["axis_id"] for each in from_result["strikes"]] == [
        each["axis_id"] for each in both["strikes"]
    ]
    twice = run("plan", thing, "--given", a, "--given", b, "--given", tmp_path / "r.json", "--strikes", 2)
    assert twice.exit_code == 1
    assert "hold the same recording: no strike may count twice: give one of them" in twice.stderr


def test_unmergeable_files_are_refused_before_the_estimate(folder: Path, tmp_path: Path) -> None:
    a, b = folder / "a.mcap", folder / "b.mcap"
    for verb in ("estimate", "score", "report"):
        more = ["-o", tmp_path / "r.html"] if verb == "report" else []
        done = run(verb, a, b, a, *more)
        assert done.exit_code == 1
        assert f"{a} and {a} are the same recording: no strike may count twice: give it once" in done.stderr
    done = run("estimate", a, b, "--exclude", "s77.1")
    assert done.exit_code == 1
    assert "no strike 's77.1' to exclude: its strikes are 1:" in done.stderr
    done = run("report", a, b)
    assert done.exit_code == 2
    assert "name it with -o" in done.stderr
    done = run("replay", a, b)
    assert done.exit_code == 2
    assert not list(tmp_path.iterdir())


def test_recording_of_another_object_is_refused_with_both_paths(folder: Path, tmp_path: Path) -> None:
    other = _described(folder / "b.mcap", tmp_path / "c.mcap", mass_kg=0.05)
    done = run("estimate", folder / "a.mcap", other)
    assert done.exit_code == 1
    text = (
        f"{folder / 'a.mcap'} and {other} describe their object differently (mass_kg): if it is the same"
        " object, give one object file for both with --object"
    )
    assert text in done.stderr


def test_recordings_with_different_ground_truths_are_not_scored(folder: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.mcap"
    remove_topics(folder / "b.mcap", bare, topics.TRUTH_PREFIX)
    done = run("score", folder / "a.mcap", bare)
    assert done.exit_code == 1
    assert f"{bare}: holds no ground truth" in done.stderr
    body = pb.TruthBody(mass_kg=1.0, com_object=[0.5, 0.5, 0.5], inertia_com=[1.0] * 9)
    append_topics(bare, [(topics.TRUTH_BODY, 1_700_000_000_000_000_000, body.SerializeToString())])
    done = run("score", folder / "a.mcap", bare)
    assert done.exit_code == 1
    assert f"{folder / 'a.mcap'} and {bare}: hold different ground truths" in done.stderr


def _described(source: Path, copy: Path, **changed: object) -> Path:
    """Copy of a recording with these entries of its object file changed."""
    with open_recording(source) as recording:
        spec = recording.object_spec.model_copy(update=changed)
    rewritten(source, copy, {"object": spec, "object_sha256": object_sha256(spec, None)})
    return copy
