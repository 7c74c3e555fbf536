"""One file has one row, whatever its path; what is known of bytes survives that they are away for a while."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from analyze.batch.archive import Source, find_sources
from analyze.catalogue import index as index_module
from analyze.catalogue.copies import find_copies
from analyze.catalogue.index import update_index
from analyze.catalogue.table import open_catalogue, read_catalogue
from analyze.reading.recording import open_recording
from tests.analyze.catalogue.steps import index, names, rows_of, run, scrubbed
from tests.analyze.split_recording import split_recording
from tests.bucket import bucket_of


@pytest.fixture
def series(recordings, tmp_path) -> Path:
    """Folder of a recording with two files, NAME.mcap and NAME-0002.mcap."""
    folder = tmp_path / "series"
    folder.mkdir()
    with open_recording(recordings / "session-1.mcap") as recording:
        at_ns = recording.strikes[1].window_start_ns - 1
    split_recording(recordings / "session-1.mcap", folder / "long.mcap", at_ns)
    return folder


def test_a_path_with_dots_is_the_same_recording(archive, output, monkeypatch) -> None:
    before = read_catalogue(output)
    monkeypatch.chdir(archive.parent)
    for place in ("archive/lab/..", f"{archive}/../archive//", "archive/lab/../*.mcap"):
        assert index(place, output).new == 0
    assert read_catalogue(output).column("url").equals(before.column("url"))


def test_a_link_is_no_copy(recordings, tmp_path) -> None:
    folder, output = tmp_path / "archive", tmp_path / "results"
    folder.mkdir()
    shutil.copy(recordings / "session-0.mcap", folder / "session.mcap")
    (folder / "a-link.mcap").symlink_to("session.mcap")
    (folder / "b-link.mcap").hardlink_to(folder / "session.mcap")
    (tmp_path / "elsewhere").symlink_to("archive")
    index(folder, output)
    index(tmp_path / "elsewhere", output)
    assert len(rows_of(output)) == 3
    assert find_copies(read_catalogue(output).to_pylist()) == []


def test_duplicates_asks_for_a_scrub_before_anything_is_removed(output) -> None:
    assert "1 recording to keep not found whole by a scrub" in run("duplicates", "--out", output).stdout
    scrubbed(output)
    assert "not found whole" not in run("duplicates", "--out", output).stdout


def test_odd_names_are_whole_and_are_exported(recordings, tmp_path) -> None:
    folder, output, target = tmp_path / "archive", tmp_path / "results", tmp_path / "export"
    folder.mkdir()
    odd = ["a::b.mcap", "new\nline.mcap", "back\\slash.mcap", ' q "[0]" é\'.mcap']
    for name in odd:
        shutil.copy(recordings / "session-0.mcap", folder / name)
    index(folder, output)
    assert {row["scrub"] for row in scrubbed(output).rows} == {"whole"}
    answer = run("export", target, "--out", output)
    assert answer.exit_code == 0, answer.stderr
    checked = subprocess.run(["sha256sum", "-c", "SHA256SUMS"], cwd=target, capture_output=True, check=False)
    assert checked.returncode == 0, checked.stderr
    assert len(checked.stdout.splitlines()) == len(odd)


def test_hashes_survive_a_disk_that_is_not_mounted(archive, output) -> None:
    scrubbed(output)
    before = read_catalogue(output)
    archive.rename(archive.with_name("away"))
    archive.mkdir()
    shutil.copy(archive.with_name("away") / "broken-text-0.mcap", archive / "other.mcap")
    assert len(index(archive, output).missing) == 10
    shutil.rmtree(archive)
    archive.with_name("away").rename(archive)
    index(archive, output)
    after = rows_of(output)
    for row in before.to_pylist():
        assert after[Path(row["url"]).name]["sha256"] == row["sha256"]


def test_a_lost_file_of_a_series_is_missing_until_it_returns(series, tmp_path) -> None:
    output = tmp_path / "results"
    index(series, output)
    assert not scrubbed(output).problems
    (series / "long-0002.mcap").rename(tmp_path / "away.mcap")
    assert index(series, output).missing == (str(series / "long.mcap"),)
    assert "long-0002.mcap: is no longer there" in scrubbed(output).problems[0]["scrub_reason"]
    (tmp_path / "away.mcap").rename(series / "long-0002.mcap")
    assert index(series, output).missing == ()
    assert not scrubbed(output).problems


def test_an_exported_series_keeps_its_scrub(series, tmp_path) -> None:
    output, target = tmp_path / "results", tmp_path / "export"
    index(series, output)
    scrubbed(output)
    assert run("export", target, "--out", output).exit_code == 0
    copied, original = (rows_of(each)["long.mcap"] for each in (target / "results", output))
    for name in ("sha256", "size_bytes", "files", "scrub"):
        assert copied[name] == original[name]
    assert index(target, target / "results").unchanged == 1


def test_missing_recordings_can_be_forgotten(archive, output) -> None:
    (archive / "session-2.mcap").unlink()
    assert "missing (forgotten): " in run("index", archive, "--out", output, "--forget-missing").stderr
    assert "session-2.mcap" not in rows_of(output)


def test_a_disk_that_is_not_mounted_is_not_forgotten(archive, output, tmp_path) -> None:
    """Alone it is refused; with another place that is there, its rows stay."""
    other = tmp_path / "other"
    other.mkdir()
    shutil.copy(archive / "session-0.mcap", other / "new.mcap")
    archive.rename(archive.with_name("away"))
    archive.mkdir()
    assert "contains no recording" in run("index", archive, "--out", output, "--forget-missing").stderr
    answer = run("index", other, "--out", output, "--forget-missing")
    assert "missing: " in answer.stderr
    assert "forgotten" not in answer.stderr
    archive.rmdir()
    archive.with_name("away").rename(archive)
    assert index(archive, output).missing == ()
    assert "session-2.mcap" in rows_of(output)


def test_a_moved_recording_keeps_its_hash_when_the_index_is_killed(archive, output, monkeypatch) -> None:
    scrubbed(output)
    before = rows_of(output)["session-2.mcap"]
    (archive / "session-2.mcap").rename(archive / "a-moved.mcap")
    shutil.copy(archive / "lab" / "session-1.mcap", archive / "z-new.mcap")
    read, rows = index_module.read_index_row, []

    def killed(source: Source) -> dict[str, object]:
        if rows:
            raise KeyboardInterrupt  # the catalogue is saved as it is, as at a regular saving before a kill
        rows.append(read(source))
        return rows[0]

    monkeypatch.setattr(index_module, "read_index_row", killed)
    with pytest.raises(KeyboardInterrupt):
        index(archive, output)
    monkeypatch.undo()
    assert rows_of(output)["a-moved.mcap"]["sha256"] == before["sha256"]
    assert index(archive, output).missing == ()
    assert "session-2.mcap" not in rows_of(output)


def test_a_finished_recording_replaces_its_part(archive, output) -> None:
    part = archive / "broken-part-0.mcap.part"
    shutil.copy(archive / "session-0.mcap", part.with_suffix(""))
    part.unlink()
    assert index(archive, output).missing == ()
    assert part.name not in rows_of(output)


def test_a_bucket_s_recordings_left_out_are_not_missing(recordings, tmp_path) -> None:
    output = tmp_path / "results"
    with bucket_of(recordings) as place:
        index(place, output)
        with open_catalogue(output) as catalogue:
            report = update_index(catalogue, find_sources([place], ["session-1*"]), [place])
        assert report.missing == ()


def test_a_bucket_out_of_reach_is_neither_damaged_nor_missing(recordings, tmp_path) -> None:
    output = tmp_path / "results"
    with bucket_of(recordings) as place:
        index(place, output)
        scrubbed(output)
    before = read_catalogue(output)
    report = scrubbed(output)
    assert {row["scrub"] for row in report.rows} == {"unread"}
    assert len(report.problems) == len(before)
    assert read_catalogue(output).equals(before)
    assert names(output, where="scrub = 'whole'")


def test_a_name_that_is_not_utf_8_is_one_line(recordings, tmp_path) -> None:
    shutil.copy(recordings / "session-0.mcap", tmp_path / "good.mcap")
    shutil.copy(recordings / "session-0.mcap", os.fsencode(tmp_path / "bad") + b"\xff.mcap")
    answer = run("index", tmp_path, "--out", tmp_path / "results")
    assert answer.exit_code == 1
    assert "its name is not UTF-8: rename it, or leave it out with --exclude" in answer.stderr
    assert run("index", tmp_path, "--out", tmp_path / "results", "--exclude", "bad*").exit_code == 0


def test_a_link_to_nothing_is_missing_until_its_target_returns(recordings, tmp_path) -> None:
    folder, output = tmp_path / "archive", tmp_path / "results"
    folder.mkdir()
    target = tmp_path / "target.mcap"
    shutil.copy(recordings / "session-0.mcap", target)
    (folder / "link.mcap").symlink_to(target)
    index(folder, output)
    scrubbed(output)
    target.rename(tmp_path / "away.mcap")
    assert index(folder, output).missing == (str(folder / "link.mcap"),)
    assert rows_of(output)["link.mcap"]["state"] == "missing"
    (tmp_path / "away.mcap").rename(target)
    assert index(folder, output).missing == ()
    row = rows_of(output)["link.mcap"]
    assert (row["state"], row["scrub"]) == ("ok", "whole")


def test_a_numbered_file_of_another_recording_is_not_counted_twice(recordings, tmp_path) -> None:
    folder = tmp_path / "archive"
    folder.mkdir()
    for number, name in enumerate(("name.mcap", "name-0002.mcap")):
        shutil.copy(recordings / f"session-{number}.mcap", folder / name)
    index(folder, tmp_path / "results")
    for name, row in rows_of(tmp_path / "results").items():
        assert row["size_bytes"] == (folder / name).stat().st_size
