"""Archives in a bucket, and runs on a Dask cluster, with servers on loopback: results as on one machine."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from dataclasses import asdict

import pytest

from analyze.batch import cluster
from analyze.batch.analysis import analyse
from analyze.batch.archive import Source, SourceFile, find_sources
from analyze.batch.query import read_recording_rows
from analyze.batch.result_rows import STAMPS
from analyze.batch.run import BatchOptions, plan_work, run_batch
from analyze.batch.settings import BatchSettings, analysis_version
from analyze.batch.sparse_copy import sparse_copies
from analyze.batch.worker_messages import Outcome, Request
from analyze.batch.worker_process import Limits
from analyze.errors import ArchiveError
from analyze.reading.recording import open_recording
from tests.broken_files import break_file
from tests.bucket import bucket_of
from tests.fetched_bytes import fetched_without_images
from tests.quick_archive import body_of, quick_session

KINDS = ("empty", "text", "cut")
OF_PLACE = ("url", "source_id", "size_bytes")


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Archive with fewer recordings than that of the other tests."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "a").mkdir()
    whole = quick_session(folder / "a" / "session-0.mcap", body_of(0), 0, 3).path
    for kind in KINDS:
        break_file(whole, folder, kind)
    return folder


@pytest.fixture(scope="module")
def finished(archive, tmp_path_factory):
    output = tmp_path_factory.mktemp("results") / "out"
    return output, run(str(archive), output)


@pytest.fixture(scope="module")
def bucket(archive):
    """The archive behind an S3 server on loopback, as s3://archive."""
    with bucket_of(archive) as place:
        yield place


def numbers(output):
    return sorted(
        read_recording_rows(output).drop_columns([*STAMPS, *OF_PLACE, "reason"]).to_pylist(),
        key=lambda row: (row["key"] or "", row["files"] or []),
    )


def failures(report):
    return {outcome.url.rsplit("/", 1)[-1]: outcome.failure for outcome in report.outcomes}


def run(place, output, **options):
    output.mkdir()
    chosen = BatchOptions(jobs=2, **options)
    work = plan_work(find_sources([place]), output, BatchSettings(), chosen)
    return run_batch(work, output, BatchSettings(), chosen)


@pytest.mark.slow
def test_a_bucket_gives_the_same_results(bucket, finished, tmp_path):
    report = run(bucket, tmp_path / "out")
    assert failures(report) == failures(finished[1])
    assert numbers(tmp_path / "out") == numbers(finished[0])
    assert not list((tmp_path / "out" / "unfinished").iterdir())


def test_small_topics_cost_few_bytes(bucket, archive, tmp_path, monkeypatch):
    # Of a file as small as this one, to skip an image costs more than to read it.
    monkeypatch.setattr("analyze.batch.sparse_copy.MAX_GAP_BYTES", 0)
    monkeypatch.setattr("analyze.batch.sparse_copy.FIRST_REQUEST_BYTES", 4096)
    copy, fetched = fetched_without_images(f"{bucket}/a/session-0.mcap", tmp_path)
    whole = archive / "a" / "session-0.mcap"
    assert fetched < 0.05 * whole.stat().st_size
    assert copy.stat().st_blocks * 512 < 0.2 * whole.stat().st_size
    with open_recording(copy) as here, open_recording(whole) as there:
        assert here.content_id == there.content_id
        assert list(here.frame_meta()) == list(there.frame_meta())


def test_verification_fetches_the_whole_recording(bucket, archive, tmp_path):
    """A verification also fetches images outside the strikes' windows, which an analysis does not."""
    with sparse_copies(find_sources([f"{bucket}/a"])[0], tmp_path, whole=True) as path:
        assert path.read_bytes() == (archive / "a" / "session-0.mcap").read_bytes()


def test_missing_bucket_is_one_line(bucket):
    with pytest.raises(ArchiveError, match="s3://nowhere") as caught:
        find_sources(["s3://nowhere/x"])
    assert "\n" not in str(caught.value)


def test_unknown_protocol_is_one_line():
    with pytest.raises(ArchiveError, match="nosuch"):
        find_sources(["nosuch://a/b"])


class Deaf:
    """File system of a bucket whose network is down, which raises its own kind of error."""

    protocol = "s3"

    def __getattr__(self, name):
        raise RuntimeError("could not connect\nto the endpoint")


