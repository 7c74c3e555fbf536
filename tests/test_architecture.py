"""Rules that a parser can check: who imports what, owners of libraries, pure packages, no shells."""

from __future__ import annotations

import ast
import gc
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from schemas.striker_kind import STRIKER_KINDS
from tests.source_tree import (
    MADE_AT_RUN_TIME,
    ROOT,
    SOURCES,
    called_name,
    imports_of,
    name_of,
    nodes_of,
    parsed,
)

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
    "starlette": {"acquire/console/web/"},
    "uvicorn": {"acquire/console/web/server.py"},
    "rosbags": {"analyze/sources/", "analyze/export/read_back.py"},
    "ruamel": {"analyze/sources/foreign_calibrations.py", "analyze/export/read_back.py"},
    "rerun": {"analyze/replay/"},
    "trimesh": {"analyze/geometry/mesh_files.py"},
    "laspy": {"analyze/geometry/cloud_files.py"},
    "manifold3d": {
        "analyze/fixture/",
        "analyze/rig_parts/",
        "analyze/geometry/mesh_holes.py",
        "analyze/geometry/mesh_repair.py",
    },
    "distributed": {"analyze/batch/cluster.py"},
    "duckdb": {"analyze/batch/query.py", "analyze/batch/stored_results.py", "analyze/catalogue/listing.py"},
    "fsspec": {"analyze/batch/", "analyze/catalogue/"},
    "matplotlib": {
        "analyze/api/",
        "analyze/replay/tip_drawing.py",
        "analyze/report/",
        "analyze/reproduce/",
        "analyze/tags/pdf.py",
        "analyze/verbs/calibrate/picture.py",
    },
    "mcap": {"acquire/recorder/", "analyze/reading/recording.py", "analyze/sources/message_files.py"},
    # The second reads files back, the others simulate what the estimate left out; no estimator does.
    "mujoco": {
        "acquire/virtual/",
        "analyze/export/read_back.py",
        "analyze/predict/scene.py",
        "analyze/predict/thrown.py",
    },
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
    "schemas.toss_result",
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
        | {"analyze.planning", "analyze.geometry", "analyze.tracking.camera_model", "re"}
        | {f"analyze.motion.{name}" for name in ("moulded", "rolling_choice", "support_function", "supports")}
    ),
    "analyze/tracking": FOUNDATION | {"analyze.tracking", "cv2"},
    "analyze/calibration": FOUNDATION | {"analyze.calibration", "analyze.tracking", "analyze.tags", "cv2"},
    "analyze/motion": FOUNDATION | {"analyze.motion", "analyze.tracking", "analyze.geometry"},
    "analyze/flight": FOUNDATION
    | {
        "analyze.flight",
        "analyze.motion.body_motion",
        "analyze.geometry",
        "analyze.tracking",
        "analyze.geometry.second_moments",
    },
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
    "analyze/compact/",
    "analyze/geometry",
    "analyze/reading/image_message.py",
    "analyze/sources/pictures.py",
    "analyze/replay/",
    "analyze/verbs/watch/",
    "analyze/verbs/advise/serve.py",
    "analyze/verbs/gravity/picture.py",
    "analyze/batch",
    "analyze/report",
    "analyze/tags",
    "acquire/",
)


@pytest.fixture(scope="module", autouse=True)
def no_search_for_garbage() -> Iterator[None]:
    """Switch garbage collection off: searching the syntax trees, which all stay, takes half of the time."""
    gc.disable()
    yield
    gc.enable()


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def _top_level_imports(path: Path) -> list[tuple[int, str]]:
    """Line and full name of a module's imports, those for type checkers too; not those in functions."""
    late = {
        inner
        for node in nodes_of(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for inner in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    return [(line, name) for line, name in imports_of(path) if line not in late]


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


def _within(name: str, *packages: str) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _violations(rule) -> list[str]:
    return [
        f"{name_of(path)}:{line}: imports {module}"
        for path in SOURCES
        for line, module in imports_of(path)
        if rule(name_of(path), module)
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
        f"{name_of(path)}:{node.lineno}: calls {called_name(node)}"
        for path in SOURCES
        if name_of(path).startswith(tuple(PURE))
        for node in nodes_of(path)
        if isinstance(node, ast.Call) and called_name(node) in IMPURE_CALLS
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
    monkeypatch.setattr("tests.source_tree.ROOT", tmp_path)
    (tmp_path / "acquire").mkdir()
    path = tmp_path / "acquire" / "daemon.py"
    path.write_text(line, encoding="utf-8")
    assert [found for _, found in imports_of(path)] == [name]


def test_only_named_modules_use_opencv():
    assert not _violations(lambda path, module: _top(module) == "cv2" and not path.startswith(CV2_ALLOWED))


def test_no_code_asks_for_the_kind_of_striker():
    """Only the factory (acquire/striker/kinds.py) maps a kind to a class; others ask for its properties."""
    found = [
        f"{name_of(path)}:{node.lineno}: compares with {side.value!r}"
        for path in SOURCES
        for node in nodes_of(path)
        if isinstance(node, ast.Compare)
        for side in (node.left, *node.comparators)
        if isinstance(side, ast.Constant) and side.value in STRIKER_KINDS
    ]
    assert not found


def test_pickle_and_shells_are_not_used():
    assert not _violations(lambda path, module: _top(module) in {"pickle", "shelve", "marshal", "dill"})
    shells = [
        f"{name_of(path)}:{node.lineno}: shell=True"
        for path in SOURCES
        for node in nodes_of(path)
        if isinstance(node, ast.keyword)
        and node.arg == "shell"
        and isinstance(node.value, ast.Constant)
        and node.value.value is True
    ]
    assert not shells


def test_no_file_is_called_utils():
    assert not [p for p in SOURCES if p.stem in {"utils", "helpers", "common", "misc"}]


def test_every_module_has_a_docstring():
    assert not [str(p.relative_to(ROOT)) for p in SOURCES if ast.get_docstring(parsed(p)) is None]
