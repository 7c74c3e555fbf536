"""Runs on a Dask cluster of two hosts with a network between: what is lost, stopped, full or in the way."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.analyze.batch.one_machine import rows, rows_of_one_machine
from tests.broken_files import break_file
from tests.places import ROOT
from tests.quick_archive import body_of, quick_session
from tests.two_hosts import Host, missing, two_hosts

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(400),
    pytest.mark.skipif(bool(missing()), reason=f"no second host: {missing()}"),
]

WHOLE, SHORT = 4, 26
ALL = WHOLE + SHORT + 1
WORKER_TTL_S = 8
OWN = {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    """Recordings of three strikes and of one, which gives no result, and a damaged one."""
    folder = tmp_path_factory.mktemp("shared")
    for number in range(WHOLE + SHORT):
        strikes = 3 if number < WHOLE else 1
        quick_session(
            folder / f"session-{number:02d}.mcap", body_of(number % 3), number, strikes, packed=True
        )
    break_file(folder / "session-10.mcap", folder, "wrong_byte")
    return folder


@pytest.fixture(scope="module")
def expected(archive, tmp_path_factory):
    """Rows of one machine."""
    return rows_of_one_machine(archive, tmp_path_factory.mktemp("results") / "out")


class Dask:
    """Dask's scheduler on the first of two hosts, and a worker on each."""

    def __init__(self, one: Host, two: Host, log: Path) -> None:
        self.one, self.two, self.address = one, two, f"tcp://{one.address}:8786"
        self._log = log

    def scheduler(self, **settings: str) -> None:
        self._start(self.one, "dask_scheduler", "--port", "8786", **settings)

    def worker(self, host: Host, *options: str, **settings: str) -> None:
        local = ("--nthreads", "1", "--local-directory", str(self._log.parent / f"dask-{host.address}"))
        self._start(host, "dask_worker", self.address, *local, *options, **settings)

    def batch(self, archive: Path, output: Path, *options: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "analyze", "batch", str(archive), "--out", str(output)]
        return self.one.start([*command, "--scheduler", self.address, *options], environment=OWN)

    def _start(self, host: Host, program: str, *options: str, **settings: str) -> None:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *options]
        host.start([*command, "--host", host.address, "--no-dashboard"], self._log, OWN | settings)

    def wait_for_workers(self, number: int) -> None:
        ends = time.monotonic() + 60
        while self._log.read_text().count("Starting worker compute stream") < number:
            assert time.monotonic() < ends, self._log.read_text()
            time.sleep(0.1)


@pytest.fixture
def dask(tmp_path) -> Iterator[Dask]:
    with two_hosts() as (one, two):
        yield Dask(one, two, tmp_path / "dask.log")


@pytest.fixture
def two_workers(dask) -> Dask:
    dask.scheduler(DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=f"{WORKER_TTL_S}s")
    for host in (dask.one, dask.two):
        dask.worker(host)
    dask.wait_for_workers(2)
    return dask


def wait_for_rows(output: Path, number: int, process: subprocess.Popen[str]) -> None:
    ends = time.monotonic() + 120
    while len(list(output.glob("[rf]*s/*.parquet"))) < number:
        assert time.monotonic() < ends
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)


def finished(process: subprocess.Popen[str], code: int = 3) -> str:
    """The last line of the errors of a run that ends with this code."""
    printed, errors = process.communicate(timeout=200)
    assert process.returncode == code, printed + errors
    return errors.splitlines()[-1] if errors else ""


def entries(output: Path) -> Counter[str]:
    """Number of ledger lines of each recording."""
    lines = (output / "ledger" / "all.jsonl").read_text().splitlines()
    return Counter(json.loads(line)["url"] for line in lines if line)


def test_lost_host(two_workers, archive, expected, tmp_path):
    output = tmp_path / "out"
    process = two_workers.batch(archive, output)
    wait_for_rows(output, 8, process)
    two_workers.two.lose()
    finished(process)
    assert rows(output) == expected
    assert set(entries(output).values()) == {1}
    lost = re.findall(r"lose already computed task\(s\).*", (tmp_path / "dask.log").read_text())
    assert sum(line.count("percuss-") for line in lost) <= 2, "received results are not computed again"
    assert list((output / "unfinished").glob("host2-*"))
    finished(two_workers.batch(archive, output), 0)
    assert not list((output / "unfinished").glob("host2-*")), "the next run removes what a lost host left"


def test_stopped_host_comes_back(two_workers, archive, expected, tmp_path):
    """The other host does its work after the time that the scheduler waits for a sign of life."""
    output = tmp_path / "out"
    process = two_workers.batch(archive, output)
    wait_for_rows(output, 4, process)
    two_workers.two.stop()
    stopped = time.monotonic()
    finished(process)
    assert time.monotonic() - stopped < 100
    two_workers.two.go_on()
    time.sleep(3)
    assert rows(output) == expected
    assert set(entries(output).values()) == {1}


def test_host_cut_from_the_network(two_workers, archive, expected, tmp_path):
    output = tmp_path / "out"
    process = two_workers.batch(archive, output)
    wait_for_rows(output, 4, process)
    two_workers.two.cut("down")
    finished(process)
    assert rows(output) == expected
    assert set(entries(output).values()) == {1}


