"""A table of the reproduction on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as RichTable

if TYPE_CHECKING:
    from analyze.reproduce.paper.tables import Table


LEFT_OUT = ("paper", "n", "mean")
"""columns that a terminal of 80 characters has no room for"""


def render_table(table: Table, console: Console | None = None) -> None:
    """Print it."""
    console = console or Console(highlight=False)
    shown = RichTable(title=table.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    places = [i for i, column in enumerate(table.columns) if column.name not in LEFT_OUT]
    for i in places:
        # The first wraps, the numbers do not.
        shown.add_column(table.columns[i].name, justify="right" if i else "left", no_wrap=i > 0)
    for row in table.rows:
        shown.add_row(*("-" if row[i] is None else str(row[i]) for i in places))
    console.print(shown)
