"""Names from files command no terminal and no spreadsheet, and fit streams of any encoding."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import pyarrow as pa
import pytest

from analyze.api.tables import html_table
from analyze.batch.query_output import print_answer, save_answer
from analyze.replay.markdown import as_written, message
from analyze.report.csv_table import csv_text
from analyze.report.page import page_environment
from schemas.plain_text import csv_cell, echo, json_line, visible, write_escaped

ROOT = Path(__file__).resolve().parents[2]
HOSTILE = "=x\x1b]0;owned\x07\x1b[2J\x9b1m\x00\u202egpj"
FORMULAS = ("=cmd|' /C calc'!A0", "+1+1", "-x", "@SUM(A1)", "\t=1")
NUMBERS = ("-1", "+1", "-1.5e-3", "-.5", "1")


def _harmless(text: str) -> bool:
    return not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", text)


def test_control_characters_and_reversed_writing_become_visible(capsys):
    assert _harmless(visible(HOSTILE))
    assert len(visible(HOSTILE)) == len(HOSTILE)
    assert visible("a\n\tb é 球 😀") == "a\n\tb é 球 😀"
    echo(HOSTILE, err=True)
    assert _harmless(capsys.readouterr().err)


@pytest.mark.parametrize("text", FORMULAS)
def test_formulas_in_tables_are_text(text, tmp_path):
    assert csv_cell(text).startswith("'")
    (row,) = csv.reader(io.StringIO(csv_text(["name"], [[text]]).split("\n", 1)[1]))
    assert row == [csv_cell(text)]
    save_answer(pa.table({"name": [text], "x": [-1.0]}), tmp_path / "a.csv")
    assert list(csv.reader(io.StringIO((tmp_path / "a.csv").read_text(encoding="utf-8"))))[1] == [
        csv_cell(text),
        "-1",
    ]


@pytest.mark.parametrize("text", NUMBERS)
def test_numbers_in_tables_stay(text):
    assert csv_cell(text) == text


def test_json_keeps_its_values_and_commands_nothing(capsys):
    line = json_line(json.dumps({"name": HOSTILE}, ensure_ascii=False))
    assert _harmless(line)
    assert json.loads(line) == {"name": HOSTILE}
    print_answer(pa.table({"name": [HOSTILE]}), "json")
    out = capsys.readouterr().out
    assert _harmless(out)
    assert json.loads(out) == {"name": HOSTILE}


def test_pages_show_names_as_text():
    page = page_environment().from_string("<p>{{ name }}</p>").render(name=f"<b>{HOSTILE}")
    assert _harmless(page)
    assert "<b>" not in page


@pytest.mark.parametrize("show", [as_written, message, lambda text: html_table(text, [{text: text}])])
def test_replays_and_notebooks_show_names_as_text(show):
    assert _harmless(show(HOSTILE))


def test_a_stream_in_ascii_holds_every_text():
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    write_escaped(stream)
    stream.write('"é ± 球 😀"')
    stream.flush()
    assert json.loads(raw.getvalue()) == "é ± 球 😀"


def test_commands_print_through_this_module():
    sources = [path for name in ("acquire", "analyze") for path in (ROOT / name).rglob("*.py")]
    assert [path for path in sources if "click.echo(" in path.read_text(encoding="utf-8")] == []
