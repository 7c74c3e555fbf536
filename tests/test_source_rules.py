"""Rules that a parser can check: documented array shapes, colours of plots, reasons for long files."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.source_tree import ROOT, SOURCES, name_of, nodes_of, parsed
from tests.test_architecture import PURE

SHAPE = re.compile(r"\(\.\.\.\)|\(\s*[\w.+*/ -]+,(\s*[\w.+*/ -]+,?)*\s*\)")
"""a shape: (n,), (n, 3), (3, 3), or (...) for any"""
ARRAY_SOURCES = [path for path in SOURCES if path.relative_to(ROOT).as_posix().startswith(tuple(PURE))]
PLOTTERS = ("analyze/report/", "analyze/reproduce/", "analyze/verbs/calibrate/picture.py")
MAX_LINES = 400
"""lines above which a file gives the reason for its length"""


def _public_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def _takes_or_gives_arrays(node: ast.FunctionDef) -> bool:
    annotations = [argument.annotation for argument in (*node.args.args, *node.args.kwonlyargs)] + [
        node.returns
    ]
    return any(re.search(r"\b(Array|IntArray|NDArray)\b", ast.unparse(each)) for each in annotations if each)


@pytest.mark.parametrize("path", ARRAY_SOURCES, ids=name_of)
def test_public_array_functions_document_shapes(path):
    """Docstrings of public functions with arrays state a shape, for example (n, 3)."""
    undocumented = [
        f"{name_of(path)}:{node.lineno}: {node.name}"
        for node in _public_functions(parsed(path))
        if _takes_or_gives_arrays(node) and not SHAPE.search(ast.get_docstring(node) or "")
    ]
    assert not undocumented


def test_plot_colours_are_defined_in_the_style_file_only():
    """Plots take colours by name from `analyze/report/style.py`; only "none" and white may be literal."""
    keywords = {
        "color",
        "colors",
        "facecolor",
        "facecolors",
        "edgecolor",
        "edgecolors",
        "ecolor",
        "mfc",
        "mec",
        "c",
        "cmap",
    }
    found = []
    for path in SOURCES:
        if not name_of(path).startswith(PLOTTERS) or name_of(path).endswith("/style.py"):
            continue
        for node in nodes_of(path):
            if (
                isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and re.fullmatch(r"#([0-9a-fA-F]{3,4}){1,2}", node.value)
            ):
                found.append(f"{name_of(path)}:{node.lineno}: {node.value}")
            if (
                isinstance(node, ast.keyword)
                and node.arg in keywords
                and isinstance(node.value, ast.Constant)
            ):
                found += [f"{name_of(path)}:{node.value.lineno}: {node.value.value}"] * (
                    node.value.value not in {"none", "white"}
                )
    assert not found


def test_a_long_file_states_in_its_first_line_why_it_is_one():
    """The line says "one file", and why: because locks, registers or a layout are shared, for example."""
    files = (*SOURCES, *(ROOT / "tests").rglob("*.py"), *(ROOT / "docs").rglob("*.py"))
    lines = {name_of(path): path.read_text(encoding="utf-8").splitlines() for path in files}
    long = {name: text[0] for name, text in lines.items() if len(text) > MAX_LINES}
    assert not [name for name, first in long.items() if "; one file, " not in first]
