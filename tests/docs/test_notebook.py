"""The notebook runs on the committed sample, and gives the outputs that are committed with it.

A notebook is JSON whose code cells are Python: they run here as they stand, without Jupyter. `make notebook`
writes the outputs anew.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tests.places import ROOT

NOTEBOOK = ROOT / "docs" / "notebook.ipynb"


def code_cells() -> list[dict]:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def run(source: str, names: dict) -> tuple[object, str]:
    """Run a cell; return the value of its last expression (None without one) and the text it prints."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, str(NOTEBOOK), "exec"), names)
        code = None if last is None else compile(ast.Expression(last.value), str(NOTEBOOK), "eval")
        value = None if code is None else eval(code, names)
    return value, printed.getvalue()


@pytest.fixture(scope="module")
def results():
    with pytest.MonkeyPatch.context() as patch, mpl.rc_context({"backend": "agg"}):
        patch.chdir(NOTEBOOK.parent)
        names: dict = {}
        yield [(cell, *run("".join(cell["source"]), names)) for cell in code_cells()]


def assert_same_text(committed: str, made: str) -> None:
    """Fail unless both have as many lines, and those on centre of mass and tensor are equal.

    Region masses come from random draws; they and the sentences on them may differ between machines.
    """
    before, now = committed.splitlines(), made.splitlines()
    assert len(before) == len(now), "run `make notebook`"
    for old, new in zip(before, now, strict=True):
        if old.startswith(("CentreOfMass", "InertiaTensor", "Recording")):
            assert old == new, "run `make notebook`"


def test_only_the_public_interface_is_used():
    imported = [
        node
        for cell in code_cells()
        for node in ast.walk(ast.parse("".join(cell["source"])))
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    names = {alias.name for node in imported if isinstance(node, ast.Import) for alias in node.names}
    assert names == {"analyze", "numpy", "matplotlib.pyplot"}
    assert not [node for node in imported if isinstance(node, ast.ImportFrom)]


def test_every_figure_can_be_drawn(results):
    figures = [value for _, value, _ in results if isinstance(value, Figure)]
    assert len(figures) == 4
    for figure in figures:
        picture = io.BytesIO()
        FigureCanvasAgg(figure).print_png(picture)
        assert len(picture.getvalue()) > 5000


def test_committed_outputs_are_up_to_date(results):
    for cell, value, printed in results:
        outputs = cell["outputs"]
        committed = "".join("".join(each["text"]) for each in outputs if each["output_type"] == "stream")
        assert_same_text(committed, printed)
        shown = [each["data"] for each in outputs if each["output_type"] == "execute_result"]
        if isinstance(value, Figure):
            assert "image/png" in shown[0]
        elif type(value).__module__.startswith("analyze."):
            assert_same_text("".join(shown[0]["text/plain"]), repr(value))
