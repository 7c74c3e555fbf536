"""The house rules that a parser can check: who may import what. Each failure names file and line."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("acquire", "analyze", "schemas")
SOURCES = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py") if "_pb2" not in p.name)

OWNERS = {
    "gi": {"acquire/camera/aravis.py"},
    "dynamixel_sdk": {"acquire/striker/"},
    "serial": {"acquire/striker/"},
    "rerun": {"analyze/replay"},
    "trimesh": {"analyze/geometry/object_model.py"},
    "mcap": {"acquire/recorder/", "analyze/recording.py"},
    "mujoco": {"acquire/virtual/"},
}
PURE = ("analyze/geometry", "analyze/planning", "analyze/tracking", "analyze/motion", "analyze/estimation")
PURE_FORBIDDEN = {"time", "datetime", "socket", "subprocess", "random", "os", "logging", "mcap", "rerun", "matplotlib", "requests"}
CV2_ALLOWED = (
    "analyze/tracking",
    "analyze/geometry",
    "analyze/image_message.py",
    "analyze/replay",
    "analyze/watch.py",
    "analyze/results",
    "acquire/",
)
VIRTUAL_USERS = ("acquire/virtual/", "acquire/demo.py")


def _imports(path: Path) -> list[tuple[int, str]]:
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.append((node.lineno, node.module))
    return found


def _violations(rule) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{line}: imports {module}"
        for path in SOURCES
        for line, module in _imports(path)
        if rule(path.relative_to(ROOT).as_posix(), module)
    ]


def _top(module: str) -> str:
    return module.partition(".")[0]


def test_schemas_imports_nothing_of_ours():
    assert not _violations(lambda path, module: path.startswith("schemas/") and _top(module) in {"acquire", "analyze"})


def test_the_two_packages_never_import_each_other():
    assert not _violations(lambda path, module: path.startswith("acquire/") and _top(module) == "analyze")
    assert not _violations(lambda path, module: path.startswith("analyze/") and _top(module) == "acquire")


def test_nothing_imports_tests():
    assert not _violations(lambda path, module: _top(module) == "tests")


@pytest.mark.parametrize("module", sorted(OWNERS))
def test_a_library_has_its_owner(module):
    owners = OWNERS[module]
    assert not _violations(lambda path, name: _top(name) == module and not any(path.startswith(owner) for owner in owners))


def test_production_code_does_not_know_the_virtual_rig():
    def rule(path, module):
        return module.startswith("acquire.virtual") and not path.startswith(VIRTUAL_USERS)

    assert not _violations(rule)


def test_the_estimators_are_pure():
    assert not _violations(lambda path, module: path.startswith(PURE) and _top(module) in PURE_FORBIDDEN)


def test_only_named_modules_use_opencv():
    assert not _violations(lambda path, module: _top(module) == "cv2" and not path.startswith(CV2_ALLOWED))


def test_pickle_and_shells_are_not_used():
    assert not _violations(lambda path, module: _top(module) in {"pickle", "shelve", "marshal", "dill"})
    shells = [
        f"{path.relative_to(ROOT)}:{node.lineno}: shell=True"
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.keyword) and node.arg == "shell" and isinstance(node.value, ast.Constant) and node.value.value is True
    ]
    assert not shells


def test_no_file_is_called_utils():
    assert not [p for p in SOURCES if p.stem in {"utils", "helpers", "common", "misc"}]


def test_every_module_says_what_it_is():
    assert not [str(p.relative_to(ROOT)) for p in SOURCES if ast.get_docstring(ast.parse(p.read_text(encoding="utf-8"))) is None]
