"""Runs that overlap exclude each other from one folder of results; shards of one count do not."""

from __future__ import annotations

import errno
import fcntl
import itertools
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
from click.testing import CliRunner

from analyze.batch import results_lock
from analyze.batch.ledger import Entry, Ledger, read_ledgers
from analyze.cli import main
from analyze.errors import ArchiveError
from tests.full_disk import full_disk

OVERLAPPING = [((1, 1), (1, 1)), ((1, 1), (2, 3)), ((2, 3), (1, 1)), ((1, 3), (2, 4)), ((2, 3), (2, 3))]
NO_SCHEDULER = "tcp://127.0.0.1:9"


@pytest.fixture(autouse=True)
def short_retry(monkeypatch):
    monkeypatch.setattr(results_lock, "RETRY_S", 0.1)


@pytest.fixture
def recordings(tmp_path):
    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / "a.mcap").write_bytes(b"")
    return folder


def batch(recordings, output, shard, *options):
    arguments = ["batch", str(recordings), "--out", str(output), "-j", "1", "--shard", "{}/{}".format(*shard)]
    return CliRunner().invoke(main, [*arguments, *options])


@pytest.mark.parametrize("options", [(), ("--scheduler", NO_SCHEDULER)], ids=["processes", "dask"])
@pytest.mark.parametrize(("first", "second"), OVERLAPPING)
def test_an_overlapping_run_is_refused_in_one_line(recordings, tmp_path, first, second, options):
    output = tmp_path / "out"
    with Ledger(output, first, 1):
        refused = batch(recordings, output, second, *options)
    assert refused.exit_code == 1
    (line,) = refused.stderr.splitlines()
    assert line.startswith(f"analyze: {output}: another run")
    assert line.endswith("is writing results there: wait for its end, or use another --out")
    assert ("3 shards" in line) == (first[1] == 3 and first != second)


def test_the_remedies_of_the_refusal_work(recordings, tmp_path):
    output = tmp_path / "out"
    with Ledger(output, (1, 3), 1):
        assert batch(recordings, output, (1, 1)).exit_code == 1
        assert "1 failed" in batch(recordings, tmp_path / "other", (1, 1)).output
    assert "1 failed" in batch(recordings, output, (1, 1)).output


def test_shards_of_one_count_run_side_by_side(tmp_path):
    with ExitStack() as stack:
        for number in (1, 2, 3):
            stack.enter_context(Ledger(tmp_path, (number, 3), number))
    with Ledger(tmp_path, (1, 4), 4):
        pass


def test_shards_that_start_at_once_all_get_the_lock(tmp_path, monkeypatch):
    monkeypatch.setattr(results_lock, "RETRY_S", 10.0)
    begin = threading.Barrier(20)

    def hold(number):
        begin.wait()
        with Ledger(tmp_path, (number, 20), number):
            begin.wait()

    with ThreadPoolExecutor(20) as pool:
        list(pool.map(hold, range(1, 21)))


def test_no_two_counts_ever_hold_the_lock_together(tmp_path):
    """Twelve threads take and leave the lock with counts 1, 2 and 3 for a second."""
    guard, held = threading.Lock(), []
    taken = {1: 0, 2: 0, 3: 0}
    ends = time.monotonic() + 1.0

    def compete(thread):
        for turn in itertools.count():
            if time.monotonic() > ends:
                return
            shards = 1 + (thread + turn) % 3
            try:
                file = results_lock.lock_results(tmp_path, tmp_path, shards)
            except ArchiveError:
                continue
            with guard:
                held.append(shards)
                assert len(set(held)) == 1, held
                assert shards > 1 or len(held) == 1, held
                taken[shards] += 1
            time.sleep(0.001)
            with guard:
                held.remove(shards)
            file.close()

    with ThreadPoolExecutor(12) as pool:
        list(pool.map(compete, range(12)))
    assert min(taken.values()) > 0


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_reported_as_such(tmp_path, monkeypatch, number):
    """Such an error once read as another run's lock."""
    lock = fcntl.flock

    def refuse(file, operation):
        if str(file.name).startswith(str(tmp_path / "nolocks")):
            raise OSError(number, "No locks available")
        lock(file, operation)

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(ArchiveError, match=r"nolocks: its file system has no locks \(No locks available\)"):
        Ledger(tmp_path / "nolocks", (1, 1), 1)
    with Ledger(tmp_path / "other", (1, 1), 1):
        pass


def test_full_disk_loses_the_unfinished_line_alone(tmp_path):
    entries = [Entry(f"{name}.mcap", "1", "2", "3", "4", "", "", [f"{name}.mcap"]) for name in "abcd"]
    with Ledger(tmp_path, (1, 1), 1) as ledger:
        ledger.add(entries[:1])
        size = (tmp_path / "ledger" / "all.jsonl").stat().st_size
        with (
            full_disk(2 * size + 20),
            pytest.raises(ArchiveError, match=r"No space left.*: free space there"),
        ):
            ledger.add(entries[1:])
    with Ledger(tmp_path, (1, 1), 2) as ledger:
        ledger.add(entries[3:])
    assert list(read_ledgers(tmp_path)) == ["a.mcap", "b.mcap", "d.mcap"]
