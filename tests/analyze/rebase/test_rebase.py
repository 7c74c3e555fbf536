"""Recordings with an object file edited after the strikes: numbers, provenance, files, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.batch.settings import BatchSettings, key_of
from analyze.cli import main
from analyze.pipeline.read_evidence import read_head, struck_object
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from analyze.reading.verify import refuse_changed_content
from schemas.object_spec import object_sha256, read_object_spec
from tests.analyze.split_recording import split_recording
from tests.places import FIRST_SAMPLE

SIZES = "[0.08, 0.06, 0.15]"


def _object(folder: Path, *edits: tuple[str, str], name: str = "edited.toml") -> Path:
    with open_recording(FIRST_SAMPLE) as recording:
        text = recording.attachments["object.toml"].decode()
    for before, after in edits:
        assert before in text
        text = text.replace(before, after)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def _run(*arguments: object) -> str:
    done = CliRunner().invoke(main, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    return done.stdout


def _rebased(
    folder: Path, *edits: tuple[str, str], source: Path = FIRST_SAMPLE, name: str = "o.mcap"
) -> Path:
    _run("rebase", source, "--object", _object(folder, *edits), "-o", folder / name)
    return folder / name


def _messages(path: Path) -> dict[str, list[tuple[int, int, bytes]]]:
    with open_recording(path) as recording:
        names = [topic.name for topic in recording.topics() if not topic.name.startswith("/truth/")]
        return {
            name: [(m.log_time_ns, m.sequence, bytes(m.data)) for m in recording.messages(name)]
            for name in names
        }


@pytest.fixture(scope="module")
def heavier(tmp_path_factory) -> Path:
    """The sample recording with 50 g in place of 44 g."""
    return _rebased(tmp_path_factory.mktemp("heavier"), ("mass_kg = 0.044", "mass_kg = 0.05"))


def test_messages_and_truth_are_copied_unchanged_and_the_source_is_not_touched(heavier):
    before = FIRST_SAMPLE.read_bytes()
    assert _messages(heavier) == _messages(FIRST_SAMPLE)
    refuse_changed_content(heavier)
    assert read_truth(heavier).body == read_truth(FIRST_SAMPLE).body
    assert FIRST_SAMPLE.read_bytes() == before
    assert not list(heavier.parent.glob(".*"))


def test_all_files_of_a_series_are_copied(tmp_path):
    with open_recording(FIRST_SAMPLE) as recording:
        strike = recording.strikes[1]
    (tmp_path / "series").mkdir()
    parts = split_recording(FIRST_SAMPLE, tmp_path / "series" / "a.mcap", strike.window_end_ns + 1)
    copy = _rebased(tmp_path, ("mass_kg = 0.044", "mass_kg = 0.05"), source=parts[1])
    with open_recording(copy) as recording:
        assert [part.path.name for part in recording.parts] == ["o.mcap", "o-0002.mcap"]
        assert len(recording.strikes) == 4
        assert struck_object(recording).spec.mass_kg == 0.05
    assert _messages(copy) == _messages(parts[0])


def test_provenance_names_the_original_and_keeps_its_files(heavier):
    with open_recording(FIRST_SAMPLE) as recording, open_recording(heavier) as copy:
        [entry] = copy.manifest.rebased or []
        assert entry.object_sha256 == recording.manifest.object_sha256
        assert entry.plan_sha256 == recording.manifest.plan_sha256
        assert entry.content_id == recording.content_id == copy.content_id
        assert entry.changed == ["mass_kg"]
        assert copy.manifest.object_sha256 == copy.plan.object_sha256 == object_sha256(copy.object_spec, None)
        for name in ("object.toml", "plan.json"):
            assert copy.attachments[f"rebase-1/{name}"] == recording.attachments[name]
        assert copy.attachments["rig.toml"] == recording.attachments["rig.toml"]
    shown = _run("inspect", heavier)
    assert "mass_kg; the earlier files are attached as rebase-1/" in " ".join(shown.split())


def test_strikes_are_read_as_with_the_edited_object_file(heavier, tmp_path):
    """Object and plan are those of the original with --object; with the images, an estimate follows."""
    edited = _object(tmp_path, ("mass_kg = 0.044", "mass_kg = 0.05"))
    with open_recording(FIRST_SAMPLE) as recording, open_recording(heavier) as copy:
        given, own = struck_object(recording, edited), struck_object(copy)
        assert (own.spec, own.sha256, own.overridden) == (given.spec, given.sha256, False)
        assert own.spec.mass_kg == 0.05
        for one, other in zip(own.plan.strikes, given.plan.strikes, strict=True):
            assert one.i_edge_predicted_kg_m2 == pytest.approx(other.i_edge_predicted_kg_m2 * 0.05 / 0.044)
            assert one.model_copy(update={"i_edge_predicted_kg_m2": other.i_edge_predicted_kg_m2}) == other


@pytest.mark.slow
def test_numbers_are_those_of_a_recording_with_that_mass(heavier, tmp_path):
    """They scale with the mass, and are those of `estimate` with the edited object file."""
    light, heavy = (json.loads(_run("estimate", path, "--json")) for path in (FIRST_SAMPLE, heavier))
    assert heavy["mass"]["value"] == 0.05
    assert heavy["centre_of_mass"]["value"] == pytest.approx(light["centre_of_mass"]["value"], abs=1e-5)
    moments = [np.diag(each["inertia"]["value"]) for each in (light, heavy)]
    assert moments[1] == pytest.approx(moments[0] * 0.05 / 0.044, rel=2e-3)
    edited = _object(tmp_path, ("mass_kg = 0.044", "mass_kg = 0.05"))
    given = json.loads(_run("estimate", FIRST_SAMPLE, "--object", edited, "--json"))
    for key in ("mass", "centre_of_mass", "inertia", "strikes", "edge_radii", "regions"):
        assert heavy.get(key) == given.get(key), key
    assert "object_overridden" not in {warning["code"] for warning in heavy["warnings"]}


def test_the_same_content_gives_the_same_plan_and_numbers(heavier, tmp_path):
    """Also by way of another mass and back; a comment in the file is no change."""
    same = _rebased(tmp_path, ('name = "carton"', 'name = "carton" # weighed again'))
    back = _rebased(tmp_path, source=heavier, name="back.mcap")
    with open_recording(FIRST_SAMPLE) as recording:
        expected = struck_object(recording)
        for path, changes in ((same, [[]]), (back, [["mass_kg"], ["mass_kg"]])):
            with open_recording(path) as copy:
                struck = struck_object(copy)
                assert struck.sha256 == expected.sha256
                assert struck.spec == expected.spec
                assert [entry.changed for entry in copy.manifest.rebased or []] == changes
                for one, other in zip(struck.plan.strikes, expected.plan.strikes, strict=True):
                    assert one.pivot == other.pivot
                    assert one.i_edge_predicted_kg_m2 == pytest.approx(
                        other.i_edge_predicted_kg_m2, rel=1e-12
                    )
        with open_recording(same) as copy:
            assert copy.attachments["plan.json"] == recording.attachments["plan.json"]


def test_pivots_follow_the_edges_radii_and_surface_errors(tmp_path):
    edits = [
        ("edge_radius_m = 0.001\n", "edge_radius_m = 0.002\n"),
        ("[shape]", "[shape]\nsurface_sd_m = 0.0004"),
    ]
    path = _rebased(tmp_path, *edits)
    with open_recording(FIRST_SAMPLE) as recording, open_recording(path) as copy:
        expected = struck_object(recording, tmp_path / "edited.toml").plan.strikes
        assert [strike.pivot for strike in copy.plan.strikes] == [strike.pivot for strike in expected]
        assert [strike.pivot for strike in struck_object(copy).plan.strikes] == [s.pivot for s in expected]
        assert {strike.pivot.radius_m for strike in copy.plan.strikes} == {0.002}
        apart = [
            np.subtract(new.pivot.point, old.pivot.point)
            for new, old in zip(copy.plan.strikes, recording.plan.strikes, strict=True)
        ]
    assert np.linalg.norm(apart, axis=1) == pytest.approx(0.001 * 2**0.5, rel=1e-6)


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ("[0.08, 0.0604, 0.15]", None),
        (
            "[0.08, 0.062, 0.15]",
            "strike s1 (p2e0) lies 1.00 mm off the recorded shape's (so do 1 more), by its errors at most",
        ),
        ("[0.08, 0.06, 0.18]", "strike s2 (p4e2) lies 15.00 mm off"),
    ],
)
def test_a_shape_whose_edges_moved_by_more_than_their_error_is_refused(tmp_path, sizes, said):
    edited, output = _object(tmp_path, (SIZES, sizes)), tmp_path / "o.mcap"
    done = CliRunner().invoke(main, ["rebase", str(FIRST_SAMPLE), "--object", str(edited), "-o", str(output)])
    assert "shape.box.size_m" in done.stdout
    assert output.exists() == (said is None)
    assert (said or "") in done.stderr
    assert done.exit_code == (said is not None)


def test_an_edited_file_is_compared_entry_by_entry(tmp_path):
    edits = (
        ("id = 4\nsize_m = 0.03", "id = 9\nsize_m = 0.03"),
        ("[0, 0, 1, 0.075]", "[0, 0, 1, 0.0752]"),
        ("shell_thickness_m = 0.0025\n", '\n[[edge]]\nid = "p4e2"\nradius_m = 0.002\n'),
    )
    edited = _object(tmp_path, *edits)
    shown = json.loads(_run("rebase", FIRST_SAMPLE, "--object", edited, "--dry-run", "--json"))
    found = {each["entry"]: (each["before"], each["after"]) for each in shown["changes"]}
    assert found == {
        "marker 4": ("given", "-"),
        "marker 9": ("-", "given"),
        "edge p4e2": ("-", "given"),
        "shell_thickness_m": ("0.0025", "-"),
    }
    assert shown["plan_holds"]
    assert not list(tmp_path.glob("*.mcap"))


def test_existing_recordings_are_replaced_only_with_force_and_never_the_source(heavier, tmp_path):
    edited = _object(tmp_path)
    kept = tmp_path / "kept.mcap"
    kept.write_bytes(b"precious")

    def run(source: Path, output: Path, *more: str) -> str:
        done = CliRunner().invoke(
            main, ["rebase", str(source), "--object", str(edited), "-o", str(output), *more]
        )
        return done.stderr.strip()

    assert "exists already" in run(FIRST_SAMPLE, kept)
    assert kept.read_bytes() == b"precious"
    assert "is also an input" in run(heavier, heavier, "--force")
    assert run(FIRST_SAMPLE, kept, "--force").startswith("")
    assert read_head(kept).manifest.rebased
    assert (
        "no output is named"
        in CliRunner().invoke(main, ["rebase", str(FIRST_SAMPLE), "--object", str(edited)]).stderr
    )


def test_a_batch_keeps_original_and_copy_apart(heavier):
    original, copy = read_head(FIRST_SAMPLE), read_head(heavier)
    settings = BatchSettings()
    assert key_of(original, settings) != key_of(copy, settings)
    assert key_of(original, settings) == key_of(replace(original, path=Path("other.mcap")), settings)


def test_edited_file_is_a_whole_object_file(heavier, tmp_path):
    """What is attached can be taken out, edited and used again."""
    with open_recording(heavier) as copy:
        path = tmp_path / "again.toml"
        path.write_bytes(copy.attachments["object.toml"])
        assert read_object_spec(path) == copy.object_spec
