"""Write CSV tables: UTF-8, separated by commas, a line of headings, empty fields for missing values."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from schemas.output_file import OutputError, write_text
from schemas.plain_text import csv_cell

Cell = str | int | float | bool | None


@dataclass(frozen=True)
class CsvTable:
    """Table that is written as one CSV file: name, headings and rows."""

    name: str
    """File name without .csv."""
    headings: Sequence[str]
    """Headings of the columns, most with their unit."""
    rows: Sequence[Sequence[Cell]]
    """Cells of each row; None for a missing value."""


def table_of(name: str, records: Sequence[Mapping[str, Cell]]) -> CsvTable:
    """CSV table of one or more records, all with the keys of the first, which become the headings.

    Args:
        name: file name without .csv.
        records: cells of each row by heading, in the order of the columns.
    """
    return CsvTable(name, list(records[0]), [list(record.values()) for record in records])


def csv_text(headings: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """CSV text of a table: the headings, then a line per row.

    Args:
        headings: headings of the columns.
        rows: cells of each row; None becomes an empty field.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_plain(cell) for cell in row] for row in (headings, *rows))
    return text.getvalue()


def _plain(cell: Cell) -> Cell:
    return csv_cell(cell) if isinstance(cell, str) else "" if cell is None else cell


def make_folder(folder: Path) -> None:
    """Make a folder unless it exists; a missing parent is an error, because the path may be misspelt.

    Raises:
        OutputError: the parent is missing, the path is a file, or the folder cannot be made.
    """
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        raise OutputError(
            f"{folder}: cannot be made: there is no folder {folder.parent}: create it first"
        ) from None
    except FileExistsError:
        raise OutputError(f"{folder}: is a file: give a folder for the tables") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}: choose another place") from None


def write_tables(tables: Sequence[CsvTable], folder: Path) -> None:
    """Write each table as `<name>.csv` into a folder, which must exist; existing files are replaced.

    Raises:
        OutputError: a file cannot be written.
    """
    for table in tables:
        write_text(folder / f"{table.name}.csv", csv_text(table.headings, table.rows))
