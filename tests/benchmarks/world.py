"""Plans for objects of the world: `make bench-world`.

Each shape of `tests/world` is written as a clean CAD mesh, as a scan and as convex pieces, as users have
them: six tags without places, no rig file. `analyze plan` plans each in a process of its own, whose time and
peak memory are measured. Where it refuses, the reasons and the first remedy are taken from its message, and
`analyze fixture` is asked for a fixture with which a plan exists. The rows are written as a CSV file that is
brought up to date: shapes that are not planned anew keep their rows.
"""

from __future__ import annotations

import csv
import os
import re
import resource
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from rich.console import Console
from rich.progress import track
from rich.table import Table

from analyze.planning.rejections import _REASONS
from tests.places import ROOT
from tests.world.catalogue import make, names
from tests.world.object_files import KINDS, Kind, write_object

TABLE = ROOT / "docs" / "reference" / "world.csv"
MAX_SECONDS = 300.0
"""CPU time after which planning an object is ended"""
_MESSAGES = {
    "unstable_plane": r"may fall over on each|on none is it sure to stay",
    "open_mesh": r"open edges|not a closed body|holes? (is|are)",
    "self_crossing": r"intersects itself|self-intersect|crosses itself",
    "round": r"\bball\b|only rolls|is round about",
    "density": r"density|kg/m|heavier than|lighter than",
}
"""codes of refusals whose message counts no rejected axes, by a pattern of the message"""


@dataclass(frozen=True)
class Row:
    """Result of planning one shape from one kind of file: a row of the table."""

    shape: str
    category: str
    household: bool
    kind: str
    faces: int
    longest_mm: float
    mass_g: float
    outcome: str
    """planned, refused, or failed (a traceback, or no end in time)"""
    strikes: int
    com_mm: float
    """predicted rms error of the centre of mass [mm]; 0 without a plan"""
    code: str
    """most frequent reason of a refusal"""
    codes: str
    """all reasons with their counts"""
    remedy: str
    """remedy in the message"""
    fixture: str
    """planned or refused with the fixture of `analyze fixture`; empty if none was asked for"""
    seconds: float
    """wall time of `analyze plan`"""
    cpu_s: float
    peak_mb: float


@dataclass(frozen=True)
class Run:
    """Ended run of a command: exit code, output, wall and CPU time [s], peak memory [MB]."""

    code: int
    output: str
    seconds: float
    cpu_s: float
    peak_mb: float


def run_analyze(*arguments: str) -> Run:
    """Run `analyze` in a process of its own; negative exit code if its CPU time exceeds `MAX_SECONDS`."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "COLUMNS": "2000"}
    begin = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "analyze", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        env=environment,
    )
    limit = int(MAX_SECONDS)
    resource.prlimit(process.pid, resource.RLIMIT_CPU, (limit, limit))  # `wait4` below has no time limit
    assert process.stdout is not None
    output = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    process.returncode = code
    cpu = used.ru_utime + used.ru_stime
    return Run(code, output, time.perf_counter() - begin, cpu, used.ru_maxrss / 1024)


def reasons(message: str) -> Counter[str]:
    """Codes of a refusal with the number of axes each; 0 axes for codes that the message does not count."""
    found = Counter[str]()
    for code, (words, *_) in _REASONS.items():
        for many in re.findall(rf"(\d+) {re.escape(words)}", message):
            found[code] += int(many)
    if not found:
        for code, pattern in _MESSAGES.items():
            if re.search(pattern, message):
                found[code] = 0
                break
    return found


def remedy(message: str) -> str:
    """Remedy in the message of a refusal: the text after the last colon of its line; "" if there is none."""
    lines = [line for line in message.splitlines() if line.startswith("analyze: ")]
    return lines[0].rsplit(": ", 1)[-1].strip() if lines else ""


def plan_shape(name: str, kind: Kind, seed: int, work: Path, with_fixture: bool) -> Row:
    """Write a shape's files, plan it, and plan it with a fixture where that is refused; return the row."""
    shape = make(name, seed)
    folder = work / f"{name}-{kind}"
    folder.mkdir(parents=True, exist_ok=True)
    path = write_object(shape, kind, folder)
    run = run_analyze("plan", str(path), "-o", str(folder / "plan.json"), "--no-cards")
    refusal = "" if run.code == 0 else run.output.strip()
    traced = "Traceback" in run.output or run.code not in {0, 1}
    found = reasons(refusal)
    strikes, com = _planned(folder / "plan.json") if run.code == 0 else (0, 0.0)
    row = Row(
        shape=name,
        category=shape.category,
        household=shape.is_household,
        kind=kind,
        faces=_face_count(path),
        longest_mm=round(float(shape.size_mm.max()), 1),
        mass_g=round(1000 * shape.mass_kg, 1),
        outcome="failed" if traced else "refused" if refusal else "planned",
        strikes=strikes,
        com_mm=round(com, 2),
        code=found.most_common(1)[0][0] if found else "other" if refusal else "",
        codes=" ".join(f"{code}:{many}" for code, many in found.most_common()),
        remedy=remedy(refusal),
        fixture="",
        seconds=round(run.seconds, 1),
        cpu_s=round(run.cpu_s, 1),
        peak_mb=round(run.peak_mb),
    )
    (folder / "out.txt").write_text(run.output, encoding="utf-8")
    return replace(row, fixture=_with_fixture(path, folder)) if refusal and with_fixture else row


