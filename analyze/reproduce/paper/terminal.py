"""Terminal output of the reproduction's tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table as RichTable

from schemas.terminal import Terminal

if TYPE_CHECKING:
    from analyze.reproduce.paper.tables import Table


OMITTED_COLUMNS = ("paper", "n", "mean")
"""Columns for which a terminal of 80 characters has no room."""


def render_table(table: Table, console: Terminal | None = None) -> None:
    """Print a table of the reproduction on the terminal, without the columns in `OMITTED_COLUMNS`.

    Args:
        table: the table.
        console: where to print; None for standard output.
    """
    console = console or Terminal()
    shown = RichTable(title=table.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    places = [i for i, column in enumerate(table.columns) if column.name not in OMITTED_COLUMNS]
    for i in places:
        # Only the first column wraps; numbers stay on one line.
        shown.add_column(table.columns[i].name, justify="right" if i else "left", no_wrap=i > 0)
    for row in table.rows:
        shown.add_row(*("-" if row[i] is None else str(row[i]) for i in places))
    console.print(shown)
