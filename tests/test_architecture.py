"""Rules that a parser can check: imports, owners of libraries, documented shapes, colours."""

from __future__ import annotations

import ast
import gc
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("acquire", "analyze", "schemas")
SOURCES = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py") if "_pb2" not in p.name)

OWNERS = {
    "av": {
        "analyze/sources/",
        "analyze/importing/",
        "analyze/reading/compressed_video.py",
        "analyze/replay/animation_file.py",
    },
    "gi": {"acquire/camera/aravis_library.py"},
    "dynamixel_sdk": {"acquire/striker/"},
    "serial": {"acquire/striker/"},
    "rosbags": {"analyze/sources/", "analyze/export/read_back.py"},
    "ruamel": {"analyze/sources/foreign_calibrations.py", "analyze/export/read_back.py"},
    "rerun": {"analyze/replay/"},
    "trimesh": {"analyze/geometry/mesh_files.py"},
    "laspy": {"analyze/geometry/cloud_files.py"},
    "manifold3d": {"analyze/geometry/mesh_holes.py", "analyze/geometry/mesh_repair.py"},
    "distributed": {"analyze/batch/cluster.py"},
    "duckdb": {"analyze/batch/query.py"},
    "fsspec": {"analyze/batch/"},
    "mcap": {"acquire/recorder/", "analyze/reading/recording.py", "analyze/sources/message_files.py"},
    # The second reads files back; no estimator does.
    "mujoco": {"acquire/virtual/", "analyze/export/read_back.py"},
    "pxr": {"analyze/export/"},
    "rod": {"analyze/export/read_back.py"},
    "yourdfpy": {"analyze/export/read_back.py"},
}
STDLIB = {"__future__", "collections", "dataclasses", "enum", "functools", "itertools", "math", "typing"}
DOCUMENTS = {
    "schemas.document",
    "schemas.object_spec",
    "schemas.part_label",
    "schemas.strike_plan",
    "schemas.session_manifest",
    "schemas.quantity",
    "schemas.result",
    "schemas.strike_result",
    "schemas.watch_lines",
}
FOUNDATION = (
    STDLIB
    | {
        "numpy",
        "scipy",
        "analyze.errors",
        "analyze.least_squares",
        "analyze.types",
        "schemas.impact_law",
        "schemas.rig_limits",
        "schemas.tags",
        "schemas.wording",
    }
    | DOCUMENTS
)
"""modules that every pure package may use: types of documents, limits, the impact law, names of tags"""
SHAPE_FORMATS = {"trimesh", "manifold3d", "laspy", "json", "re", "struct", "warnings", "zipfile.ZipFile"}
"""modules that turn a shape file's bytes into arrays in memory"""
PURE = {
    "analyze/least_squares": FOUNDATION,
    "analyze/geometry": FOUNDATION | {"analyze.geometry", "io.BytesIO", "pathlib.PurePath"} | SHAPE_FORMATS,
    "analyze/planning": (
        FOUNDATION
        | {"analyze.planning", "analyze.geometry", "analyze.tracking.camera_model"}
        | {f"analyze.motion.{name}" for name in ("moulded", "rolling_choice", "support_function", "supports")}
    ),
    "analyze/tracking": FOUNDATION | {"analyze.tracking", "cv2"},
    "analyze/calibration": FOUNDATION | {"analyze.calibration", "analyze.tracking", "analyze.tags", "cv2"},
    "analyze/motion": FOUNDATION | {"analyze.motion", "analyze.tracking", "analyze.geometry"},
    "analyze/registration": (
        FOUNDATION | {"analyze.registration", "analyze.motion", "analyze.tracking", "analyze.geometry"}
    ),
    "analyze/estimation": FOUNDATION | {"analyze.estimation", "analyze.geometry"},
}
"""modules that each pure package may import; others read a clock, a file or a device, or are later stages"""
IMPURE_CALLS = {
    "open",
    "print",
    "input",
    "exec",
    "eval",
    "__import__",
    "default_rng",
    "fromfile",
    "tofile",
    "loadtxt",
    "savetxt",
    "imread",
    "imwrite",
}
"""functions that do I/O or draw random numbers without an import of their own"""
CV2_ALLOWED = (
    "analyze/tracking",
    "analyze/calibration",
    "analyze/geometry",
    "analyze/reading/image_message.py",
    "analyze/sources/pictures.py",
    "analyze/replay/",
    "analyze/verbs/watch/",
    "analyze/verbs/gravity/picture.py",
    "analyze/batch",
    "analyze/report",
    "analyze/tags",
    "acquire/",
)
MADE_AT_RUN_TIME = "a name made at run time"


