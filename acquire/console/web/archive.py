"""Folder of recordings as a table, by opaque ids; results and reports come from `analyze`, and are kept.

Recordings are only read. Object, date and number of strikes are read from a file's head and its index;
results are those that the console had computed before, in the user's cache folder.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import re
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from acquire.console.web.listing import file_id
from acquire.console.web.orders import ArchiveEntry
from acquire.console.web.programs import Analyses
from acquire.console.web.refusal import Refusal
from schemas import topics
from schemas.mcap import records as container
from schemas.mcap.records import ContainerError
from schemas.mcap.summary import EndsEarly, find_summary, parse_message_counts
from schemas.mcap.walk import walk
from schemas.session_manifest import MANIFEST_NAME, SessionManifest

MAX_FILES: Final = 2000
"""recordings that are listed, the newest first"""
MAX_HEAD_RECORDS: Final = 64
"""records at the head of a file among which the manifest is looked for"""


@dataclass(frozen=True)
class _Head:
    """Contents of a recording without its images."""

    object: str
    date: str
    strikes: int | None
    complete: bool


class Archive:
    """Recordings in a folder; any thread may call its methods.

    Args:
        folder: folder of the recordings.
        analyses: runs the commands of `analyze`.
    """

    def __init__(self, folder: Path, analyses: Analyses) -> None:
        self._folder, self._analyses = folder, analyses
        self._heads: dict[tuple[Path, int, int], _Head] = {}
        self._lock = threading.Lock()
        self._results = _results_folder()

    def entries(self) -> list[ArchiveEntry]:
        """Recordings, the newest first."""
        with self._lock:
            return [self._entry(path) for path in self._paths()]

    def path(self, recording_id: str) -> Path:
        """Path of a recording that the table lists.

        Raises:
            Refusal: there is none with this id.
        """
        for path in self._paths():
            if file_id(path) == recording_id:
                return path
        raise Refusal(404, "Unknown", "there is no such recording", "reload the page")

    def finished(self, recording_id: str) -> Path:
        """Path of a recording that is complete.

        Raises:
            Refusal: there is none with this id, or it was cut short or is still being written.
        """
        path = self.path(recording_id)
        if path.suffix == ".part":
            message = "this recording was cut short, or is still being written"
            raise Refusal(409, "NotComplete", message, "`acquire recover FILE` rebuilds it")
        return path

    def new_path(self, name: str, object_name: str) -> Path:
        """Path of a new recording in the folder.

        Args:
            name: its name, with or without the suffix; empty for one from the object's name and the time.
            object_name: name of the object.

        Raises:
            Refusal: the name begins with a dot or is taken.
        """
        if not name:
            plain = re.sub(r"[^A-Za-z0-9_-]+", "-", object_name).strip("-_") or "object"
            name = f"{plain[:40]}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
        if name.startswith(".") or name.strip() != name:
            raise Refusal(422, "WrongName", "a recording's name begins and ends with a letter or digit")
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{name.removesuffix('.mcap')}.mcap"
        if path.exists() or Path(f"{path}.part").exists():
            raise Refusal(409, "NameTaken", f"a recording {path.name} exists already", "give another name")
        return path

    def note_earlier(self, path: Path, earlier: list[Path]) -> None:
        """Keep which recordings a session goes on with: they give one answer together.

        Args:
            path: recording that the session writes.
            earlier: the recordings that it goes on with.
        """
        self._results.mkdir(parents=True, exist_ok=True)
        _write(self._earlier_file(path), json.dumps([file_id(each) for each in earlier]))

    def all_before(self, recording_ids: list[str]) -> list[Path]:
        """Recordings with these ids, and those that they went on with.

        Raises:
            Refusal: one is missing, or not complete.
        """
        found: list[Path] = []
        for each in recording_ids:
            found += [path for path in self.together(self.finished(each)) if path not in found]
        return found

    def together(self, path: Path) -> list[Path]:
        """A recording and those that it went on with, as far as they are there, the first one first."""
        found: list[Path] = []
        wanted = [path]
        while wanted:
            each = wanted.pop()
            if each in found:
                continue
            found.append(each)
            with contextlib.suppress(OSError, ValueError, Refusal, TypeError):
                ids = json.loads(self._earlier_file(each).read_text(encoding="utf-8"))
                wanted += [self.finished(str(one)) for one in ids]
        return found[::-1]

    def _earlier_file(self, path: Path) -> Path:
        return self._results / f"{file_id(path)}-earlier.json"

    def estimate(self, recording_id: str) -> dict[str, Any]:
        """Estimate a recording with `analyze estimate`, keep the result and return it.

        Recordings that its session went on with are estimated with it. Another analysis is waited for.

        Raises:
            Refusal: there is no such recording, or it is not complete.
            AcquireError: another analysis runs, or this one failed.
        """
        path = self.finished(recording_id)
        result = json.loads(
            self._analyses.run("estimate", *map(str, self.together(path)), "--json", wait=True)
        )
        self._keep(path, result)
        return result

    def report(self, recording_id: str) -> Path:
        """Path of a recording's report, made with `analyze report` if none is kept; its result is kept, too.

        Raises:
            Refusal: there is no such recording, or it is not complete.
            AcquireError: another analysis runs, or this one failed.
        """
        path = self.finished(recording_id)
        page = self._kept(path, "html")
        if not page.exists():
            self._results.mkdir(parents=True, exist_ok=True)
            made = page.with_suffix(".new.html")
            made.unlink(missing_ok=True)
            files = map(str, self.together(path))
            content = json.loads(self._analyses.run("report", *files, "-o", str(made), "--json", wait=True))
            self._keep(path, content["result"])
            made.replace(page)
        return page

    def _paths(self) -> list[Path]:
        found: list[tuple[int, Path]] = []
        for pattern in ("*.mcap", "*.mcap.part"):
            for path in self._folder.glob(pattern):
                with contextlib.suppress(OSError):
                    if path.is_file():
                        found.append((path.stat().st_mtime_ns, path))
        return [path for _, path in sorted(found, reverse=True)[:MAX_FILES]]

    def _entry(self, path: Path) -> ArchiveEntry:
        status, head = path.stat(), self._head(path)
        result = self._result(path)
        com = (result or {}).get("centre_of_mass") or {}
        return ArchiveEntry(
            id=file_id(path),
            file=path.name,
            object=head.object,
            date=head.date,
            strikes=head.strikes,
            earlier_strikes=sum(self._head(each).strikes or 0 for each in self.together(path)[:-1]),
            com_mm=_millimetres(com.get("value")),
            com_sd_mm=_millimetres(com.get("sd")),
            flags=_flags(head, result),
            size_bytes=status.st_size,
            complete=head.complete,
        )

    def _head(self, path: Path) -> _Head:
        status = path.stat()
        mark = (path, status.st_mtime_ns, status.st_size)
        if (head := self._heads.get(mark)) is None:
            head = self._heads[mark] = _read_head(path)
        return head

    def _keep(self, path: Path, result: dict[str, Any]) -> None:
        self._results.mkdir(parents=True, exist_ok=True)
        _write(self._kept(path, "json"), json.dumps(result))

    def _kept(self, path: Path, suffix: str) -> Path:
        """Path of what is kept of a recording; another one if the recording has changed."""
        status = path.stat()
        return self._results / f"{file_id(path)}-{status.st_mtime_ns}-{status.st_size}.{suffix}"

    def _result(self, path: Path) -> dict[str, Any] | None:
        try:
            result = json.loads(self._kept(path, "json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return result if isinstance(result, dict) else None


def _results_folder() -> Path:
    """Folder for results and reports: as `analyze`'s cache; a temporary one if nothing is to be kept."""
    given = os.environ.get("PERCUSS_CACHE")
    if given == "":
        return Path(tempfile.mkdtemp(prefix="percuss-console-"))
    base = (
        Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "percuss"
    )
    return base / "console"