def test_analysis_that_hangs(two_workers, archive, expected, tmp_path):
    output = tmp_path / "out"
    process = two_workers.batch(archive, output, "--time-limit", "20")
    wait_for_rows(output, 4, process)
    (analysis,) = two_workers.two.find("analyze.batch.worker_main")
    os.kill(analysis, signal.SIGSTOP)
    finished(process)
    found = rows(output)
    late = [row["url"] for row in found if row["failure"] == "time_limit"]
    assert len(late) == 1
    assert [row for row in found if row["url"] != late[0]] == [
        row for row in expected if row["url"] != late[0]
    ]
    finished(two_workers.batch(archive, output, "--time-limit", "60", "--only-failed"))
    assert rows(output) == expected, "the remedy in the row"


@contextmanager
def small_disk(folder: Path, size: str) -> Iterator[None]:
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_full_disk_of_the_results(archive, expected, tmp_path):
    output = tmp_path / "out"
    with small_disk(output, "200k"), two_hosts() as (one, two):
        dask = Dask(one, two, tmp_path / "dask.log")
        dask.scheduler()
        for host in (one, two):
            dask.worker(host)
        line = finished(dask.batch(archive, output), 1)
        assert line.startswith(
            f"analyze: {output}: cannot be written: No space left on device: free space there"
        )
        done = len(list(output.glob("[rf]*s/*.parquet")))
        assert 0 < done < ALL
        subprocess.run(["mount", "-o", "remount,size=50m", str(output)], check=True)
        finished(dask.batch(archive, output))
        assert rows(output) == expected
        other = tmp_path / "other"
        finished(dask.batch(archive, other))
        assert len(rows(other)) == ALL


def test_scheduler_lost_and_started_again(two_workers, archive, expected, tmp_path):
    output = tmp_path / "out"
    process = two_workers.batch(archive, output)
    wait_for_rows(output, 4, process)
    for each in two_workers.one.find("dask_scheduler"):
        os.kill(each, signal.SIGKILL)
    line = finished(process, 1)
    assert line.endswith(
        f"{two_workers.address}: lost: start the scheduler again, then repeat the same command"
    )
    two_workers.scheduler()
    for host in (two_workers.one, two_workers.two):
        two_workers.worker(host)
    finished(two_workers.batch(archive, output))
    assert rows(output) == expected


def test_second_run_into_the_results_is_refused(two_workers, archive, expected, tmp_path):
    output = tmp_path / "out"
    process = two_workers.batch(archive, output)
    wait_for_rows(output, 1, process)
    line = finished(two_workers.batch(archive, output), 1)
    assert line.endswith("another run is writing results there: wait for its end, or use another --out")
    finished(process)
    assert rows(output) == expected


def test_recording_whose_workers_end(dask, archive, tmp_path):
    """The scheduler's number of failures is 1 instead of its 3."""
    output, one = tmp_path / "out", archive / "session-10.mcap"
    dask.scheduler(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1")
    dask.worker(dask.two)
    dask.wait_for_workers(1)
    process = dask.batch(one, output)
    for turn in (1, 2):
        killed: set[int] = set()
        ends = time.monotonic() + 60
        while not killed:
            assert time.monotonic() < ends
            killed = set(dask.two.find("analyze.batch.worker_main"))
        for each in dask.two.find("spawn_main"):
            os.kill(each, signal.SIGKILL)
        while turn == 1 and killed & set(dask.two.find("analyze.batch.worker_main")):
            assert time.monotonic() < ends
    line = finished(process)
    assert line.endswith(f"{one}: 2 workers ended during its analysis: add --only-failed to try it again")
    line = finished(dask.batch(one, output, "--only-failed"))
    assert "too_few_strikes" in line


def test_worker_that_does_not_see_the_results(dask, archive, expected, tmp_path):
    """Its rows once went into a folder of its own, and were missing in the results."""
    output = tmp_path / "out"
    output.mkdir()
    dask.scheduler()
    dask.two.run("mount", "-t", "tmpfs", "tmpfs", str(output))
    dask.worker(dask.two)
    dask.wait_for_workers(1)
    line = finished(dask.batch(archive, output), 1)
    assert line.startswith(
        f"analyze: host2: its worker does not see the results in {output}: share this folder"
    )
    dask.two.run("umount", "--lazy", str(output))
    finished(dask.batch(archive, output))
    assert rows(output) == expected


def test_worker_of_another_version(dask, archive, expected, tmp_path):
    output, other = tmp_path / "out", tmp_path / "other"
    for package in ("analyze", "schemas"):
        shutil.copytree(ROOT / package, other / package)
    with (other / "analyze" / "types.py").open("a") as file:
        file.write("CHANGED = True\n")
    dask.scheduler()
    dask.worker(dask.two, "--no-nanny", PYTHONPATH=str(other), PYTHONSAFEPATH="1")
    dask.wait_for_workers(1)
    line = finished(dask.batch(archive, output), 1)
    assert line.startswith(
        "analyze: host2: its worker has another version of Percuss: install this one there"
    )
    for each in dask.two.find("dask_worker"):
        os.kill(each, signal.SIGTERM)
    dask.worker(dask.two)
    dask.wait_for_workers(2)
    finished(dask.batch(archive, output))
    assert rows(output) == expected