@pytest.fixture(scope="module", autouse=True)
def no_search_for_garbage() -> Iterator[None]:
    """Switch garbage collection off: searching the syntax trees, which all stay, takes half of the time."""
    gc.disable()
    yield
    gc.enable()


SHAPE = re.compile(r"\(\.\.\.\)|\(\s*[\w.+*/ -]+,(\s*[\w.+*/ -]+,?)*\s*\)")
"""a shape: (n,), (n, 3), (3, 3), or (...) for any"""
ARRAY_SOURCES = [path for path in SOURCES if path.relative_to(ROOT).as_posix().startswith(tuple(PURE))]


def _public_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def _takes_or_gives_arrays(node: ast.FunctionDef) -> bool:
    annotations = [argument.annotation for argument in (*node.args.args, *node.args.kwonlyargs)] + [
        node.returns
    ]
    return any(re.search(r"\b(Array|IntArray|NDArray)\b", ast.unparse(each)) for each in annotations if each)


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def _top_level_imports(path: Path) -> list[tuple[int, str]]:
    """Imports that run when the module is loaded: not those in functions, nor those for type checkers
    only."""
    late = {
        inner
        for node in _nodes(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
        for inner in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    return [(line, name) for line, name in _imports(path) if line not in late]


def _strongly_connected(graph: dict[str, set[str]]) -> Iterator[set[str]]:
    matrix_of = sorted(graph)
    index = {name: i for i, name in enumerate(matrix_of)}
    rows = [index[name] for name in matrix_of for _ in graph[name]]
    columns = [index[target] for name in matrix_of for target in graph[name]]
    links = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(graph), len(graph)))
    _, labels = connected_components(links, directed=True, connection="strong")
    groups: dict[int, set[str]] = {}
    for name, label in zip(matrix_of, labels.tolist(), strict=True):
        groups.setdefault(label, set()).add(name)
    yield from groups.values()


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(_tree(path)))


@cache
def _imports(path: Path) -> list[tuple[int, str]]:
    """(line, full name) of everything imported, also inside functions: of `from a import b` it is a.b,
    relative names are made whole."""
    package = path.relative_to(ROOT).parent.parts
    found = []
    for node in _nodes(path):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*above, *([node.module] if node.module else [])])
            found += [(node.lineno, f"{module}.{alias.name}") for alias in node.names]
        elif isinstance(node, ast.Call) and _called(node) in {"import_module", "__import__"}:
            name = node.args[0] if node.args else None
            found.append(
                (node.lineno, str(name.value) if isinstance(name, ast.Constant) else MADE_AT_RUN_TIME)
            )
    return found


