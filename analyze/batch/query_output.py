"""Print answers of `analyze query` as a table, CSV or JSON, or write them to a file."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from rich.cells import cell_len
from rich.table import Table

from analyze.errors import ArchiveError
from schemas.output_file import write_bytes
from schemas.plain_text import csv_cell, json_line
from schemas.terminal import Terminal
from schemas.wording import counted

SIGNIFICANT_DIGITS = 6
UNLIMITED_WIDTH = 10_000
NARROWEST_CELL = 12
"""letters to which the cells of a column may be folded before the table is printed row by row"""
_FRAME_WIDTH = 3
"""width of a column's line and padding"""


def print_answer(answer: pa.Table, form: str, console: Terminal | None = None) -> None:
    """Print the rows of a query on standard output.

    Args:
        answer: result of the query.
        form: "csv"; "json" for one object per line, with null for numbers that are not finite; or "table" for
            a drawn table with the number of rows below it. A table too wide for the terminal is printed row
            by row, a line per column.
        console: where to print a table; None for standard output.
    """
    if form == "json":
        for row in answer.to_pylist():
            sys.stdout.write(json_line(_json(row)) + "\n")
        return
    if form == "csv":
        sys.stdout.write(_csv(answer).decode())
        return
    console = console or plain_console()
    rows = [[_cell(value) for value in row.values()] for row in answer.to_pylist()]
    if _folded_width(answer.column_names, rows) <= console.width:
        table = Table(*answer.column_names)
        for row in rows:
            table.add_row(*row)
        console.print(table)
    else:
        for number, row in enumerate(rows, 1):
            record = Table(title=f"row {number}", title_justify="left", box=None, show_header=False)
            record.add_column(no_wrap=True)
            record.add_column()
            for name, value in zip(answer.column_names, row, strict=True):
                record.add_row(name, value)
            console.print(record)
    console.print(counted(answer.num_rows, "row"))


def _folded_width(names: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
    """Least width [characters] of a readable table: whole headings, other cells folded to a few letters."""
    widths = (
        max([cell_len(name), *(min(cell_len(row[i]), NARROWEST_CELL) for row in rows)])
        for i, name in enumerate(names)
    )
    return 1 + sum(width + _FRAME_WIDTH for width in widths)


def plain_console() -> Terminal:
    """Console without markup; as wide as its terminal, or 10 000 columns where output is redirected."""
    console = Terminal()
    if not console.is_terminal:
        console.width = UNLIMITED_WIDTH
    return console


def save_answer(answer: pa.Table, path: Path) -> None:
    """Write the rows of a query to a file, as Parquet or CSV by the path's suffix.

    Raises:
        ArchiveError: the suffix is neither .parquet nor .csv.
        OutputError: the file cannot be written.
    """
    if path.suffix == ".parquet":
        buffer = BytesIO()
        pq.write_table(answer, buffer)
        write_bytes(path, buffer.getvalue())
    elif path.suffix == ".csv":
        write_bytes(path, _csv(answer))
    else:
        raise ArchiveError(f"{path}: unknown file type {path.suffix!r}: use .parquet or .csv")


def _csv(answer: pa.Table) -> bytes:
    columns = {csv_cell(name): _flat(answer.column(name)) for name in answer.column_names}
    buffer = BytesIO()
    pc.write_csv(pa.table(columns), buffer)
    return buffer.getvalue()


def _flat(column: pa.ChunkedArray) -> Any:
    """Column in a form that CSV can hold.

    Lists and structures become JSON text, intervals and bytes their Python text, texts no formulas; other
    columns stay as they are, missing values missing.
    """
    if pa.types.is_nested(column.type):
        text = _json
    elif pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        text = csv_cell
    elif pa.types.is_interval(column.type) or pa.types.is_binary(column.type):
        text = str
    else:
        return column
    return pa.array([None if value is None else text(value) for value in column.to_pylist()], pa.string())


def _json(value: Any) -> str:
    return json.dumps(_finite(value), default=str, ensure_ascii=False)


def _finite(value: Any) -> Any:
    """Copy of a value, nested or not, with None in place of NaN and infinities, which JSON cannot hold."""
    if isinstance(value, dict):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.{SIGNIFICANT_DIGITS}g}"
    return (
        json.dumps(value, default=str, ensure_ascii=False) if isinstance(value, list | dict) else str(value)
    )
