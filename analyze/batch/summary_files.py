"""A summary printed, or written as HTML, CSV or Parquet."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from io import BytesIO
from itertools import groupby
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from analyze.batch.answer import plain_console
from analyze.batch.summary import Repeated, Summary
from analyze.errors import ArchiveError
from analyze.output_file import write_bytes, write_text
from analyze.report.page import page_environment

SUFFIXES = (".html", ".csv", ".parquet")
_TYPES = {"str": pa.string(), "int": pa.int64(), "float": pa.float64()}
_REPEATED = [(each.name, _TYPES[str(each.type)]) for each in fields(Repeated)]
_OBJECTS = [
    ("object", pa.string()),
    ("object_sha256", pa.string()),
    *((name, pa.int64()) for name in ("sessions", "strikes", "used", "stated_times")),
]
_FAILURES = [("failure", pa.string()), ("recordings", pa.int64()), ("example", pa.string())]


SHOWN = 20
"""lines on a terminal of what stands out; all of them are in the files"""


def render_summary(found: Summary) -> None:
    """Print it."""
    console = plain_console()
    if found.standing_out:
        _stands_out(console, found)
    objects = Table(title="Objects", title_justify="left")
    for heading in ("object", "", "sessions", "strikes", "used", "stated times"):
        objects.add_column(heading, justify="left" if heading in {"object", ""} else "right")
    for name, sha256, sessions, strikes, used, stated in found.objects:
        objects.add_row(name, sha256[:8], str(sessions), str(strikes), str(used), str(stated or ""))
    console.print(objects)
    for name, sha256, sessions, _, _, stated in found.objects:
        if 0 < stated < sessions:
            console.print(f"{name} ({sha256[:8]}): in {stated} of {sessions} sessions no clock of a rig gave the frame times (time_source)")
    if found.repeated:
        console.print("\nFrom session to session (n of them; scatter and stated: 1 sd)")
    for (name, sha256), rows in groupby(found.repeated, key=lambda each: (each.object, each.object_sha256)):
        repeated = Table(title=f"{name} ({sha256[:8]})", title_justify="left", box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
        for heading in ("quantity", "n", "mean", "scatter", "stated", "chi²/dof", "drift/day"):
            repeated.add_column(heading, justify="left" if heading == "quantity" else "right", no_wrap=True)
        for each in rows:
            *others, drift = cells(each)
            repeated.add_row(each.quantity, str(each.sessions), *others, drift.removesuffix(f" {each.unit}"))
        console.print(repeated)
        console.print()
    failures(console, found)


def _stands_out(console: Console, found: Summary) -> None:
    table = Table(title="What stands out", title_justify="left", box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0), width=78)
    for heading in ("object", "quantity", ""):
        table.add_column(heading, overflow="fold")
    for each in found.standing_out[:SHOWN]:
        table.add_row(f"{each.object} ({each.object_sha256[:8]})", each.quantity, told_apart(each))
    console.print(table)
    if len(found.standing_out) > SHOWN:
        console.print(f"... and {len(found.standing_out) - SHOWN} more: --save summary.html shows all")
    console.print()


def failures(console: Console, found: Summary) -> None:
    """Print what gave nothing."""
    if not found.failures:
        console.print(f"{found.recordings} recordings, none failed")
        return
    table = Table(title="No result", title_justify="left")
    table.add_column("why")
    table.add_column("recordings", justify="right")
    table.add_column("for example", overflow="fold")
    for kind, many, example in found.failures:
        table.add_row(kind, str(many), example)
    console.print(table)


def cells(each: Repeated) -> tuple[str, str, str, str, str]:
    """Mean, scatter, stated sd, chi^2 and drift as people read them; – where there is none."""
    digits = 3 if each.unit == "mm" else 1
    drift = "–" if math.isnan(each.drift) else f"{each.drift:+.{digits}f} ± {each.drift_half:.{digits}f} {each.unit}"
    return (
        f"{each.mean:.{digits}f} {each.unit}",
        _number(each.scatter, digits),
        _number(each.stated, digits),
        _number(each.chi_square, 1),
        drift,
    )


def told_apart(each: Repeated) -> str:
    """Why a quantity stands out, with its figures."""
    _, scatter, stated, _, drift = cells(each)
    drifts = f" by {drift} a day" if each.stands_out.endswith("drifts") else ""
    return f"{each.stands_out}{drifts} (scatter {scatter}, stated {stated} {each.unit}, {each.sessions} sessions)"


def save_summary(found: Summary, path: Path) -> list[Path]:
    """Write as the name's suffix says; the tables of objects and failures go beside that of repeatability, named after it.

    Raises:
        ArchiveError: another suffix.
        OutputError: it cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise ArchiveError(f"{path}: is none of {', '.join(SUFFIXES)}: name it so")
    if path.suffix == ".html":
        write_text(path, page_environment().get_template("archive.html").render(found=found, cells=cells, told_apart=told_apart))
        return [path]
    written: list[Path] = []
    for name, columns, rows in (
        ("", _REPEATED, [asdict(each) for each in found.repeated]),
        ("-objects", _OBJECTS, [dict(zip(dict(_OBJECTS), row, strict=True)) for row in found.objects]),
        ("-failures", _FAILURES, [dict(zip(dict(_FAILURES), row, strict=True)) for row in found.failures]),
    ):
        # Without rows it is written too: what a summary before this one left must not be taken for its own.
        place = path.with_name(f"{path.stem}{name}{path.suffix}")
        table, buffer = pa.Table.from_pylist(rows, pa.schema(columns)), BytesIO()
        if path.suffix == ".csv":
            pc.write_csv(table, buffer)
        else:
            pq.write_table(table, buffer)
        write_bytes(place, buffer.getvalue())
        written.append(place)
    return written


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
