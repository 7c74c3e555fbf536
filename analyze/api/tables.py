"""Tables of the public API: as pandas DataFrame, as HTML for notebooks, and as text."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from schemas.plain_text import visible

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd


def data_frame(table: Sequence[Mapping[str, Any]] | Mapping[str, Any]) -> pd.DataFrame:
    """Table as a pandas DataFrame, from a list of rows (cells by column name) or its columns by name.

    Raises:
        ImportError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise ImportError("to_dataframe needs pandas: `pip install pandas`, or use to_dict") from None
    return pd.DataFrame(table)


def html_table(title: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """HTML text of a table under a title; the keys of the first row become the header.

    All rows have these keys; without rows the table is empty.
    """
    head = "".join(f"<th>{escape(str(name))}</th>" for name in (rows[0] if rows else {}))
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row.values()) + "</tr>" for row in rows
    )
    return visible(
        f"<b>{escape(title)}</b><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def text_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Text table with aligned columns, header first; "" without rows. All rows have the keys of the first."""
    if not rows:
        return ""
    lines = [[visible(str(cell)) for cell in line] for line in (rows[0], *(row.values() for row in rows))]
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines
    )
