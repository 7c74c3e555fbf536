"""Objects and plans in a folder, by opaque ids: a browser never names a path."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from acquire.console.web.refusal import Refusal
from acquire.console.web.snapshot import Choices, ObjectChoice, PlanChoice
from schemas.document import DocumentError
from schemas.object_spec import object_sha256, read_object_spec
from schemas.strike_plan import read_strike_plan

MAX_FILES: Final = 500
"""files of each kind that are looked at"""
MAX_BYTES: Final = 64 << 20
"""size from which on a file is not looked at [bytes]"""


def file_id(path: Path) -> str:
    """Opaque id of a file: 16 hexadecimal digits that depend on its absolute path."""
    return hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class _Found:
    """One object or plan file."""

    path: Path
    name: str
    digest: str
    """hash of the object, by which plans name it"""
    strikes: int = 0


class Listing:
    """Object files and plans in a folder and its subfolders, read again when a file has changed.

    Args:
        folder: folder of the objects.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[Path, tuple[tuple[int, int, int], _Found | None]] = {}
        self._objects: dict[str, _Found] = {}
        self._plans: dict[str, _Found] = {}
        self.choices = Choices(objects=[], plans=[])
        """objects, and the plans that fit them"""

    def refresh(self) -> None:
        """Look at the folder again."""
        objects = {file_id(found.path): found for found in self._files("*.toml")}
        by_digest = {found.digest: each for each, found in objects.items()}
        plans = {file_id(found.path): found for found in self._files("*.json") if found.digest in by_digest}
        self._objects, self._plans = objects, plans
        self.choices = Choices(
            objects=[
                ObjectChoice(id=each, name=found.name, file=self._shown(found.path))
                for each, found in objects.items()
            ],
            plans=[
                PlanChoice(
                    id=each,
                    object_id=by_digest[found.digest],
                    name=self._shown(found.path),
                    strikes=found.strikes,
                )
                for each, found in plans.items()
            ],
        )

    def paths(self, object_id: str, plan_id: str) -> tuple[Path, Path, str]:
        """Paths of an object file and of a plan that fits it, and the object's name.

        Raises:
            Refusal: the list has no such object or plan, or they do not belong together.
        """
        thing, plan = self._objects.get(object_id), self._plans.get(plan_id)
        if thing is None or plan is None:
            raise Refusal(404, "Unknown", "there is no such object or plan", "reload the page")
        if thing.digest != plan.digest:
            raise Refusal(409, "WrongPlan", "this plan is for another object", "choose a plan of this object")
        return thing.path, plan.path, thing.name

    def _shown(self, path: Path) -> str:
        return path.relative_to(self._folder).as_posix()

    def _files(self, pattern: str) -> Iterator[_Found]:
        paths = sorted({*self._folder.glob(pattern), *self._folder.glob(f"*/{pattern}")})
        for path in paths[:MAX_FILES]:
            try:
                status = path.stat()
            except OSError:
                continue
            if not path.is_file() or status.st_size > MAX_BYTES:
                continue
            shape_ns = 0 if pattern != "*.toml" else self._shape_ns(path)
            mark = (status.st_mtime_ns, status.st_size, shape_ns)
            if path not in self._known or self._known[path][0] != mark:
                self._known[path] = (mark, _read(path))
            if (found := self._known[path][1]) is not None:
                yield found

    def _shape_ns(self, path: Path) -> int:
        """Time of the last change beside an object file [ns]: its shape file may be another one now."""
        try:
            return path.parent.stat().st_mtime_ns
        except OSError:
            return 0


def _read(path: Path) -> _Found | None:
    """Object or plan in a file; None if it holds neither."""
    try:
        if path.suffix == ".json":
            plan = read_strike_plan(path)
            return _Found(path, path.stem, plan.object_sha256, len(plan.strikes))
        spec = read_object_spec(path)
        shape = None if spec.shape.file is None else (path.parent / spec.shape.file).read_bytes()
        return _Found(path, spec.name, object_sha256(spec, shape))
    except (DocumentError, OSError, ValueError, RecursionError):
        return None
