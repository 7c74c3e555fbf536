"""`analyze archive list`: the recordings of the catalogue, searched."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.archive.selection import json_option, with_selection
from analyze.verbs.options import one_line, path_option, results_folder_option
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo

if TYPE_CHECKING:
    import pyarrow as pa

    from analyze.catalogue.listing import Selection

_MEGA = 1e6


@click.command("list")
@results_folder_option
@with_selection
@json_option
@path_option("--save", help="The file to write the list to, with all columns (.parquet or .csv).")
@one_line
def list_(output: Path, selection: Selection, as_json: bool, save: Path | None) -> None:
    """List recordings of the catalogue with their answers; the options search."""
    from analyze.batch.query_output import print_answer, save_answer
    from analyze.catalogue.listing import list_recordings

    if as_json and save is not None:
        raise click.UsageError("--json and --save exclude each other: choose one")
    refuse_outputs([save])
    found = list_recordings(output, selection)
    if save is not None:
        save_answer(found, save)
        echo(f"list: {save}")
    elif as_json:
        print_answer(found, "json")
    else:
        _print(found)


def _print(found: pa.Table) -> None:
    """Print a table, or two lines per recording if the terminal is too narrow for it."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from analyze.batch.query_output import plain_console
    from schemas.terminal import full_width
    from schemas.wording import counted

    rows = found.to_pylist()
    lines = [_cells(row) for row in rows]
    console = plain_console()
    table = Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in _HEADINGS:
        table.add_column(heading, justify="right" if heading in {"strikes", "MB"} else "left", no_wrap=True)
    for line in lines:
        table.add_row(*line)
    if rows and full_width(table, console) <= console.width:
        console.print(table)
    else:
        for start, name, rig, strikes, size, centre, flags, place in lines:
            texts = (
                start,
                name,
                rig,
                strikes and counted(int(strikes), "strike"),
                f"{size} MB",
                centre and f"c {centre} mm",
            )
            console.print("  ".join(text for text in texts if text))
            console.print(f"    {place}" + (f": {flags}" if flags else ""), soft_wrap=True)
    total = sum(row["size_bytes"] for row in rows)
    console.print(f"{counted(len(rows), 'recording')}, {total / 1e9:.2f} GB")


_HEADINGS = ("start (UTC)", "object", "rig", "strikes", "MB", "c (mm)", "flags", "recording")


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    """Texts of a recording's row, one for each of `_HEADINGS`."""
    place = str(row["url"])
    here = f"{Path.cwd()}/"
    return (
        (row["created"] or "")[:16].replace("T", " "),
        row["object"] or "",
        row["rig"] or "",
        "" if row["strikes"] is None else str(row["strikes"]),
        f"{row['size_bytes'] / _MEGA:.1f}",
        _centre(row),
        ", ".join(row["flags"] or []),
        place.removeprefix(here),
    )


def _centre(row: dict[str, Any]) -> str:
    """Centre of mass [mm] in the object frame; an axis that is not known as a dash."""
    from analyze.result.digits import decimals, number

    cells = []
    for axis in "xyz":
        value, sd = row[f"com_{axis}_mm"], row[f"com_sd_{axis}_m"]
        if value is None or not sd or not row["com_observed"]:
            cells.append("–")
        else:
            cells.append(number(value, decimals(1e3 * sd)))
    return "" if cells == ["–"] * 3 else " ".join(cells)
