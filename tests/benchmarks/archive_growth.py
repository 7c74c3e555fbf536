"""An archive of 100 000 recordings: `make bench-archive-growth` (GROWTH="--rows 100000", half an hour).

Makes an archive of hard links to a few quick sessions, a row of results for each (the answer of a real
analysis with drawn numbers), and their ledger; then measures the time and largest memory of each command as a
whole process, beside `find -printf` and DuckDB alone on the same files. What a recording and its rows cost on
disk is printed as well: the model of 10^6 recordings (`growth_model.py`) starts from these.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rich.console import Console
from rich.table import Table

from analyze.batch.archive import Source, find_sources
from analyze.batch.ledger import Entry, Ledger
from analyze.batch.result_rows import SCHEMA, write_row, write_rows
from analyze.batch.settings import BatchSettings, analysis_version
from analyze.batch.stored_results import GATHERED, MAX_PART_ROWS
from analyze.batch.worker_messages import FAILURES, ROWS
from tests.benchmarks.growth_model import markdown
from tests.quick_archive import body_of, quick_session

OBJECTS = 50
SESSIONS = 4
"""recordings that are written; the others are hard links to them"""
MAX_LINKS = 60_000
"""hard links to one file; ext4 allows 65 000"""
PER_FOLDER = 1000
FAILING_SHARE = 0.01
SEED = 31
console = Console(highlight=False)


def make_archive(folder: Path, rows: int) -> Path:
    """Hard links to quick sessions, a thousand in a folder; the path of one of the sessions."""
    files = [folder / f"first-{number}.mcap" for number in range(max(SESSIONS, rows // MAX_LINKS + 1))]
    for number, path in enumerate(files):
        quick_session(path, body_of(number), number, 3, packed=True)
    for number in range(len(files), rows):
        place = folder / f"{number // PER_FOLDER:04d}"
        place.mkdir(exist_ok=True)
        (place / f"{number:07d}.mcap").hardlink_to(files[number % len(files)])
    return files[0]


def answer_row(session: Path, folder: Path) -> dict[str, object]:
    """Row of the results of a real analysis."""
    run("batch", session, "--out", folder)
    (path,) = (folder / ROWS).iterdir()
    return pq.read_table(path, schema=SCHEMA).to_pylist()[0]


def drawn_rows(pattern: dict[str, object], sources: Sequence[Source]) -> Iterator[dict[str, object]]:
    """A row for each recording: the pattern's answer with drawn numbers, of one of fifty objects."""
    rng = np.random.default_rng(SEED)
    text = str(pattern["result_json"])
    for number, source in enumerate(sources):
        kind = int(rng.integers(OBJECTS))
        com = 0.02 + 1e-3 * kind + rng.normal(0, 1e-4, 3)
        day = np.datetime64("2016-01-01T08:00:00") + np.timedelta64(int(rng.integers(3650 * 1440)), "m")
        yield pattern | {
            "url": source.url,
            "source_id": source.id,
            "key": f"{number:032x}",
            "content_id": f"{number:064x}",
            "recording_id": f"drawn-{number}",
            "created": f"{day}+00:00",
            "object": f"object {kind}",
            "object_sha256": f"{kind:064x}",
            **{f"com_{axis}_m": value for axis, value in zip("xyz", com, strict=True)},
            **{f"com_sd_{axis}_m": 1e-4 for axis in "xyz"},
            # Digits of its own, so that texts do not compress as one.
            "result_json": text + json.dumps(rng.normal(size=60).tolist()),
        }


def make_results(output: Path, pattern: dict[str, object], sources: Sequence[Source]) -> None:
    """Gathered rows, and a ledger with one failure in a hundred."""
    for name in (GATHERED, ROWS, FAILURES):
        (output / name).mkdir(parents=True)
    settings, version = BatchSettings().digest, analysis_version()
    waiting: list[dict[str, object]] = []
    single: Path | None = None
    failing = int(1 / FAILING_SHARE)
    with Ledger(output, (1, 1), 1) as ledger:
        for number, row in enumerate(drawn_rows(pattern, sources)):
            url, source, key = (str(row[name]) for name in ("url", "source_id", "key"))
            if number % failing == 0:
                reason = f"{url}: ends early"
                ledger.add([Entry(url, source, settings, version, "", "cut", reason, [])])
                failed = {"url": url, "source_id": source, "status": "failed", "failure": "cut"}
                write_row(failed | {"reason": reason}, output / FAILURES / f"{source}.parquet")
                continue
            waiting.append(row)
            # The rows' own files are looked up by name only: the gathered ones are read.
            path = output / ROWS / f"{key}.parquet"
            if number % MAX_LINKS == 1 or single is None:
                write_row(row, path)
                single = path
            else:
                path.hardlink_to(single)
            ledger.add([Entry(url, source, settings, version, key, "", "", [url.rsplit("/", 1)[-1]])])
            if len(waiting) == MAX_PART_ROWS or number == len(sources) - 1:
                part = output / GATHERED / f"{number:07d}.parquet"
                write_rows(pa.Table.from_pylist(waiting, schema=SCHEMA), part)
                waiting.clear()


def run(*arguments: object) -> tuple[float, float, int]:
    """Run `analyze` as a process; its time [s], largest memory [MB] and lines of output."""
    return measured([sys.executable, "-m", "analyze", *map(str, arguments)])