def test_network_failure_is_not_reported_as_a_defect(tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.batch.archive.url_to_fs", lambda place: (Deaf(), place))
    with pytest.raises(ArchiveError, match="s3://a/b: cannot be listed: could not connect to the endpoint"):
        find_sources(["s3://a/b"])
    monkeypatch.setattr("analyze.batch.sparse_copy.url_to_fs", lambda place: (Deaf(), place))
    (tmp_path / "failures").mkdir()
    request = Request(Source((SourceFile("s3://a/b.mcap", 100, "etag"),)), BatchSettings(), str(tmp_path))
    outcome = analyse(request, tmp_path)
    assert outcome.failure == "unreachable", outcome.reason
    assert (
        outcome.reason
        == "s3://a/b.mcap: cannot be fetched: could not connect to the endpoint: try again with --only-failed"
    )


@pytest.mark.slow
def test_a_cluster_gives_the_same_results(archive, finished, tmp_path):
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        host="127.0.0.1",
        dashboard_address=None,
        protocol="tcp://",
        silence_logs=50,
    ) as cluster:
        report = run(str(archive), tmp_path / "out", scheduler=cluster.scheduler_address)
    assert failures(report) == failures(finished[1])
    assert numbers(tmp_path / "out") == numbers(finished[0])


@pytest.mark.slow
def test_scheduler_with_certificates_lets_in_who_has_one(archive, tmp_path):
    """As in docs/examples/cluster/slurm_dask.py: the client takes its certificate from the environment."""
    from distributed import LocalCluster
    from distributed.security import Security

    keys = Security.temporary()
    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        host="127.0.0.1",
        dashboard_address=None,
        protocol="tls://",
        security=keys,
        silence_logs=50,
    ) as cluster:
        recording, output = str(archive / "broken-empty-0.mcap"), str(tmp_path / "out")
        command = [sys.executable, "-m", "analyze", "batch", recording, "--out", output]
        command += ["--scheduler", cluster.scheduler_address]
        refused = subprocess.run(command, capture_output=True, text=True, check=False)
        own = {
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE": keys.tls_ca_file,
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT": keys.tls_client_cert,
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY": keys.tls_client_key,
        }
        done = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    (line,) = refused.stderr.splitlines()
    assert line.startswith(f"analyze: {command[-1]}: lets in only who has a certificate: set ")
    assert all(name in line for name in own), "which is the remedy"
    assert done.returncode == 3, done.stderr
    assert "empty" in done.stderr


def test_missing_scheduler_is_one_line(archive, tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.batch.cluster._CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(ArchiveError, match="no Dask scheduler"):
        run(str(archive), tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize("status", ["finished", "lost", "cancelled"])
def test_result_that_cannot_be_fetched_is_no_failure_of_the_recording(tmp_path, status):
    """A scheduler that ended while a result was fetched once gave a row with failure `died`."""

    class Unfetched:
        def __init__(self):
            self.status = status

        def result(self):
            raise OSError("Stream is closed")

    request = Request(Source((SourceFile("/x.mcap", 1, ""),)), BatchSettings(), str(tmp_path))
    with pytest.raises(ArchiveError, match="tcp://head:8786: lost: start the scheduler again"):
        cluster._outcome(Unfetched(), request, "tcp://head:8786", Limits())
    assert not list(tmp_path.iterdir())


def test_dask_worker_uses_folder_and_limits_of_the_present_run(tmp_path, monkeypatch):
    closed = []

    class FakeWorker:
        def __init__(self, output, limits):
            self.scratch, self.limits = output / "own", limits
            self.scratch.mkdir(exist_ok=True)

        def analyse(self, request):
            return Outcome(request.source.url, "", seconds=self.limits.seconds, reason=str(self.scratch))

        def close(self):
            closed.append(self.scratch)

    monkeypatch.setattr(cluster, "WorkerProcess", FakeWorker)
    monkeypatch.setattr(cluster, "_this_thread", threading.local())
    one, two = (
        asdict(Request(Source((SourceFile("/x.mcap", 1, ""),)), BatchSettings(), str(tmp_path / name)))
        for name in ("one", "two")
    )
    here, run = analysis_version(), "0a1b2c3d"
    for name in ("one", "two"):
        (tmp_path / name / "unfinished" / f"run-{run}").mkdir(parents=True)
    assert cluster._analyse_on_worker(one, (1.0, 0), here, run)["reason"] == str(tmp_path / "one" / "own")
    assert cluster._analyse_on_worker(two, (1.0, 0), here, run)["reason"] == str(tmp_path / "two" / "own"), (
        "another folder"
    )
    assert cluster._analyse_on_worker(two, (2.0, 0), here, run)["seconds"] == 2.0, "other limits"
    (tmp_path / "two" / "own").rmdir()
    cluster._analyse_on_worker(two, (2.0, 0), here, run)
    assert closed == [tmp_path / name / "own" for name in ("one", "two", "two")]
    with pytest.raises(ArchiveError, match="does not see the results in"):
        cluster._analyse_on_worker(two, (2.0, 0), here, "of another machine")
    with pytest.raises(ArchiveError, match="another version of Percuss"):
        cluster._analyse_on_worker(one, (1.0, 0), "older", run)
