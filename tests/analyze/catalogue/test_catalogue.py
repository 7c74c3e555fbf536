"""The catalogue of an archive: found, searched, scrubbed, compared and exported."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import duckdb
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from analyze.batch.archive import find_sources
from analyze.catalogue import index as index_module
from analyze.catalogue.copies import SAME_CONTENT, SAME_SESSION, find_copies
from analyze.catalogue.index import update_index
from analyze.catalogue.listing import Selection, list_recordings
from analyze.catalogue.scrub import scrub
from analyze.catalogue.superseded import find_superseded
from analyze.catalogue.table import CATALOGUE, open_catalogue, read_catalogue
from analyze.cli import main
from analyze.compact.compact import CompactOptions, compact
from analyze.errors import ArchiveError
from analyze.progress import no_progress
from tests.broken_files import KINDS, break_file
from tests.bucket import bucket_of
from tests.quick_archive import body_of, quick_session

NUMBERS = range(4)
"""quick sessions: of objects of three kinds, on the first four days of 2026"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for number in NUMBERS:
        quick_session(folder / f"session-{number}.mcap", body_of(number), number, 3, packed=True)
    return folder


@pytest.fixture
def archive(recordings, tmp_path) -> Path:
    """An archive of its own with two folders, a copy of one session, and damaged files."""
    folder = tmp_path / "archive"
    (folder / "lab").mkdir(parents=True)
    for number in NUMBERS:
        name = f"session-{number}.mcap"
        shutil.copy(recordings / name, folder / ("lab" if number % 2 else "") / name)
    shutil.copy(recordings / "session-0.mcap", folder / "lab" / "copy.mcap")
    for kind in ("cut", "text", "empty", "part", "wrong_byte"):
        break_file(recordings / "session-0.mcap", folder, kind)
    return folder


@pytest.fixture
def output(archive, tmp_path) -> Path:
    """Folder of results with the catalogue of the archive."""
    index(archive, tmp_path / "results")
    return tmp_path / "results"


def index(place, output, **options):
    with open_catalogue(output, create=True) as catalogue:
        return update_index(catalogue, find_sources([str(place)]), [str(place)], **options)


def rows_of(output):
    return {Path(row["url"]).name: row for row in read_catalogue(output).to_pylist()}


def names(output, **conditions):
    found = list_recordings(output, Selection(**conditions))
    return [Path(url).name for url in found.column("url").to_pylist()]


def scrubbed(output, **options):
    with open_catalogue(output) as catalogue:
        return scrub(catalogue, sorted(catalogue.rows), output, **options)


def run(*arguments):
    return CliRunner().invoke(main, ["archive", *map(str, arguments)])


def test_every_file_has_a_row_with_what_it_holds(archive, output) -> None:
    rows = rows_of(output)
    assert len(rows) == 10
    states = {name: row["state"] for name, row in rows.items()}
    assert {name for name, state in states.items() if state == "ok"} == {
        *(f"session-{number}.mcap" for number in NUMBERS),
        "copy.mcap",
        # Its head is whole: only reading all of it finds the damage.
        "broken-wrong_byte-0.mcap",
    }
    for kind in ("cut", "text", "empty"):
        assert states[f"broken-{kind}-0.mcap"] == KINDS[kind]
    assert states["broken-part-0.mcap.part"] == "unfinished"
    row = rows["session-1.mcap"]
    assert row["recording_id"] == "quick-1"
    assert row["created"].startswith("2026-01-02T")
    assert row["strikes"] == 3
    assert row["size_bytes"] == (archive / "lab" / "session-1.mcap").stat().st_size


def test_unchanged_recordings_are_not_opened(archive, output, monkeypatch) -> None:
    monkeypatch.setattr(index_module, "read_index_row", lambda _: pytest.fail("opened"))
    report = index(archive, output)
    assert (report.new, report.changed, report.unchanged) == (0, 0, 10)