def _called(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def _within(name: str, *packages: str) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _violations(rule) -> list[str]:
    return [
        f"{_name(path)}:{line}: imports {module}"
        for path in SOURCES
        for line, module in _imports(path)
        if rule(_name(path), module)
    ]


def _top(module: str) -> str:
    return module.partition(".")[0]


def test_imports_are_static():
    assert not _violations(lambda path, module: module == MADE_AT_RUN_TIME)


def test_nothing_imports_tests():
    assert not _violations(lambda path, module: _top(module) == "tests")


@pytest.mark.parametrize("module", sorted(OWNERS))
def test_a_library_has_its_owner(module):
    owners = OWNERS[module]
    assert not _violations(
        lambda path, name: _top(name) == module and not any(path.startswith(owner) for owner in owners)
    )


def test_layers_hold():
    """The contracts of `pyproject.toml`: who may import whom, and no cycle between folders."""
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_no_module_imports_itself_in_a_circle():
    graph = {module: set() for module in map(_module, SOURCES)}
    for path in SOURCES:
        for _, name in _top_level_imports(path):
            target = name if name in graph else name.rpartition(".")[0]
            if target in graph and target != _module(path):
                graph[_module(path)].add(target)
    circles = [sorted(each) for each in _strongly_connected(graph) if len(each) > 1]
    assert not circles


@pytest.mark.parametrize("path", ARRAY_SOURCES, ids=_name)
def test_public_array_functions_document_shapes(path):
    """Arrays say how many axes they have and what runs along them, as (n, 3)."""
    undocumented = [
        f"{_name(path)}:{node.lineno}: {node.name}"
        for node in _public_functions(_tree(path))
        if _takes_or_gives_arrays(node) and not SHAPE.search(ast.get_docstring(node) or "")
    ]
    assert not undocumented


@pytest.mark.parametrize("package", sorted(PURE))
def test_a_pure_package_imports_only_what_is_listed(package):
    assert not _violations(
        lambda path, module: path.startswith(package) and not _within(module, *PURE[package])
    )
    assert not _violations(
        lambda path, module: (
            path.startswith(package)
            and module.startswith(tuple(f"{document}.read_" for document in DOCUMENTS))
        )
    )


def test_the_estimators_are_pure():
    assert not [
        f"{_name(path)}:{node.lineno}: calls {_called(node)}"
        for path in SOURCES
        if _name(path).startswith(tuple(PURE))
        for node in _nodes(path)
        if isinstance(node, ast.Call) and _called(node) in IMPURE_CALLS
    ]


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("import acquire.virtual.world", "acquire.virtual.world"),
        ("from acquire import virtual", "acquire.virtual"),
        ("from acquire.virtual.world import World", "acquire.virtual.world.World"),
        ("from . import virtual", "acquire.virtual"),
        ("from .virtual import world", "acquire.virtual.world"),
        ("from ..acquire import virtual", "acquire.virtual"),
        ("def f():\n    import acquire.virtual", "acquire.virtual"),
        ("importlib.import_module('acquire.virtual')", "acquire.virtual"),
        ("importlib.import_module(name)", MADE_AT_RUN_TIME),
    ],
)
def test_every_form_of_import_is_recognised(line, name, tmp_path, monkeypatch):
    monkeypatch.setattr("tests.test_architecture.ROOT", tmp_path)
    (tmp_path / "acquire").mkdir()
    path = tmp_path / "acquire" / "daemon.py"
    path.write_text(line, encoding="utf-8")
    assert [found for _, found in _imports(path)] == [name]


def test_only_named_modules_use_opencv():
    assert not _violations(lambda path, module: _top(module) == "cv2" and not path.startswith(CV2_ALLOWED))


def test_pickle_and_shells_are_not_used():
    assert not _violations(lambda path, module: _top(module) in {"pickle", "shelve", "marshal", "dill"})
    shells = [
        f"{_name(path)}:{node.lineno}: shell=True"
        for path in SOURCES
        for node in _nodes(path)
        if isinstance(node, ast.keyword)
        and node.arg == "shell"
        and isinstance(node.value, ast.Constant)
        and node.value.value is True
    ]
    assert not shells


def test_no_file_is_called_utils():
    assert not [p for p in SOURCES if p.stem in {"utils", "helpers", "common", "misc"}]


def test_every_module_has_a_docstring():
    assert not [str(p.relative_to(ROOT)) for p in SOURCES if ast.get_docstring(_tree(p)) is None]


PLOTTERS = ("analyze/report/", "analyze/reproduce/", "analyze/verbs/calibrate/picture.py")


def test_plot_colours_are_defined_in_the_style_file_only():
    """A plot takes its colours by name from `analyze/report/style.py`; nothing and white are no colours."""
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
        if not _name(path).startswith(PLOTTERS) or _name(path).endswith("/style.py"):
            continue
        for node in _nodes(path):
            if (
                isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and re.fullmatch(r"#([0-9a-fA-F]{3,4}){1,2}", node.value)
            ):
                found.append(f"{_name(path)}:{node.lineno}: {node.value}")
            if (
                isinstance(node, ast.keyword)
                and node.arg in keywords
                and isinstance(node.value, ast.Constant)
            ):
                found += [f"{_name(path)}:{node.value.lineno}: {node.value.value}"] * (
                    node.value.value not in {"none", "white"}
                )
    assert not found
    # The moving picture of a strike has the replay's colours, by name from `analyze/replay/palette.py`.
    others = (*PLOTTERS, "analyze/tags/pdf.py", "analyze/api/", "analyze/replay/tip_drawing.py")
    assert not _violations(lambda path, module: _top(module) == "matplotlib" and not path.startswith(others))