def _with_fixture(path: Path, folder: Path) -> str:
    """Result of `analyze plan` with the fixture that `analyze fixture` designs: "planned" or "refused"."""
    target = folder / "in-fixture.toml"
    run = run_analyze("fixture", str(path), "-o", str(target), "--force")
    (folder / "fixture.txt").write_text(run.output, encoding="utf-8")
    if run.code not in {0, 3} or not target.exists():
        return "refused"
    again = run_analyze("plan", str(target), "-o", str(folder / "fixture-plan.json"), "--no-cards")
    (folder / "fixture-out.txt").write_text(again.output, encoding="utf-8")
    return "planned" if again.code == 0 else "refused"


def _planned(path: Path) -> tuple[int, float]:
    """Number of strikes of a plan, and its predicted rms error of the centre of mass [mm]."""
    from schemas.strike_plan import StrikePlan

    plan = StrikePlan.model_validate_json(path.read_text(encoding="utf-8"))
    return len(plan.strikes), 1000 * plan.prediction.com_rms_m


def _face_count(path: Path) -> int:
    import trimesh

    name = tomllib.loads(path.read_text(encoding="utf-8"))["shape"]["file"]
    return len(trimesh.load(path.parent / name, force="mesh").faces)


def write_rows(rows: Iterable[Row], path: Path) -> list[Row]:
    """Write rows into the table in place of older ones of the same shape and kind; returns all of them."""
    kept = {(row.shape, row.kind): row for row in read_rows(path)}
    kept |= {(row.shape, row.kind): row for row in rows}
    ordered = [kept[key] for key in sorted(kept)]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows({**asdict(row), "household": int(row.household)} for row in ordered)
    return ordered


def read_rows(path: Path) -> list[Row]:
    """Rows of the table; none if there is no file."""
    if not path.exists():
        return []
    casts = {"int": int, "float": float, "str": str, "bool": lambda text: text == "1"}
    with path.open(encoding="utf-8", newline="") as file:
        return [
            Row(**{field.name: casts[str(field.type)](each[field.name]) for field in fields(Row)})
            for each in csv.DictReader(file)
        ]


def summary(rows: Sequence[Row]) -> Table:
    """Shares planned without and with a fixture, time and memory, by group and kind of file."""
    table = Table(title="planned", box=None)
    for heading in ("group", "kind", "shapes", "planned", "with fixture", "CPU s", "worst", "MB", "worst"):
        table.add_column(heading, justify="left" if heading in {"group", "kind"} else "right")
    groups = {"household": [row for row in rows if row.household]}
    groups |= {"tools": [row for row in rows if row.category == "tool"], "all": list(rows)}
    for group, members in groups.items():
        for kind in KINDS:
            some = [row for row in members if row.kind == kind]
            if not some:
                continue
            planned = sum(row.outcome == "planned" for row in some)
            held = planned + sum(row.fixture == "planned" for row in some)
            asked = any(row.fixture for row in some)
            cpu, peak = sorted(row.cpu_s for row in some), sorted(row.peak_mb for row in some)
            middle = len(some) // 2
            table.add_row(
                group,
                kind,
                str(len(some)),
                f"{planned} ({planned / len(some):.0%})",
                f"{held} ({held / len(some):.0%})" if asked else "",
                f"{cpu[middle]:.1f}",
                f"{cpu[-1]:.1f}",
                f"{peak[middle]:.0f}",
                f"{peak[-1]:.0f}",
            )
    return table


@click.command()
@click.option("--shapes", default="", help="Comma-separated names; all if left out.")
@click.option("--every", default=1, show_default=True, help="Every how many of them.")
@click.option("--kinds", default=",".join(KINDS), show_default=True)
@click.option("--seed", default=1, show_default=True, help="Seed of dimensions, masses and frames.")
@click.option("--workers", default=os.cpu_count() or 1, show_default=True)
@click.option(
    "--fixture/--no-fixture", default=False, help="Ask `analyze fixture` where planning is refused."
)
@click.option("--work", type=click.Path(path_type=Path), help="Keep files and messages in this folder.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=TABLE, show_default=True)
def main(
    shapes: str,
    every: int,
    kinds: str,
    seed: int,
    workers: int,
    fixture: bool,
    work: Path | None,
    output: Path,
) -> None:
    """Plan shapes of the world in all kinds of files, and print the shares and the reasons of refusals."""
    console = Console(width=150)
    with_fixture = fixture and run_analyze("fixture", "--help").code == 0
    chosen = [each for each in names() if not shapes or each in shapes.split(",")][::every]
    jobs = [(name, kind) for name in chosen for kind in KINDS if kind in kinds.split(",")]
    with TemporaryDirectory() as scratch, ThreadPoolExecutor(workers) as pool:
        folder = work or Path(scratch)
        futures = [pool.submit(plan_shape, *job, seed, folder, with_fixture) for job in jobs]
        rows = [each.result() for each in track(futures, console=Console(stderr=True), transient=True)]
    everything = write_rows(rows, output)
    console.print(summary(everything))
    refused = Counter((row.kind, row.code) for row in everything if row.outcome != "planned")
    console.print("refusals by kind and most frequent reason:", highlight=False)
    for (kind, code), many in refused.most_common():
        some = [row.shape for row in everything if (row.kind, row.code) == (kind, code)][:6]
        console.print(f"  {many:4d} {kind:7s} {code:18s} {', '.join(some)}", highlight=False)


if __name__ == "__main__":
    main()
