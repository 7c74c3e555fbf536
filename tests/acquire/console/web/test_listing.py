"""Objects, plans and recordings by opaque ids."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from acquire.console.web.archive import Archive
from acquire.console.web.listing import Listing, file_id
from acquire.console.web.programs import Analyses
from acquire.console.web.refusal import Refusal
from tests.places import ROOT
from tests.system.complaints import spec_and_plan

SAMPLE = ROOT / "recordings" / "sample-1.0.mcap"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    toml, plan = spec_and_plan()
    inner = tmp_path / "box"
    inner.mkdir()
    (inner / "box.toml").write_text(toml, encoding="utf-8")
    (inner / "plan.json").write_text(plan.model_dump_json(), encoding="utf-8")
    (tmp_path / "rig.toml").write_text('name = "rig"\n', encoding="utf-8")
    (tmp_path / "broken.json").write_text("[" * 5000, encoding="utf-8")
    (tmp_path / "other.json").write_text(
        plan.model_copy(update={"object_sha256": "0" * 64}).model_dump_json(), encoding="utf-8"
    )
    return tmp_path


def test_objects_and_the_plans_that_fit_them_are_listed(folder: Path) -> None:
    listing = Listing(folder)
    listing.refresh()
    (thing,), (plan,) = listing.choices.objects, listing.choices.plans
    assert (thing.file, plan.name, plan.object_id) == ("box/box.toml", "box/plan.json", thing.id)
    assert plan.strikes == len(spec_and_plan()[1].strikes)
    assert listing.paths(thing.id, plan.id)[:2] == (folder / "box/box.toml", folder / "box/plan.json")


@pytest.mark.parametrize("wrong", ["../box/box.toml", "", "x", "0" * 16])
def test_other_ids_name_nothing(folder: Path, wrong: str) -> None:
    listing = Listing(folder)
    listing.refresh()
    thing, plan = listing.choices.objects[0].id, listing.choices.plans[0].id
    for ids in ((wrong, plan), (thing, wrong), (plan, thing)):
        with pytest.raises(Refusal):
            listing.paths(*ids)


def test_a_file_that_changes_is_read_again(folder: Path) -> None:
    listing = Listing(folder)
    listing.refresh()
    path = folder / "box" / "box.toml"
    path.write_text(path.read_text(encoding="utf-8").replace('name = "', 'name = "new '), encoding="utf-8")
    listing.refresh()
    assert [each.name[:4] for each in listing.choices.objects] == ["new "]
    assert listing.choices.plans == []
    path.unlink()
    listing.refresh()
    assert listing.choices.objects == []


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Archive:
    monkeypatch.setenv("PERCUSS_CACHE", str(tmp_path / "cache"))
    recordings = tmp_path / "recordings"
    recordings.mkdir()
    shutil.copy(SAMPLE, recordings / "good.mcap")
    (recordings / "cut.mcap.part").write_bytes(SAMPLE.read_bytes()[:3_000_000])
    (recordings / "cut.mcap").write_bytes(SAMPLE.read_bytes()[:3_000_000])
    (recordings / "rubbish.mcap").write_bytes(b"\x89MCAP0\r\n" + os.urandom(5000))
    (recordings / "empty.mcap").write_bytes(b"")
    (recordings / "notes.txt").write_text("no recording", encoding="utf-8")
    return Archive(recordings, Analyses())


def test_recordings_are_listed_whole_and_broken(archive: Archive) -> None:
    entries = {entry.file: entry for entry in archive.entries()}
    assert set(entries) == {"good.mcap", "cut.mcap", "cut.mcap.part", "rubbish.mcap", "empty.mcap"}
    good = entries["good.mcap"]
    assert (good.object, good.strikes, good.complete, good.com_mm) == ("carton", 4, True, None)
    assert good.date.startswith("2026-")
    assert not any(entry.complete for name, entry in entries.items() if name != "good.mcap")
    assert entries["cut.mcap"].object == "carton"
    assert entries["rubbish.mcap"].flags == ["not complete", "no recording of Percuss"]


def test_a_recording_is_named_by_its_id_only(archive: Archive, tmp_path: Path) -> None:
    path = tmp_path / "recordings" / "good.mcap"
    assert archive.path(file_id(path)) == path
    part = file_id(tmp_path / "recordings" / "cut.mcap.part")
    for call in (archive.finished, archive.estimate, archive.report):
        with pytest.raises(Refusal, match="cut short"):
            call(part)
    for wrong in ("good.mcap", "../good", file_id(tmp_path / "recordings" / "notes.txt")):
        with pytest.raises(Refusal, match="no such recording"):
            archive.path(wrong)


def test_a_continued_recording_is_analysed_with_those_before(archive: Archive, tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    first, second, third = folder / "good.mcap", folder / "second.mcap", folder / "third.mcap"
    for path in (second, third):
        shutil.copy(first, path)
    archive.note_earlier(second, [first])
    archive.note_earlier(third, archive.all_before([file_id(second)]))
    assert archive.together(first) == [first]
    assert archive.together(second) == [first, second]
    assert set(archive.together(third)) == {first, second, third}
    assert archive.together(third)[-1] == third
    first.unlink()
    assert archive.together(second) == [second]


def test_an_estimate_is_kept_until_the_recording_changes(archive: Archive, tmp_path: Path) -> None:
    path = tmp_path / "recordings" / "good.mcap"
    result = archive.estimate(file_id(path))
    entry = next(each for each in archive.entries() if each.file == "good.mcap")
    assert entry.com_mm == pytest.approx([1e3 * each for each in result["centre_of_mass"]["value"]], abs=1e-3)
    assert entry.com_sd_mm is not None
    os.utime(path)
    assert next(each for each in archive.entries() if each.file == "good.mcap").com_mm is None
