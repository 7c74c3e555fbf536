"""Runs over an archive: every recording is accounted for, none is analysed twice, no result is lost."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.batch.analysis import analyse
from analyze.batch.archive import find_sources
from analyze.batch.ledger import Ledger, read_ledgers
from analyze.batch.query import read_recording_rows, run_query
from analyze.batch.result_rows import STAMPS
from analyze.batch.run import BatchOptions, plan_work, run_batch
from analyze.batch.settings import BatchSettings
from analyze.batch.stored_results import gather_rows
from analyze.batch.worker_messages import Request
from analyze.batch.worker_process import Limits, WorkerProcess, WorkerStoppedError
from analyze.cli import main
from analyze.errors import ArchiveError
from tests.broken_files import KINDS
from tests.full_disk import full_disk
from tests.quick_archive import body_of


def todo(archive, output, **options):
    return plan_work(find_sources([str(archive)]), output, BatchSettings(), BatchOptions(jobs=1, **options))


def run_again(archive, output, **options):
    return run_batch(
        todo(archive, output, **options), output, BatchSettings(), BatchOptions(jobs=1, **options)
    )


def plain(output):
    """Rows of results without the columns that may differ between two runs."""
    return sorted(
        read_recording_rows(output).drop_columns([*STAMPS, "url"]).to_pylist(),
        key=lambda row: (row["key"] or "", row["source_id"]),
    )


@pytest.fixture
def copied(finished, tmp_path):
    """Copy of the results, which a test may change."""
    return Path(shutil.copytree(finished[0], tmp_path / "out"))


class LocalWorker:
    """Worker in this process: starting a process would take longer than these runs."""

    def __init__(self, output, limits):
        self.scratch = output / "unfinished" / "here"
        self.scratch.mkdir(parents=True)

    def analyse(self, request):
        return analyse(request, self.scratch)

    def stop(self):
        pass

    def close(self):
        shutil.rmtree(self.scratch)


@pytest.fixture
def in_process(monkeypatch):
    """Analyse in this process, for tests that do not concern worker processes."""
    monkeypatch.setattr("analyze.batch.run.WorkerProcess", LocalWorker)


def test_every_file_is_accounted_for(archive, finished):
    output, report = finished
    rows = {row["url"]: row for row in read_recording_rows(output).to_pylist()}
    assert len(report.outcomes) == len(rows) == 2 + len(KINDS)
    for url, row in rows.items():
        name = Path(url).name
        expected = "" if name.startswith("session") else KINDS[name.removeprefix("broken-").split("-0.")[0]]
        assert (row["failure"] or "") == expected, row["reason"]
        assert row["status"] == ("failed" if expected else "ok")
        if expected:
            assert name in row["reason"]
            assert "\n" not in row["reason"]


def test_rows_contain_the_true_parameters(finished):
    for row in read_recording_rows(finished[0]).to_pylist():
        if row["status"] == "ok":
            centre = [row[f"com_{axis}_m"] for axis in "xyz"]
            assert np.linalg.norm(np.subtract(centre, body_of(0).com)) < 3e-4
            assert row["strikes_used"] == len(row["strikes"]) == 3
            for strike in row["strikes"]:
                assert strike["verdict"] == "good"
                assert None not in (
                    strike["phi_rad"],
                    strike["phi_sd_rad"],
                    strike["k_per_s2"],
                    strike["k_sd_per_s2"],
                )
            assert all(
                0 < row[f"{name}_sd_kg_m2"] < 1e-4 for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            )
            assert row["peak_memory_bytes"] > 1e7
            assert json.loads(row["result_json"])["inputs"]["content_id"] == row["content_id"]


def test_second_run_analyses_nothing(archive, finished):
    work = todo(archive, finished[0])
    assert not work.todo
    assert len(work.unchanged) == 2 + len(KINDS)
    assert len(work.failed_before) == len(KINDS)
    assert {Path(source.url).name for source in todo(archive, finished[0], only_failed=True).todo} == {
        Path(entry.url).name for entry in work.failed_before
    }


@pytest.mark.usefixtures("in_process")
def test_touched_file_is_opened_and_keeps_its_row(archive, copied, tmp_path):
    moved = tmp_path / "archive"
    shutil.copytree(archive / "a", moved)
    before = {path.name: path.stat().st_mtime_ns for path in (copied / "recordings").iterdir()}
    report = run_again(moved, copied)
    assert [outcome.known for outcome in report.outcomes] == [True, True]
    assert {path.name: path.stat().st_mtime_ns for path in (copied / "recordings").iterdir()} == before
    assert read_recording_rows(copied).num_rows == 2 + len(KINDS), (
        "one row for each content, wherever it lies"
    )


@pytest.mark.usefixtures("in_process")
def test_changed_file_is_analysed_again_and_its_old_row_removed(archive, copied, tmp_path):
    moved = tmp_path / "archive"
    moved.mkdir()
    shutil.copy(archive / "a" / "session-0.mcap", moved / "one.mcap")
    run_again(moved, copied)
    (moved / "one.mcap").write_bytes(b"")
    report = run_again(moved, copied)
    assert [outcome.failure for outcome in report.outcomes] == ["empty"]
    shutil.copy(archive / "a" / "session-1.mcap", moved / "one.mcap")
    assert [outcome.failure for outcome in run_again(moved, copied).outcomes] == [""]
    assert not any(
        row["url"].endswith("one.mcap") and row["failure"] for row in read_recording_rows(copied).to_pylist()
    )


@pytest.mark.usefixtures("in_process")
def test_file_beside_a_failed_one_is_analysed_and_a_removed_file_is_no_failure(archive, copied, tmp_path):
    moved = tmp_path / "archive"
    moved.mkdir()
    (moved / "box.mcap").write_bytes(b"")
    shutil.copy(archive / "a" / "session-0.mcap", moved / "box-2026.mcap")
    report = run_again(moved, copied)
    assert [(Path(each.url).name, each.failure) for each in report.outcomes] == [
        ("box.mcap", "empty"),
        ("box-2026.mcap", ""),
    ]
    assert not todo(moved, copied).todo
    (moved / "box.mcap").unlink()
    run_again(moved, copied)
    assert not any(row["url"].endswith("box.mcap") for row in read_recording_rows(copied).to_pylist())


def test_object_file_that_changes_during_the_run_is_refused(tmp_path):
    path = shutil.copy("docs/examples/teabox.toml", tmp_path)
    settings = BatchSettings.with_object(Path(path))
    settings.refuse_changed_object()
    Path(path).write_text(Path(path).read_text() + "# changed")
    with pytest.raises(ArchiveError, match="changed during the run"):
        settings.refuse_changed_object()


def test_other_settings_analyse_everything_again(archive, finished):
    settings = dataclasses.replace(BatchSettings(), seed=1)
    assert len(
        plan_work(find_sources([str(archive)]), finished[0], settings, BatchOptions()).todo
    ) == 2 + len(KINDS)


def test_failure_on_an_unchanged_file_keeps_its_result(archive, copied, request):
    folder, other = str(archive / "a"), dataclasses.replace(BatchSettings(), seed=1)
    rows = sorted(path.name for path in (copied / "recordings").iterdir())
    hasty = BatchOptions(jobs=1, limits=Limits(0.01, 0))
    report = run_batch(plan_work(find_sources([folder]), copied, other, hasty), copied, other, hasty)
    assert {outcome.failure for outcome in report.outcomes} == {"time_limit"}
    assert sorted(path.name for path in (copied / "recordings").iterdir()) == rows
    request.getfixturevalue("in_process")
    again = run_again(folder, copied)
    assert all(outcome.known for outcome in again.outcomes)


def test_shards_are_disjoint_and_complete(archive, tmp_path):
    parts = [{source.url for source in todo(archive, tmp_path, shard=(i, 3)).todo} for i in (1, 2, 3)]
    assert sum(len(part) for part in parts) == len(set().union(*parts)) == 2 + len(KINDS)


@pytest.mark.usefixtures("in_process")
def test_lines_that_are_no_entries_are_skipped(tmp_path):
    folder = tmp_path / "ledger"
    folder.mkdir()
    entry = {
        "run": 1,
        "url": "a.mcap",
        "source_id": "1",
        "settings": "2",
        "analysis_version": "3",
        "key": "4",
    }
    entry |= {"run": 1, "url": "a.mcap", "failure": "", "reason": "", "own_files": ["a.mcap"]}
    lines = [b"0", b"[]", b"\xff", b"[" * 100000, b'{"run": 1e999}', json.dumps(entry | {"url": 7}).encode()]
    (folder / "all.jsonl").write_bytes(b"\n".join([*lines, json.dumps(entry).encode()]))
    assert list(read_ledgers(tmp_path)) == ["a.mcap"]


@pytest.mark.usefixtures("in_process", "coarse_regions_here")
def test_ledger_with_an_unfinished_line_loses_only_that_line(archive, copied):
    ledger = copied / "ledger" / "all.jsonl"
    ledger.write_bytes(ledger.read_bytes()[:-30])
    work = todo(archive, copied)
    assert len(work.todo) == 1
    run_again(archive, copied)
    assert not todo(archive, copied).todo


def test_second_run_at_the_same_time_is_refused(copied):
    with Ledger(copied, (1, 1), 1), pytest.raises(ArchiveError, match="another run"):
        Ledger(copied, (1, 1), 2)


def test_time_and_memory_limits_give_rows_with_the_reason(archive, tmp_path):
    for limits, failure in (
        (Limits(seconds=0.05), "time_limit"),
        (Limits(memory_bytes=200 << 20), "out_of_memory"),
    ):
        output = tmp_path / failure
        output.mkdir()
        options = BatchOptions(jobs=1, limits=limits)
        work = plan_work(
            find_sources([str(archive / "a" / "session-0.mcap")]), output, BatchSettings(), options
        )
        report = run_batch(work, output, BatchSettings(), options)
        assert [outcome.failure for outcome in report.outcomes] == [failure], report.outcomes[0].reason
        assert "raise --" in read_recording_rows(output).to_pylist()[0]["reason"]


def test_worker_that_dies_gives_a_row_and_the_next_recording_is_analysed(archive, copied):
    source = find_sources([str(archive / "a" / "session-0.mcap")])[0]
    request = Request(source, dataclasses.replace(BatchSettings(), seed=9), str(copied))
    with WorkerProcess(copied, Limits()) as worker:
        worker._running().kill()
        assert worker.analyse(request).failure in {"out_of_memory", "died"}
        empty = find_sources([str(archive / "broken-empty-0.mcap")])[0]
        assert worker.analyse(dataclasses.replace(request, source=empty)).failure == "empty"
        worker.stop()
        with pytest.raises(WorkerStoppedError):
            worker.analyse(request)
    assert not list((copied / "unfinished").iterdir())


@pytest.mark.slow
def test_run_that_was_killed_is_finished_by_the_next(archive, finished, tmp_path):
    output = tmp_path / "out"
    command = [sys.executable, "-m", "analyze", "batch", str(archive), "--out", str(output), "--jobs", "1"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    ends = time.monotonic() + 60
    while not list(output.glob("failures/*.parquet")) and time.monotonic() < ends:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(1.0)  # its worker notices within half a second
    assert not subprocess.run(
        ["pgrep", "-f", f"analyze.batch.worker_main {output}"], capture_output=True, check=False
    ).stdout
    run_again(archive, output)
    assert plain(output) == plain(finished[0])
    assert not list((output / "unfinished").iterdir())


@pytest.mark.slow
def test_ctrl_c_keeps_finished_rows_and_leaves_no_process(archive, finished, tmp_path):
    output = tmp_path / "out"
    command = [sys.executable, "-m", "analyze", "batch", str(archive), "--out", str(output), "--jobs", "2"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    ends = time.monotonic() + 60
    while not list(output.glob("failures/*.parquet")) and time.monotonic() < ends:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "interrupted: finished results stay" in printed
    assert not subprocess.run(
        ["pgrep", "-f", f"analyze.batch.worker_main {output}"], capture_output=True, check=False
    ).stdout
    assert not list((output / "unfinished").iterdir())
    run_again(archive, output)
    assert plain(output) == plain(finished[0])


def test_gathered_rows_equal_the_single_files(copied, monkeypatch):
    alone = read_recording_rows(copied)
    monkeypatch.setattr("analyze.batch.stored_results.GATHER_FROM_ROWS", 1)
    assert read_recording_rows(copied).equals(alone)
    for path in (copied / "recordings").iterdir():
        path.write_bytes(b"gathered by now")
    assert read_recording_rows(copied).equals(alone)
    for path in (copied / "gathered").glob("*.parquet"):
        path.write_bytes(b"damaged")
    for path in (copied / "recordings").iterdir():
        path.unlink()
    assert read_recording_rows(copied).num_rows == len(KINDS), "what is in neither place is not there"


def test_small_gathered_files_are_merged_and_a_repeated_row_counts_once(copied, monkeypatch):
    monkeypatch.setattr("analyze.batch.stored_results.GATHER_FROM_ROWS", 1)
    alone = read_recording_rows(copied)
    keys = [key for key in alone.column("key").to_pylist() if key]
    for part in ([keys[0]], keys):
        gather_rows(copied, part)
    (merged,) = (copied / "gathered").glob("*.parquet")
    # As a run leaves it that was killed before it removed what it had merged.
    (copied / "gathered" / "999999.parquet").write_bytes(merged.read_bytes())
    assert read_recording_rows(copied).equals(alone)
    assert run_query(copied, "select count(*) n from recordings").to_pylist() == [{"n": len(alone)}]


def test_rows_are_not_gathered_while_another_process_reads_them(copied, monkeypatch):
    monkeypatch.setattr("analyze.batch.stored_results.GATHER_FROM_ROWS", 1)
    alone = read_recording_rows(copied)
    for path in (copied / "gathered").glob("*.parquet"):
        path.unlink()
    with (copied / "gathered" / "lock").open("ab") as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        assert read_recording_rows(copied).equals(alone)
        assert not list((copied / "gathered").glob("*.parquet"))


def test_query_can_read_the_tables_and_nothing_else(finished):
    answer = run_query(
        finished[0], "select axis, count(*) as n from strikes group by axis order by axis"
    ).to_pylist()
    assert [row["n"] for row in answer] == [2, 2, 2]
    for sql in (
        "select * from read_csv('/etc/passwd')",
        "copy recordings to 'x.csv'",
        "install httpfs",
        "selec 1",
    ):
        with pytest.raises(ArchiveError) as caught:
            run_query(finished[0], sql)
        assert "\n" not in str(caught.value)


def test_a_full_disk_is_one_line_and_the_next_run_completes(archive, tmp_path, request):
    recording = archive / "a" / "session-0.mcap"
    arguments = ["batch", str(recording), "--out", str(tmp_path / "results"), "-j", "1"]
    with full_disk(50):
        done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("analyze: ")
    assert ": cannot be written: " in line
    assert not list((tmp_path / "results" / "recordings").iterdir())
    request.getfixturevalue("in_process")
    request.getfixturevalue("coarse_regions_here")
    again = CliRunner().invoke(main, arguments)
    assert again.exit_code == 0, again.output
    assert "1 analysed" in again.output