def _write(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    new = path.with_suffix(".new")
    new.write_text(text, encoding="utf-8")
    new.replace(path)


def _millimetres(values: Any) -> list[float] | None:
    if not isinstance(values, list) or len(values) != 3:
        return None
    return [round(1e3 * float(each), 3) for each in values]


def _flags(head: _Head, result: dict[str, Any] | None) -> list[str]:
    """Remarks on a recording, for the table."""
    flags = [] if head.complete else ["not complete"]
    if not head.object:
        flags.append("no recording of Percuss")
    verdict = (result or {}).get("verdict")
    if isinstance(verdict, list):
        flags += [str(line).partition(":")[0] for line in verdict if str(line).startswith("doubt")]
    return flags


def _read_head(path: Path) -> _Head:
    """Object, date and number of strikes of a recording; empty where the file does not state them."""
    manifest: SessionManifest | None = None
    strikes: int | None = None
    complete = False
    with (
        contextlib.suppress(OSError, ValueError, ContainerError, BufferError),
        path.open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped,
        memoryview(mapped) as data,
    ):
        manifest = _manifest(data)
        with contextlib.suppress(EndsEarly):
            strikes = _strikes(data)
            complete = path.suffix == ".mcap"
    if manifest is None:
        return _Head("", "", None, complete)
    return _Head(manifest.object.name, manifest.created, strikes, complete)


def _manifest(data: memoryview) -> SessionManifest | None:
    for number, (opcode, _, body) in enumerate(walk(data, len(container.MAGIC))):
        if number > MAX_HEAD_RECORDS:
            return None
        if opcode == container.METADATA:
            record = container.parse_metadata(body)
            if record.name == MANIFEST_NAME:
                try:
                    return SessionManifest.model_validate_json(record.entries.get("json", ""))
                except ValidationError:
                    return None
    return None


def _strikes(data: memoryview) -> int:
    """Number of strikes in a finished file.

    Raises:
        EndsEarly: the file is not finished.
        ContainerError: its index is damaged.
    """
    numbers: set[int] = set()
    counts: dict[int, int] = {}
    for opcode, body in _summary_records(data):
        if opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            if channel.topic == topics.SESSION_STRIKE.name:
                numbers.add(channel.id)
        elif opcode == container.STATISTICS:
            counts = dict(parse_message_counts(body))
    return sum(counts.get(number, 0) for number in numbers)


def _summary_records(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    for opcode, _, body in walk(find_summary(data).records):
        yield opcode, body
