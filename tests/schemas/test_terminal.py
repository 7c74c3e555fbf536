"""User texts are printed letter by letter, and tables are never cut."""

from __future__ import annotations

import ast
import io
from pathlib import Path

import pytest
from rich.progress import Progress
from rich.table import Table

from schemas.terminal import PlainTextColumn, Terminal, styled
from tests.source_tree import nodes_of

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [path for name in ("acquire", "analyze", "schemas") for path in (ROOT / name).rglob("*.py")]
HEADINGS = ("strike", "centre of mass along x", "verdict", "about the edge")
HOSTILE = "[level] [/] [bold]tea[/bold] :smile: {task.total} $2"


def _printed(*objects: object, width: int = 120) -> str:
    out = io.StringIO()
    terminal = Terminal(file=out, width=width)
    for each in objects:
        terminal.print(each)
    return out.getvalue()


def _hostile_table() -> Table:
    table = Table(title=HOSTILE, title_justify="left")
    table.add_column(HOSTILE)
    table.add_row(HOSTILE)
    table.add_row(styled((HOSTILE, "red")))
    return table


@pytest.mark.parametrize(
    ("printed", "times"),
    [(HOSTILE, 1), (styled((HOSTILE, "bold"), " and ", HOSTILE), 2), (_hostile_table(), 4)],
    ids=["line", "styled", "table"],
)
def test_text_that_looks_like_markup_is_printed_as_it_is(printed: object, times: int) -> None:
    assert _printed(printed).count(HOSTILE) == times


def test_progress_shows_a_text_that_looks_like_markup() -> None:
    out = io.StringIO()
    terminal = Terminal(file=out, width=120, force_terminal=True, color_system=None)
    with Progress(PlainTextColumn("{task.description}"), console=terminal, auto_refresh=False) as progress:
        progress.add_task(HOSTILE)
    assert HOSTILE in out.getvalue()


def test_control_characters_in_a_name_reach_no_terminal() -> None:
    table = Table("name")
    table.add_row("a\x1b[31m\x07b\x9bc")
    shown = _printed("a\x1b[2J\x0db", table, styled(("x\x1b]0;title\x07", "bold")), "tab\tand\nnew line")
    assert not set(shown) & {"\x1b", "\x07", "\x9b", "\r"}
    assert "a␛[2J␍b" in shown
    assert "\nnew line" in shown


def test_only_one_module_makes_consoles_and_texts_of_rich() -> None:
    """Any other console would read markup; `rich.table`, `rich.box` and bars of `rich.progress` are free."""
    forbidden = {"rich.console.Console", "rich.text", "rich.markup", "rich.print", "rich.progress.TextColumn"}
    forbidden |= {"rich.progress.track", "rich.prompt", "rich.panel", "rich.live", "rich.status"}
    found = []
    for path in SOURCES:
        if path == ROOT / "schemas/terminal.py":
            continue
        for node in nodes_of(path):
            if not isinstance(node, ast.ImportFrom | ast.Import):
                continue
            module = getattr(node, "module", None)
            names = [f"{module}.{alias.name}" if module else alias.name for alias in node.names]
            found += [
                f"{path}:{node.lineno}: {name}"
                for name in names
                if any(name == one or name.startswith(f"{one}.") for one in forbidden)
            ]
            found += [f"{path}:{node.lineno}: {name}" for name in names if name == "rich"]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("width", [30, 50, 80])
def test_narrow_terminal_folds_cells_and_headings_and_cuts_none(width: int) -> None:
    table = Table()
    for heading in HEADINGS:
        table.add_column(heading, no_wrap=True)
    row = ["p4e0-first-heading-1", "123.456 ± 0.789 mm", "not_measured_closely", "1234567 ± 12 g cm²"]
    table.add_row(*row)
    shown = _printed(table, width=width)
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= width
    lines = [line.strip("│┃").replace("┃", "│").split("│") for line in shown.splitlines() if line[0] in "│┃"]
    columns = ["".join(cells).replace(" ", "") for cells in zip(*lines, strict=True)]
    assert columns == [
        f"{heading}{text}".replace(" ", "") for heading, text in zip(HEADINGS, row, strict=True)
    ]


def test_column_that_must_not_wrap_keeps_its_line_where_others_can_make_room() -> None:
    table = Table("words")
    table.add_column("id", no_wrap=True)
    table.add_row("many words that can be wrapped at every blank", "p4e0-first-heading-1")
    assert "p4e0-first-heading-1" in _printed(table, width=50)
