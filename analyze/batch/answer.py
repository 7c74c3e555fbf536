"""A table of answers, printed or written."""

from __future__ import annotations

import json
import math
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from rich.console import Console
from rich.table import Table

from analyze.errors import ArchiveError
from analyze.output_file import write_bytes

_DIGITS = 6
_NO_EDGE = 10_000


def print_answer(answer: pa.Table, form: str) -> None:
    """Print as "table", "csv" or "json" (a line per row)."""
    if form == "json":
        for row in answer.to_pylist():
            sys.stdout.write(json.dumps(_finite(row), default=str, ensure_ascii=False) + "\n")
        return
    if form == "csv":
        sys.stdout.write(_csv(answer).decode())
        return
    table = Table()
    for name in answer.column_names:
        table.add_column(name, overflow="fold")
    for row in answer.to_pylist():
        table.add_row(*(_shown(value) for value in row.values()))
    console = plain_console()
    console.print(table)
    console.print(f"{answer.num_rows} {'row' if answer.num_rows == 1 else 'rows'}")


def plain_console() -> Console:
    """Shows text as it is, brackets and colons too; as wide as it must be where nobody sees its edge."""
    console = Console(highlight=False, markup=False, emoji=False)
    return console if console.is_terminal else Console(highlight=False, markup=False, emoji=False, width=_NO_EDGE)


def save_answer(answer: pa.Table, path: Path) -> None:
    """Write as the name's suffix says.

    Raises:
        ArchiveError: another suffix than .parquet and .csv.
        OutputError: it cannot be written.
    """
    if path.suffix == ".parquet":
        buffer = BytesIO()
        pq.write_table(answer, buffer)
        write_bytes(path, buffer.getvalue())
    elif path.suffix == ".csv":
        write_bytes(path, _csv(answer))
    else:
        raise ArchiveError(f"{path}: is neither .parquet nor .csv: name it so")


def _csv(answer: pa.Table) -> bytes:
    columns = {name: _flat(answer.column(name)) for name in answer.column_names}
    buffer = BytesIO()
    pc.write_csv(pa.table(columns), buffer)
    return buffer.getvalue()


def _flat(column: pa.ChunkedArray) -> Any:
    """Lists and structures as JSON, intervals and bytes as text: a CSV file has none of them."""
    if pa.types.is_nested(column.type):
        return pa.array(
            [None if value is None else json.dumps(_finite(value), default=str, ensure_ascii=False) for value in column.to_pylist()],
            pa.string(),
        )
    if pa.types.is_interval(column.type) or pa.types.is_binary(column.type):
        return pa.array([None if value is None else str(value) for value in column.to_pylist()], pa.string())
    return column


def _finite(value: Any) -> Any:
    """With null for what is no number: JSON has no NaN."""
    if isinstance(value, dict):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _shown(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return json.dumps(value, default=str, ensure_ascii=False) if isinstance(value, list | dict) else str(value)
