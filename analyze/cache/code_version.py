"""Version of the code that computes results: a hash of its source files and numerical libraries."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent.parent
_PACKAGES = ("analyze", "schemas")
WITHOUT_EFFECT = (
    "analyze/batch",
    "analyze/cards",
    "analyze/verbs",
    "analyze/replay",
    "analyze/reproduce",
    "analyze/report/templates",
)
"""folders of modules that request or show results, without effect on them"""
EXCEPTIONS = ("analyze/batch/analysis.py", "analyze/batch/sparse_copy.py", "analyze/batch/result_rows.py")
"""modules in the folders `WITHOUT_EFFECT` that nevertheless affect the results"""
LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "trimesh", "av", "laspy", "manifold3d")
"""libraries that compute results, or decode the images and shapes that these come from"""
PAGE_FOLDERS = ("analyze/cards", "analyze/report/templates")
"""folders without effect on results, but on the pages that show them"""
PAGE_SUFFIXES = (".py", ".html", ".css")
"""suffixes of the files in these folders that count"""
PAGE_LIBRARIES = ("matplotlib", "jinja2", "markupsafe")
"""libraries that draw plots and fill templates"""


@cache
def analysis_version() -> str:
    """Hash (16 hexadecimal digits) of the code and library versions that compute the results.

    Computed once per process, by `hash_of_code`.
    """
    return hash_of_code()


def hash_of_code() -> str:
    """Hash (16 hexadecimal digits) of source files and library versions as they are installed at present.

    Modules without effect on the results (commands, cards, replays) are left out.
    """
    files = [path for package in _PACKAGES for path in sorted((_ROOT / package).rglob("*.py"))]
    names = {path: path.relative_to(_ROOT).as_posix() for path in files}
    counted = [
        path for path in files if names[path] in EXCEPTIONS or not names[path].startswith(WITHOUT_EFFECT)
    ]
    return _hash_of(counted, LIBRARIES)


def hash_of_pages() -> str:
    """Hash (16 hexadecimal digits) of all that report pages depend on besides the code of results.

    They are the templates, the code that draws objects, and the libraries of plots and templates.
    """
    files = [path for folder in PAGE_FOLDERS for path in sorted((_ROOT / folder).rglob("*"))]
    return _hash_of([path for path in files if path.suffix in PAGE_SUFFIXES], PAGE_LIBRARIES)


def _hash_of(files: Iterable[Path], libraries: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(_ROOT).as_posix()}\n".encode() + path.read_bytes())
    for library in libraries:
        digest.update(f"{library} {_version_of(library)}\n".encode())
    return digest.hexdigest()[:16]


def _version_of(library: str) -> str:
    """Version of an installed library; "" if it is not installed under this name."""
    try:
        return version(library)
    except PackageNotFoundError:
        return ""
