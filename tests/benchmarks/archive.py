"""Cost and robustness of a run over an archive: `make bench-batch` (SESSIONS=200, twenty minutes).

Makes the archive (quick sessions and broken files of all kinds), then measures: whether every file has its
row; one worker compared with two, and a spin loop likewise; the harness's own time per file; a second run
over an archive of 1000 entries; kill -9 of the run and of a Dask worker; bytes read from a bucket; seconds
and memory from 1 to 100 strikes. `archive make FOLDER` only makes the archive.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from analyze.batch.archive import find_sources
from analyze.batch.ledger import Entry, Ledger
from analyze.batch.query import read_recording_rows
from analyze.batch.result_rows import STAMPS
from analyze.batch.settings import BatchSettings, analysis_version
from analyze.batch.worker_messages import Request
from analyze.batch.worker_process import Limits, WorkerProcess
from tests.benchmarks.archive_files import STRIKES, make_archive, make_session
from tests.broken_files import KINDS
from tests.fetched_bytes import fetched_without_images
from tests.quick_archive import body_of

SPIN, SPIN_TURNS, SPIN_S = 1_000_000, 10, 2.0
console = Console(highlight=False)


def batch(place: str, output: Path, *options: str) -> tuple[float, subprocess.CompletedProcess[str]]:
    """Run the command; its time [s] and the finished process with its output."""
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "analyze", "batch", place, "--out", str(output), *options],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in {0, 3}:
        raise click.ClickException(done.stderr.strip() or done.stdout.strip())
    return time.monotonic() - start, done


def numbers(output: Path, *without: str) -> list[dict[str, object]]:
    """Rows without the columns that may differ between two runs."""
    rows = read_recording_rows(output).drop_columns([*STAMPS, *without]).to_pylist()
    return sorted(rows, key=lambda row: (str(row["key"]), str(row["files"])))


def spin(until: float) -> int:
    """Turns of a loop that needs only a core, until the monotonic clock shows this time [s]."""
    turns = 0
    while time.monotonic() < until:
        for _ in range(SPIN):
            pass
        turns += 1
    return turns


def spin_gain() -> float:
    """Turns of a spin loop in two processes, over those in one.

    One and two alternate, since the speed of a shared machine's cores changes by a fifth within seconds.
    Turns are counted: in a fixed number of them the slower core alone would count.
    """
    one = two = 0
    with ProcessPoolExecutor(2) as pool:
        list(pool.map(spin, [time.monotonic() + SPIN_S] * 2))
        for _ in range(SPIN_TURNS):
            one += pool.submit(spin, time.monotonic() + SPIN_S).result()
            two += sum(pool.map(spin, [time.monotonic() + SPIN_S] * 2))
    return two / one


def accounted(archive: Path, output: Path) -> None:
    """Check that every file has its row with the expected outcome, and print the errors of c."""
    rows = {row["url"]: row for row in read_recording_rows(output).to_pylist()}
    sources = find_sources([str(archive)])
    wrong = [
        url
        for url, row in rows.items()
        if (row["failure"] or "")
        != (KINDS[Path(url).name.split("-")[1]] if Path(url).name.startswith("broken") else "")
    ]
    outcomes = Counter(row["failure"] or "ok" for row in rows.values())
    console.print(
        f"accounted for: {len(rows)} of {len(sources)}, {len(wrong)} wrongly: "
        + ", ".join(f"{k} {n}" for k, n in outcomes.most_common())
    )
    for url in wrong:
        console.print(f"  {url}: {rows[url]['failure']}: {rows[url]['reason']}", markup=False)
    errors = [
        1e3
        * np.linalg.norm(
            [row[f"com_{axis}_m"] for axis in "xyz"]
            - body_of(int(Path(row["url"]).parent.name.split("-")[1])).com
        )
        for row in rows.values()
        if row["status"] == "ok"
    ]
    console.print(
        f"centre of mass off by {np.median(errors):.3f} mm (median), {np.max(errors):.3f} mm (worst)"
    )


def workers(archive: Path, folder: Path, sessions: int) -> None:
    """Compare one worker with two on the same part of the archive, and with the gain of a spin loop."""
    places = [str(path) for path in sorted(archive.glob("object-*/*.mcap"))[:sessions]]
    part = folder / "part"
    part.mkdir()
    for number, place in enumerate(places):
        os.link(place, part / f"{number:03d}.mcap")
    gains: list[float] = []
    for turn in range(2):
        before = spin_gain()
        one, _ = batch(str(part), folder / f"one-{turn}", "--jobs", "1")
        two, _ = batch(str(part), folder / f"two-{turn}", "--jobs", "2")
        gains.append(one / two / ((before + spin_gain()) / 2))
        console.print(
            f"{len(places)} recordings: 1 worker {one:.1f} s, 2 workers {two:.1f} s; over a spin loop's gain "
            f"{gains[-1]:.2f}"
        )
    same = numbers(folder / "one-0") == numbers(folder / "two-0")
    console.print(
        f"1 -> 2 workers over a spin loop's gain: {max(gains):.2f} (must 0.9); results "
        f"{'the same' if same else 'DIFFER'}"
    )


def overhead(archive: Path, folder: Path) -> None:
    """Measure the time per file besides the analysis, with files that the worker refuses at once."""
    small = folder / "small"
    small.mkdir()
    for number in range(200):
        (small / f"{number:03d}.mcap").write_bytes(b"no recording, and not empty")
    start, _ = batch(str(small / "000.mcap"), folder / "out-1", "--jobs", "1")
    whole, _ = batch(str(small), folder / "out-200", "--jobs", "1")
    console.print(f"harness: {1e3 * (whole - start) / 199:.1f} ms per file (must 20)")


def second_run(folder: Path, entries: int = 1000) -> None:
    """Measure a run over `entries` unchanged recordings."""
    there, output = folder / "many", folder / "many-out"
    there.mkdir()
    for number in range(entries):
        (there / f"{number:04d}.mcap").write_bytes(b"x")
    for name in ("recordings", "failures"):
        (output / name).mkdir(parents=True)
    with Ledger(output, (1, 1), 1) as ledger:
        for source in find_sources([str(there)]):
            name = Path(source.url).name
            (output / "recordings" / f"{source.id}.parquet").write_bytes(b"")
            ledger.add(
                [
                    Entry(
                        source.url,
                        source.id,
                        BatchSettings().digest,
                        analysis_version(),
                        source.id,
                        "",
                        "",
                        [name],
                    )
                ]
            )
    times = [batch(str(there), output)[0] for _ in range(3)]
    _, done = batch(str(there), output)
    console.print(
        f"second run over {entries} entries: {min(times):.2f} s, worst of 3 {max(times):.2f} s (must 3): "
        f"{done.stdout.strip()}"
    )


@contextlib.contextmanager
def dask(workers: int, folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Run a scheduler and workers on loopback; yields the scheduler's address and the worker processes."""
    log = (folder / "dask.log").open("wb")
    python = [sys.executable, "-m"]
    address = f"tcp://127.0.0.1:{_free_port()}"
    quiet = {"stdout": log, "stderr": log}
    port = address.rsplit(":", 1)[1]
    scheduler = subprocess.Popen(
        [*python, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"],
        **quiet,
    )
    time.sleep(2)
    started = [
        subprocess.Popen(
            [
                *python,
                "distributed.cli.dask_worker",
                address,
                "--host",
                "127.0.0.1",
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
            ],
            **quiet,
        )
        for _ in range(workers)
    ]
    try:
        yield address, started
    finally:
        for process in (*started, scheduler):
            process.terminate()
        for process in (*started, scheduler):
            process.wait()
        log.close()


def kills(archive: Path, folder: Path, sessions: int) -> None:
    """Kill (-9) the run, and a Dask worker in mid-file; the next run, or another worker, must finish."""
    part, whole = str(folder / "part"), folder / "one-0"
    output = folder / "killed"
    process = subprocess.Popen(
        [sys.executable, "-m", "analyze", "batch", part, "--out", str(output)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while len(list(output.glob("recordings/*.parquet"))) < sessions // 3:
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = len(list(output.glob("recordings/*.parquet")))
    time.sleep(1)
    stray = subprocess.run(
        ["pgrep", "-f", f"analyze.batch.worker_main {output}"], capture_output=True, check=False
    ).stdout.split()
    batch(part, output)
    console.print(
        f"run killed with {done} of {sessions} done: {len(stray)} stray processes; finished by the next, "
        f"results {_same(output, whole)}"
    )
    output = folder / "cluster"
    with dask(2, folder) as (address, started):
        process = subprocess.Popen(
            [sys.executable, "-m", "analyze", "batch", part, "--out", str(output), "--scheduler", address],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        while len(list(output.glob("recordings/*.parquet"))) < sessions // 3 and process.poll() is None:
            time.sleep(0.05)
        started[0].kill()
        printed, errors = process.communicate()
    console.print(
        f"Dask, one of two workers killed: {printed.strip() or errors.strip()}; results "
        f"{_same(output, whole)}"
    )


def bucket(folder: Path) -> None:
    """Run the archive's part through an S3 server on loopback; print time and bytes of the small topics."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    os.environ |= {
        "AWS_ACCESS_KEY_ID": "loopback",
        "AWS_SECRET_ACCESS_KEY": "loopback",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
    }  # fmt: skip
    import s3fs

    system = s3fs.S3FileSystem(skip_instance_cache=True)
    system.mkdir("archive")
    system.put(str(folder / "part") + "/", "archive/part/", recursive=True)
    taken, _ = batch("s3://archive/part", folder / "bucket-out")
    same = numbers(folder / "bucket-out", "url", "source_id") == numbers(folder / "one-0", "url", "source_id")
    console.print(f"S3: {taken:.1f} s, results {'the same' if same else 'DIFFER'}")
    largest = max((folder / "part").iterdir(), key=lambda path: path.stat().st_size)
    small_topics(f"s3://archive/part/{largest.name}", largest.stat().st_size, folder)
    server.stop()


def small_topics(url: str, size: int, folder: Path) -> None:
    """Print the bytes read where only the small topics are needed."""
    began = time.monotonic()
    copy, fetched = fetched_without_images(url, folder)
    copy.unlink()
    part = f"{fetched / 1e6:.2f} of {size / 1e6:.1f} MB read ({100 * fetched / size:.2g} %)"
    cost = f"{part}, {time.monotonic() - began:.2f} s"
    console.print(f"{url.split(':', 1)[0]}: small topics of one recording: {cost}")


def growth(folder: Path) -> None:
    """Measure seconds and memory of one recording with 1 to 100 strikes."""
    for strikes in STRIKES:
        path = folder / f"strikes-{strikes}.mcap"
        make_session((path, 5000 + strikes, strikes))
        output = folder / f"growth-{strikes}"
        (output / "recordings").mkdir(parents=True)
        (output / "failures").mkdir()
        with WorkerProcess(output, Limits()) as worker:
            worker.analyse(Request(find_sources([str(path)])[0], BatchSettings(), str(output)))
        with contextlib.suppress(IndexError):
            row = _rows(output)[0]
            size, peak = path.stat().st_size / 1e6, row["peak_memory_bytes"] / 1e6
            console.print(
                f"{strikes} strikes, {size:.0f} MB: {row['seconds']:.2f} s, {peak:.0f} MB of its own at most "
                f"({row['failure'] or 'ok'})"
            )
        path.unlink()


def _rows(output: Path) -> Sequence[dict[str, float]]:
    from analyze.batch.result_rows import read_rows

    return read_rows(sorted(output.glob("*/*.parquet"))).to_pylist()


def _same(output: Path, other: Path) -> str:
    return "the same" if numbers(output) == numbers(other) else "DIFFER"


def _free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@click.group()
def main() -> None:
    """Make an archive, or measure a run over one."""


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--sessions", default=200, show_default=True)
@click.option("--broken", default=20, show_default=True)
def make(folder: Path, sessions: int, broken: int) -> None:
    """Make an archive; existing files are kept."""
    make_archive(folder, sessions, broken)


@main.command()
@click.option("--sessions", default=200, show_default=True)
@click.option("--broken", default=20, show_default=True)
@click.option("--archive", "given", type=click.Path(path_type=Path), help="Archive made before by `make`.")
@click.option(
    "--recording",
    type=click.Path(exists=True, path_type=Path),
    help="Large recording whose small topics are read by byte ranges.",
)
def measure(sessions: int, broken: int, given: Path | None, recording: Path | None) -> None:
    """Make an archive of `sessions` good and `broken` unreadable recordings, measure batch runs, print them.

    `given` is the folder of an archive made before, `recording` a large one to read in part; None to leave
    out.
    """
    with tempfile.TemporaryDirectory(prefix="percuss-archive-") as name:
        folder = Path(name)
        archive = given or folder / "archive"
        make_archive(archive, sessions, broken)
        taken, done = batch(str(archive), folder / "out")
        console.print(
            f"{sessions} + {broken}: {taken:.0f} s: {done.stdout.strip().splitlines()[0].rsplit(':', 1)[0]}"
        )
        accounted(archive, folder / "out")
        overhead(archive, folder)
        second_run(folder)
        workers(archive, folder, 24)
        kills(archive, folder, 24)
        bucket(folder)
        if recording is not None:
            # A gigabyte is too much for the S3 server, which reads the whole file for every range.
            small_topics(f"file://{recording.resolve()}", recording.stat().st_size, folder)
        growth(folder)
        shutil.rmtree(folder / "part", ignore_errors=True)


if __name__ == "__main__":
    main()