def test_many_are_read_by_processes_with_the_same_rows(archive, output, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(index_module, "MIN_FOR_PROCESSES", 2)
    index(archive, tmp_path / "other", jobs=2)
    assert read_catalogue(tmp_path / "other").equals(read_catalogue(output))


def test_a_moved_recording_keeps_its_scrub_and_a_missing_one_its_row(archive, output) -> None:
    scrubbed(output)
    (archive / "session-2.mcap").rename(archive / "lab" / "renamed.mcap")
    (archive / "lab" / "session-3.mcap").unlink()
    report = index(archive, output)
    assert [(Path(old).name, Path(new).name) for old, new in report.moved] == [
        ("session-2.mcap", "renamed.mcap")
    ]
    assert [Path(url).name for url in report.missing] == ["session-3.mcap"]
    assert (report.new, report.changed) == (0, 0)
    rows = rows_of(output)
    assert "session-2.mcap" not in rows
    assert rows["renamed.mcap"]["scrub"] == "whole"
    assert rows["session-3.mcap"]["state"] == "missing"
    assert names(output, flags=("missing",)) == ["session-3.mcap"]


def test_a_missing_recording_that_returns_is_present(archive, output, tmp_path) -> None:
    away = tmp_path / "away.mcap"
    (archive / "session-2.mcap").rename(away)
    index(archive, output)
    away.rename(archive / "session-2.mcap")
    index(archive, output)
    assert rows_of(output)["session-2.mcap"]["state"] == "ok"


def test_a_search_meets_all_conditions(output) -> None:
    assert names(output, since="2026-01-03", until="2026-01-04") == ["session-2.mcap", "session-3.mcap"]
    assert sorted(names(output, until="2026-01-01")) == [
        "broken-wrong_byte-0.mcap",
        "copy.mcap",
        "session-0.mcap",
    ]
    assert names(output, object="quick box 70*") == ["session-1.mcap"]
    assert names(output, flags=("foreign",)) == ["broken-text-0.mcap"]
    assert names(output, where="strikes = 3 and url like '%session-3%'") == ["session-3.mcap"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--flag", "wet"], "--flag wet: no recording has it: those that occur are"),
        (["--where", "nothing = 1"], "--where: "),
        (["--where", "1 = 1) or (select count(*) from read_csv('/etc/passwd')) > 0 --"], "--where: "),
        (["--since", "yesterday"], "is not a date"),
        (["--com-z", "7"], "is not a range"),
    ],
)
def test_a_wrong_condition_is_one_line(output, options, text) -> None:
    answer = run("list", "--out", output, *options)
    assert answer.exit_code in {1, 2}
    assert text in answer.stderr
    assert answer.stderr.count("\n") == 1


def test_without_a_catalogue_the_remedy_is_named(tmp_path) -> None:
    answer = run("list", "--out", tmp_path)
    assert answer.exit_code == 1
    assert f"`analyze archive index PATH --out {tmp_path}`" in answer.stderr


def test_answers_stand_beside_their_recordings(archive, output) -> None:
    CliRunner().invoke(main, ["batch", str(archive), "--out", str(output), "--exclude", "broken-*"])
    found = list_recordings(output, Selection(com_mm=(None, None, (-100.0, 100.0))))
    assert {Path(url).name for url in found.column("url").to_pylist()} >= {"session-1.mcap", "copy.mcap"}
    row = found.to_pylist()[0]
    assert row["com_z_mm"] == pytest.approx(1e3 * row["com_z_m"])
    assert (
        "not_analysed"
        in list_recordings(output, Selection(object="", flags=("cut",))).to_pylist()[0]["flags"]
    )
    answer = run("list", "--out", output, "--com-z", "-100..100")
    assert "session-1.mcap" in answer.stdout
    assert len(run("list", "--out", output, "--json").stdout.splitlines()) == 10


def test_other_programs_read_the_table(output, tmp_path) -> None:
    count = duckdb.sql(f"select count(*) from '{output / CATALOGUE}'").fetchall()
    assert count == [(10,)]
    assert pq.read_table(output / CATALOGUE).num_rows == 10
    saved = tmp_path / "list.parquet"
    assert run("list", "--out", output, "--save", saved).exit_code == 0
    assert pq.read_table(saved).num_rows == 10


