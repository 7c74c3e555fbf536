"""Terminal output of both commands: text printed as it is, tables that fit the width, progress texts.

All printing by way of the package rich goes through this module. Rich reads `[level]` in a text as markup and
leaves it out; names of objects, regions, topics and files come from users and contain whatever they like.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.progress import TextColumn
from rich.table import Column, Table
from rich.text import Text

from schemas.plain_text import visible

_UNLIMITED_WIDTH = 10_000
_NARROWEST_COLUMN = 6
"""width to which words are broken so that a column that is not to wrap keeps its lines"""
PlainTextColumn = partial(TextColumn, markup=False)
"""column of a progress bar whose text is printed as it is"""


class Terminal(Console):
    """Console that prints every text as it is, and tables without cut cells or headings.

    Texts are not searched for markup, emoji codes or numbers to colour; emphasis is given as `style` or with
    `styled`. Control characters are replaced by visible signs.

    Args:
        options: options of `rich.console.Console`, such as `stderr`, `width` or `file`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print objects as `rich.console.Console.print` does; tables are fitted to the width first."""
        for each in objects:
            if isinstance(each, Table):
                fold_cells(each, self)
        super().print(*objects, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text as rich prints it, with visible signs in place of control characters."""
        return super().render_str(visible(text), **options)


def styled(*parts: str | tuple[str, str]) -> Text:
    """Text in which some parts are emphasised, with visible signs in place of control characters.

    Args:
        parts: texts; one to emphasise is given with its style, as in `("failed", "bold red")`.
    """
    pairs = ((part, "") if isinstance(part, str) else part for part in parts)
    return Text.assemble(*((visible(text), style) for text, style in pairs))


def fold_cells(table: Table, console: Console) -> None:
    """Make a table's columns wrap where it is wider than the console, so that nothing is cut.

    Columns that are not to wrap (`no_wrap`) do so only if the others cannot make enough room.

    Args:
        table: the table, which is changed.
        console: where it will be printed.
    """
    for column in table.columns:
        column.overflow = "fold"
    if full_width(table, console) <= console.width:
        return
    lines, words = (
        [_widest(column, pattern) for column in table.columns] for pattern in (str.splitlines, str.split)
    )
    frame = full_width(table, console) - sum(lines)
    least = sum(
        line if column.no_wrap else min(word, _NARROWEST_COLUMN)
        for column, line, word in zip(table.columns, lines, words, strict=True)
    )
    if frame + least > console.width:
        for column in table.columns:
            column.no_wrap = False


def full_width(table: Table, console: Console) -> int:
    """Width in characters of a table in which no cell wraps."""
    unlimited = console.options.update(max_width=_UNLIMITED_WIDTH)
    return Measurement.get(console, unlimited, table).maximum


def _widest(column: Column, pieces: Any) -> int:
    """Width of the widest piece (line or word, as the function `pieces` splits) of a column's cells."""
    cells = (str(cell) for cell in (column.header, *column.cells))
    return max((cell_len(piece) for cell in cells for piece in pieces(cell)), default=0)
