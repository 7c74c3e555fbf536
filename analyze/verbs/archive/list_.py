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
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from analyze.batch.query_output import plain_console
    from schemas.wording import counted

    table = Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("start (UTC)", "object", "rig", "strikes", "MB", "c (mm)", "flags", "recording"):
        right = heading in {"strikes", "MB"}
        table.add_column(heading, justify="right" if right else "left", overflow="fold")
    rows = found.to_pylist()
    for row in rows:
        table.add_row(
            (row["created"] or "")[:16].replace("T", " "),
            row["object"] or "",
            row["rig"] or "",
            "" if row["strikes"] is None else str(row["strikes"]),
            f"{row['size_bytes'] / _MEGA:.1f}",
            _centre(row),
            ", ".join(row["flags"] or []),
            row["url"],
        )
    console = plain_console()
    if rows:
        console.print(table)
    total = sum(row["size_bytes"] for row in rows)
    console.print(f"{counted(len(rows), 'recording')}, {total / 1e9:.2f} GB")


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