def test_a_scrub_finds_a_changed_byte_and_names_a_whole_copy(archive, output) -> None:
    first = scrubbed(output)
    assert {Path(row["url"]).name for row in first.problems} == {"broken-wrong_byte-0.mcap"}
    path = archive / "session-0.mcap"
    about = path.stat()
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
    answer = run("scrub", "--out", output)
    assert answer.exit_code == 3
    line = next(line for line in answer.stderr.splitlines() if "session-0.mcap: " in line)
    assert "altered: its bytes changed, their size and time did not" in line
    assert "(a whole one is " in line
    assert "copy.mcap" in line
    # It is found again until it is restored.
    assert rows_of(output)["session-0.mcap"]["scrub"] == "altered"
    shutil.copy2(archive / "lab" / "copy.mcap", path)
    scrubbed(output)
    assert rows_of(output)["session-0.mcap"]["scrub"] == "whole"


def test_a_scrub_finds_damage_outside_of_the_messages(archive, output) -> None:
    """A damaged attachment is not part of the content hash."""
    scrubbed(output)
    path = archive / "session-2.mcap"
    about = path.stat()
    data = bytearray(path.read_bytes())
    data[-20] ^= 1  # in the footer
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
    scrubbed(output)
    assert rows_of(output)["session-2.mcap"]["scrub"] == "altered"


def test_a_scrub_goes_on_where_it_stopped(output) -> None:
    moments = iter(range(100))
    first = scrubbed(output, seconds=3.5, clock=lambda: next(moments))
    assert len(first.rows) == 3
    assert first.left == 7

    def interrupt(_text: str, done: int, _total: int) -> None:
        if done:
            raise KeyboardInterrupt

    second = scrubbed(output, older_than_days=1, progress=interrupt)
    assert second.interrupted
    rest = scrubbed(output, older_than_days=1)
    read = [row["url"] for each in (first, second, rest) for row in each.rows]
    assert sorted(read) == sorted(row["url"] for row in rows_of(output).values())
    assert not scrubbed(output, older_than_days=1).rows


def test_a_missing_recording_fails_its_scrub(archive, output) -> None:
    (archive / "session-2.mcap").unlink()
    report = scrubbed(output)
    assert "is no longer there: restore it from a copy" in next(
        row["scrub_reason"] for row in report.problems if "session-2" in row["url"]
    )


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
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
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


def test_two_writers_exclude_each_other_and_readers_go_on(output) -> None:
    with open_catalogue(output):
        with (
            pytest.raises(ArchiveError, match="another command is changing the catalogue"),
            open_catalogue(output),
        ):
            pass
        assert names(output)


def test_a_killed_index_leaves_the_catalogue_whole(archive, output) -> None:
    before = (output / CATALOGUE).read_bytes()
    for path in archive.rglob("*.mcap"):
        path.touch()
    program = (
        "import analyze.catalogue.index as module, time; slow = module.read_index_row;"
        "module.read_index_row = lambda source: (time.sleep(0.2), slow(source))[1];"
        "from analyze.cli import main;"
        f"main(['archive', 'index', {str(archive)!r}, '--out', {str(output)!r}])"
    )
    with subprocess.Popen([sys.executable, "-c", program]) as process:
        time.sleep(2.5)
        process.send_signal(signal.SIGKILL)
    assert (output / CATALOGUE).read_bytes() == before
    assert index(archive, output).changed == 9


def test_a_bucket_is_catalogued_scrubbed_and_exported(recordings, tmp_path) -> None:
    output = tmp_path / "results"
    with bucket_of(recordings) as place:
        index(place, output)
        assert {row["reason"] for row in rows_of(output).values()} == {None}
        report = scrubbed(output)
        assert {row["scrub"] for row in report.rows} == {"whole"}
        answer = run("export", tmp_path / "export", "--out", output, "--until", "2026-01-01")
        assert answer.exit_code == 0, answer.stderr
        import s3fs

        s3fs.S3FileSystem(skip_instance_cache=True).rm("archive/session-3.mcap")
        report = index(place, output)
        assert report.missing == ("s3://archive/session-3.mcap",)
    assert (tmp_path / "export" / "session-0.mcap").read_bytes() == (
        recordings / "session-0.mcap"
    ).read_bytes()