def measured(command: Sequence[str]) -> tuple[float, float, int]:
    """Run a command; its time [s], largest memory with its children [MB], and lines of output.

    A small process starts it: a child inherits the largest memory of the process that it was split from.
    """
    with tempfile.TemporaryFile() as printed, tempfile.NamedTemporaryFile() as noted:
        start = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-S", "-c", _STARTER, noted.name, *command], stdout=printed, check=False
        )
        seconds = time.monotonic() - start
        printed.seek(0)
        lines = sum(1 for _ in printed)
        memory = int(Path(noted.name).read_text())
    if done.returncode not in {0, 3}:
        raise click.ClickException(f"{' '.join(command)}: exit code {done.returncode}")
    return seconds, memory / 1024, lines


_STARTER = """
import os, resource, sys
code = os.spawnv(os.P_WAIT, sys.argv[2], sys.argv[2:]) if sys.argv[2][0] == "/" else os.spawnvp(
    os.P_WAIT, sys.argv[2], sys.argv[2:])
open(sys.argv[1], "w").write(str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))
sys.exit(code)
"""


def commands(archive: Path, output: Path) -> Iterator[tuple[str, list[str]]]:
    """Name and command of each thing that is measured."""
    analyze = [sys.executable, "-m", "analyze"]
    out = ["--out", str(output)]
    parts = f"'{output}/{GATHERED}/*.parquet'"
    mean = "select object, count(*), avg(com_z_m) from {} group by object order by object"
    alone = f"import duckdb; print(duckdb.sql({mean.format(parts)!r}).fetchall())"
    yield "find -printf (peer)", ["find", str(archive), "-name", "*.mcap", "-printf", "%p %s %T@\\n"]
    yield "archive index, all new", [*analyze, "archive", "index", str(archive), *out]
    yield "archive index, all known", [*analyze, "archive", "index", str(archive), *out]
    yield "archive list --json", [*analyze, "archive", "list", "--json", *out]
    yield "archive list --object", [*analyze, "archive", "list", "--object", "quick box 70*", *out]
    yield "archive list --com-z, 1 mm", [*analyze, "archive", "list", "--com-z", "40..41", *out]
    yield "archive duplicates", [*analyze, "archive", "duplicates", *out]
    yield "archive superseded", [*analyze, "archive", "superseded", *out]
    yield "DuckDB on the files alone (peer)", [sys.executable, "-c", alone]
    yield "query: mean per object", [*analyze, "query", mean.format("recordings"), *out]
    yield (
        "query: strikes by verdict",
        [
            *analyze,
            "query",
            "select verdict, count(*) from strikes group by verdict",
            *out,
        ],
    )
    yield "batch --summary", [*analyze, "batch", "--summary", *out]
    yield "batch --summary --save .html", [*analyze, "batch", "--summary", "--save", f"{output}/s.html", *out]
    yield "batch --dry-run, all known", [*analyze, "batch", str(archive), "--dry-run", *out]


def sizes(output: Path, rows: int) -> dict[str, float]:
    """Bytes per recording of each part of the results."""
    found = {
        name: sum(path.stat().st_size for path in (output / name).iterdir()) for name in (GATHERED, "ledger")
    }
    found["catalogue.parquet"] = (output / "catalogue.parquet").stat().st_size
    return {name: size / rows for name, size in found.items()}


@click.group()
def main() -> None:
    """Make and measure a large archive."""


@main.command()
@click.argument("place", type=click.Path(path_type=Path))
@click.argument("rows", type=int)
def make(place: Path, rows: int) -> None:
    """Make the archive and its results; a process of its own, since a child counts its parent's memory."""
    (place / "archive").mkdir(parents=True)
    session = make_archive(place / "archive", rows)
    pattern = answer_row(session, place / "pattern")
    single = next((place / "pattern" / ROWS).iterdir()).stat().st_size
    console.print(f"row in a file of its own: {single / 1e3:.1f} kB")
    make_results(place / "results", pattern, find_sources([str(place / "archive")]))


@main.command("measure")
@click.option("--rows", default=100_000, show_default=True)
@click.option(
    "--folder", type=click.Path(path_type=Path), help="Where to make it; default: a temporary folder."
)
def measure(rows: int, folder: Path | None) -> None:
    """Measure every command on an archive of that many recordings."""
    with tempfile.TemporaryDirectory() as temporary:
        place = folder or Path(temporary)
        archive, output = place / "archive", place / "results"
        if not archive.exists():
            program = [sys.executable, "-m", "tests.benchmarks.archive_growth", "make", str(place), str(rows)]
            subprocess.run(program, check=True)
        table = Table(title=f"{rows} recordings", title_justify="left")
        for name in ("", "s", "MB", "lines"):
            table.add_column(name, justify="left" if not name else "right")
        for name, command in commands(archive, output):
            seconds, memory, lines = measured(command)
            console.print(f"{name}: {seconds:.1f} s, {memory:.0f} MB")
            table.add_row(name, f"{seconds:.1f}", f"{memory:.0f}", str(lines))
        console.print(table)
        for name, size in sizes(output, rows).items():
            console.print(f"{name}: {size:.0f} bytes a recording")


@main.command()
@click.option("--rows", default=1_000_000, show_default=True)
@click.option("--cores", default=100, show_default=True)
def model(rows: int, cores: int) -> None:
    """Print the table of a million recordings, in Markdown."""
    click.echo(markdown(rows, cores))


if __name__ == "__main__":
    main()
