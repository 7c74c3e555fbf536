"""Copies, answers that are out of date, and exported parts of an archive."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

from click.testing import CliRunner

from analyze.catalogue.copies import SAME_CONTENT, SAME_SESSION, find_copies
from analyze.catalogue.superseded import find_superseded
from analyze.cli import main
from analyze.compact.compact import CompactOptions, compact
from analyze.progress import no_progress
from tests.analyze.catalogue.steps import index, names, rows_of, run, scrubbed
from tests.quick_archive import body_of, quick_session


def test_copies_are_found(archive, output) -> None:
    groups = find_copies(list(rows_of(output).values()))
    (group,) = [each for each in groups if each.kind == SAME_CONTENT]
    assert {Path(row["url"]).name for row in (group.best, *group.others)} == {
        "session-0.mcap",
        "copy.mcap",
        "broken-wrong_byte-0.mcap",
    }
    scrubbed(output)
    (group,) = [each for each in find_copies(list(rows_of(output).values())) if each.kind == SAME_CONTENT]
    assert "broken" not in group.best["url"]
    assert "same content: keep" in run("duplicates", "--out", output).stdout
    line = json.loads(run("duplicates", "--out", output, "--json").stdout.splitlines()[0])
    assert line["kind"] == SAME_CONTENT
    assert len(line["others"]) == 2


def test_a_compact_copy_is_a_copy_of_its_original(tmp_path) -> None:
    folder = tmp_path / "archive"
    folder.mkdir()
    quick_session(folder / "raw.mcap", body_of(1), 1, 1, raw=True)
    shutil.copy(folder / "raw.mcap", folder / "small.mcap")
    list(compact(folder / "small.mcap", CompactOptions(), no_progress))
    index(folder, tmp_path / "results")
    rows = rows_of(tmp_path / "results")
    assert rows["small.mcap"]["compaction"] == "exact"
    assert rows["small.mcap"]["source_content_id"] == rows["raw.mcap"]["content_id"]
    (group,) = find_copies(list(rows.values()))
    assert group.kind == SAME_CONTENT
    assert group.best["url"].endswith("small.mcap")


def test_versions_of_a_session_are_found_and_its_answer_is_superseded(recordings, tmp_path) -> None:
    folder, output = tmp_path / "archive", tmp_path / "results"
    folder.mkdir()
    quick_session(folder / "long.mcap", body_of(0), 0, 4, packed=True)
    shutil.copy(recordings / "session-0.mcap", folder / "short.mcap")
    index(folder, output)
    (group,) = find_copies(list(rows_of(output).values()))
    assert (group.kind, Path(group.best["url"]).name) == (SAME_SESSION, "long.mcap")
    CliRunner().invoke(main, ["batch", str(folder), "--out", str(output)])
    (found,) = find_superseded(list(rows_of(output).values()), output)
    assert (Path(found.url).name, Path(found.by).name) == ("short.mcap", "long.mcap")
    assert "other version of the session: 1 answer" in run("superseded", "--out", output).stdout


def test_answers_of_changed_missing_and_older_recordings_are_superseded(archive, output, monkeypatch) -> None:
    CliRunner().invoke(main, ["batch", str(archive), "--out", str(output), "--exclude", "broken-*"])
    assert run("superseded", "--out", output).stdout == "all answers are current\n"
    (archive / "session-2.mcap").touch()
    (archive / "lab" / "session-3.mcap").unlink()
    index(archive, output)
    whys = {Path(each.url).name: each.why for each in find_superseded(list(rows_of(output).values()), output)}
    assert whys["session-2.mcap"] == "changed recording"
    assert whys["session-3.mcap"] == "missing recording"
    monkeypatch.setattr("analyze.catalogue.superseded.analysis_version", lambda: "newer")
    whys = {Path(each.url).name: each.why for each in find_superseded(list(rows_of(output).values()), output)}
    assert whys["session-1.mcap"] == "older analysis"


def test_an_export_is_an_archive_of_its_own(archive, output, tmp_path) -> None:
    CliRunner().invoke(main, ["batch", str(archive), "--out", str(output), "--exclude", "broken-*"])
    scrubbed(output)
    target = tmp_path / "export"
    answer = run("export", target, "--out", output, "--since", "2026-01-02")
    assert answer.exit_code == 0, answer.stderr
    checked = subprocess.run(
        ["sha256sum", "-c", "SHA256SUMS"], cwd=target, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0
    assert len(checked.stdout.splitlines()) == 3
    # Its answers are there: nothing is analysed anew.
    again = CliRunner().invoke(main, ["batch", str(target), "--out", str(target / "results")])
    assert again.exit_code == 0
    assert len(list((target / "results" / "recordings").iterdir())) == 3
    assert {row["scrub"] for row in rows_of(target / "results").values()} == {"whole"}
    assert not scrubbed(target / "results").problems
    # Once more: all is there.
    assert (
        "0 files copied, 3 there already"
        in run("export", target, "--out", output, "--since", "2026-01-02").stdout
    )


def test_an_export_replaces_nothing_and_copies_no_rot(archive, output, tmp_path) -> None:
    target = tmp_path / "export"
    (target / "lab").mkdir(parents=True)
    (target / "lab" / "session-1.mcap").write_bytes(b"mine")
    answer = run("export", target, "--out", output, "--where", "state = 'ok'")
    assert answer.exit_code == 1
    assert "is there with other content: name another folder" in answer.stderr
    assert (target / "lab" / "session-1.mcap").read_bytes() == b"mine"
    scrubbed(output)
    path = archive / "session-2.mcap"
    about = path.stat()
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
    answer = run("export", tmp_path / "other", "--out", output, "--where", "url like '%session-2%'")
    assert answer.exit_code == 1
    assert "its bytes are not those of its scrub" in answer.stderr
    assert not list((tmp_path / "other").rglob("*.mcap*"))


def test_an_export_that_has_no_room_copies_nothing(output, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("analyze.catalogue.export.shutil.disk_usage", lambda _: type("U", (), {"free": 1000}))
    answer = run("export", tmp_path / "export", "--out", output)
    assert answer.exit_code == 1
    assert "MB are needed and 0 MB are free" in answer.stderr
    assert not (tmp_path / "export").exists()


def test_an_export_leaves_other_files_of_its_folder(archive, output, tmp_path) -> None:
    answer = run("export", output.parent, "--out", output)
    assert answer.exit_code == 1
    assert "its results are those of the archive itself" in answer.stderr
    target = tmp_path / "export"
    target.mkdir()
    (target / "SHA256SUMS").write_text("mine\n")
    answer = run("export", target, "--out", output)
    assert answer.exit_code == 1
    assert "is there already, and of no export" in answer.stderr
    assert [path.name for path in target.iterdir()] == ["SHA256SUMS"]


def test_a_second_export_into_a_folder_adds_to_it(archive, output, tmp_path) -> None:
    target = tmp_path / "export"
    for number in (1, 3):
        answer = run("export", target, "--out", output, "--where", f"url like '%session-{number}%'")
        assert answer.exit_code == 0, answer.stderr
    assert len((target / "SHA256SUMS").read_text().splitlines()) == 2
    assert len(rows_of(target / "results")) == 2


def test_an_export_refuses_what_its_scrub_found_damaged(archive, output, tmp_path) -> None:
    scrubbed(output)
    answer = run("export", tmp_path / "export", "--out", output)
    assert answer.exit_code == 1
    assert "damaged at its scrub (1 recording in all)" in answer.stderr
    remedy = answer.stderr.split('--where "')[1].split('"')[0]
    assert run("export", tmp_path / "export", "--out", output, "--where", remedy).exit_code == 0
    assert not list((tmp_path / "export").rglob("broken-wrong_byte*"))


def test_an_export_refuses_a_file_that_is_written_meanwhile(archive, output, tmp_path, monkeypatch) -> None:
    def blocks(url: str):
        yield Path(url).read_bytes()
        os.utime(url)

    monkeypatch.setattr("analyze.catalogue.export.read_blocks", blocks)
    answer = run("export", tmp_path / "export", "--out", output)
    assert answer.exit_code == 1
    assert "changed while it was copied" in answer.stderr
    assert not list((tmp_path / "export").rglob("*.mcap*"))


def test_the_answer_of_former_bytes_is_not_listed(archive, output) -> None:
    CliRunner().invoke(main, ["batch", str(archive), "--out", str(output), "--exclude", "broken-*"])
    path = archive / "session-2.mcap"
    path.touch()
    index(archive, output)
    # The same content at another time has the same answer.
    assert names(output, where="com_x_m is not null and url like '%session-2%'") == ["session-2.mcap"]
    shutil.copy(archive / "lab" / "session-1.mcap", path)
    index(archive, output)
    assert names(output, flags=("not_analysed",), where="url like '%session-2%'") == ["session-2.mcap"]
    assert not names(output, where="com_x_m is not null and url like '%session-2%'")


def test_an_export_refuses_a_file_that_changed_since_the_index(archive, output, tmp_path) -> None:
    for change in (lambda path: os.truncate(path, 1000), Path.unlink):
        change(archive / "session-2.mcap")
        answer = run("export", tmp_path / "export", "--out", output)
        assert answer.exit_code == 1
        assert "session-2.mcap: is gone or changed since it was read into the catalogue" in answer.stderr
        assert not (tmp_path / "export").exists()
    index(archive, output)
    assert run("export", tmp_path / "export", "--out", output).exit_code == 0
