"""A table of the reproduction on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as RichTable

if TYPE_CHECKING:
    from analyze.reproduce.paper.tables import Table


FIRST = 30
"""characters, of the first column: it wraps, the numbers do not"""


def render_table(table: Table, console: Console | None = None) -> None:
    """Print it."""
    console = console or Console(highlight=False)
    shown = RichTable(title=table.title, title_justify="left", box=SIMPLE_HEAD)
    for i, column in enumerate(table.columns):
        shown.add_column(column.name, justify="right" if i else "left", min_width=None if i else FIRST)
    for row in table.rows:
        shown.add_row(*("-" if value is None else str(value) for value in row))
    console.print(shown)
