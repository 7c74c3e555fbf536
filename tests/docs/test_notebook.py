"""The notebook runs from top to bottom on the committed sample, and every figure that it shows can be drawn.

A notebook is JSON whose code cells are Python: they run here as they stand, without Jupyter's fifty packages.
It is committed without outputs, which would become stale unnoticed: this test produces them anew every time.
"""

from __future__ import annotations

import ast
import io
import json

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from analyze.report.style import MUTED
from tests.places import ROOT

NOTEBOOK = ROOT / "docs" / "notebook.ipynb"
MAGIC = "%matplotlib inline"


def cells(kind: str) -> list[str]:
    found = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    return ["".join(cell["source"]) for cell in found["cells"] if cell["cell_type"] == kind]


def shown(source: str, names: dict) -> object:
    """Run a cell; what its last line is worth, as Jupyter shows it."""
    tree = ast.parse(source.removeprefix(MAGIC))
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)


@pytest.fixture(scope="module")
def results():
    with pytest.MonkeyPatch.context() as patch, mpl.rc_context():
        patch.chdir(NOTEBOOK.parent)
        names: dict = {}
        yield [(shown(source, names), mpl.rcParams["xtick.color"]) for source in cells("code")]


def test_every_cell_runs_and_every_figure_is_drawn_in_the_one_style(results):
    figures = [(value, colour) for value, colour in results if isinstance(value, Figure)]
    assert len(figures) == 5
    for figure, colour in figures:
        assert colour == MUTED, (
            "ticks get their colours when they are drawn, after the function that made the figure"
        )
        picture = io.BytesIO()
        FigureCanvasAgg(figure).print_png(picture)
        assert len(picture.getvalue()) > 5000


def test_what_it_ends_with_is_the_document(results):
    assert {"centre_of_mass", "strikes", "verdict", "warnings"} <= set(results[-1][0])


def test_it_is_committed_without_outputs_and_with_few_words():
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        assert cell["cell_type"] != "code" or (cell["outputs"], cell["execution_count"]) == ([], None)
    assert all(
        "%" not in source.removeprefix(MAGIC).replace(" % ", "") or 'f"' in source for source in cells("code")
    )
    assert sum(len(text.split()) for text in cells("markdown")) < 400
