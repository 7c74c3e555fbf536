"""Parses the manifest and the plan of a recording, and finds the object's shape among its attachments.

Only documents of this program's major schema version are accepted. `checked_manifest` also compares a file's
manifest and attachments with the hashes that the file states.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from analyze.errors import RecordingError, RecordingForeign, RecordingVersion
from analyze.reading.indexed_file import IndexedFile
from schemas.document import SCHEMA_VERSION, DocumentError, sha256_text, validate
from schemas.session_manifest import (
    MANIFEST_NAME,
    SEAL_NAME,
    SHAPE_ATTACHMENT_PREFIX,
    SessionManifest,
    stated_manifest_hashes,
)
from schemas.strike_plan import StrikePlan

T = TypeVar("T", bound=BaseModel)


def checked_manifest(file: IndexedFile) -> SessionManifest:
    """Manifest (description of the session) of a file, checked against the hashes that the file states.

    Raises:
        RecordingForeign: the file has no manifest.
        RecordingVersion: the manifest has another major schema version.
        RecordingError: the manifest cannot be read, or it or an attachment differs from its stated hash.
    """
    entries = file.metadata.get(MANIFEST_NAME)
    if entries is None or "json" not in entries:
        raise RecordingForeign(
            f"{file.path}: holds no Percuss manifest: it was not recorded by `acquire`, or ends before its "
            "manifest"
        )
    manifest = whole_manifest(entries, str(file.path), file.metadata.get(SEAL_NAME, {}))
    for name, expected in manifest.hashes.items():
        attachment = file.attachments.get(name)
        if attachment is not None and hashlib.sha256(attachment.data).hexdigest() != expected:
            raise RecordingError(
                f"{file.path}: damaged: attachment {name!r} is not the one that was recorded: restore the "
                "file from a copy"
            )
    return manifest


def whole_manifest(entries: Mapping[str, str], name: str, seal: Mapping[str, str]) -> SessionManifest:
    """Manifest (description of the session) in a metadata record, checked against its stated hashes.

    Unknown keys of newer minor schema versions are ignored.

    Args:
        entries: entries of the metadata record.
        name: name of the recording, for error messages.
        seal: entries of the file's seal; empty if it has none yet.

    Raises:
        RecordingVersion: the manifest has another major schema version.
        RecordingError: the text is not a manifest, or not the one that was recorded.
    """
    text = entries.get("json", "")
    if stated_manifest_hashes(entries, seal) - {sha256_text(text)}:
        raise RecordingError(
            f"{name}: damaged: the manifest is not the one that was recorded: restore it from a copy"
        )
    return _parse(SessionManifest, text, name, "manifest")


def parse_plan(text: str, name: str) -> StrikePlan:
    """Parse the JSON text of the strike plan that is attached to a recording; return the plan.

    Unknown keys of newer minor schema versions are ignored.

    Args:
        text: plan as JSON.
        name: name of the recording, for error messages.

    Raises:
        RecordingVersion: the plan has another major schema version.
        RecordingError: the text is not a plan.
    """
    return _parse(StrikePlan, text, name, "plan")


def shape_attachment(attachments: Mapping[str, bytes]) -> bytes | None:
    """Content of the object's shape file among a recording's attached files.

    None if none is attached, as for a primitive (box, cylinder).

    Args:
        attachments: contents of a recording's attached files, by name.
    """
    return next(
        (data for name, data in attachments.items() if name.startswith(SHAPE_ATTACHMENT_PREFIX)), None
    )


def _parse(model: type[T], text: str, name: str, kind: str) -> T:
    try:
        data = json.loads(text)
        major, minor = (int(part) for part in data["schema_version"].split("."))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RecordingError(
            f"{name}: its {kind} cannot be read: damaged, or not written by `acquire`"
        ) from None
    ours, our_minor = (int(part) for part in SCHEMA_VERSION.split("."))
    if major != ours:
        raise RecordingVersion(
            f"{name}: has schema version {major}.{minor}, this program reads {ours}.x: use a version of "
            f"Percuss that writes {major}.x"
        )
    if minor > our_minor:
        data = _without_unknown(model, data)
    try:
        return validate(model, data, f"{name}: {kind}")
    except DocumentError as error:
        raise RecordingError(str(error)) from None


def _without_unknown(model: type[BaseModel], data: Any) -> Any:
    """Remove keys that `model` does not know from the parsed JSON `data`, in place, and return `data`.

    A newer minor version may add keys; by definition a reader may ignore them.
    """
    try:
        model.model_validate(data)
    except ValidationError as error:
        for problem in error.errors():
            if problem["type"] == "extra_forbidden":
                _remove(data, problem["loc"])
    return data


def _remove(data: Any, path: tuple[int | str, ...]) -> None:
    for part in path[:-1]:
        data = data[part]
    del data[path[-1]]
