"""The catalogue of an archive: what is found, and how it is searched."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import duckdb
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from analyze.catalogue import index as index_module
from analyze.catalogue.listing import Selection, list_recordings
from analyze.catalogue.table import CATALOGUE, open_catalogue, read_catalogue
from analyze.cli import main
from analyze.errors import ArchiveError
from tests.analyze.catalogue.steps import NUMBERS, index, names, rows_of, run, scrubbed
from tests.broken_files import KINDS
from tests.bucket import bucket_of


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
        (["--where", "1 = 1)); copy (select 1) to 'x.csv'; select ((1"], "--where: is not one condition"),
        (["--since", "2026-13"], "is not a date"),
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
    count = duckdb.connect().execute(f"select count(*) from '{output / CATALOGUE}'").fetchall()
    assert count == [(10,)]
    assert pq.read_table(output / CATALOGUE).num_rows == 10
    saved = tmp_path / "list.parquet"
    assert run("list", "--out", output, "--save", saved).exit_code == 0
    assert pq.read_table(saved).num_rows == 10


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
