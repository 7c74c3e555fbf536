"""Input of an export, read from recordings or a result (JSON) with its object file, and its exported body."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.cache.results import ResultCache
from analyze.errors import ExportError
from analyze.export.body import ExportBody, inertial_of
from analyze.export.contact import export_contact
from analyze.export.formats import WITH_CONTACT, Format
from analyze.export.provenance import provenance
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.pipeline.estimate import EstimateOptions
from analyze.progress import Progress
from analyze.reading.object_file import read_object_files
from analyze.result.answer import Answer, answer_recordings
from analyze.result.given_results import read_result
from schemas.object_spec import ObjectSpec
from schemas.result import Result
from schemas.software import software_version

RESULT_SUFFIX = ".json"


@dataclass(frozen=True)
class ExportInput:
    """Result of an estimate, with the object that it belongs to."""

    result: Result
    """Result document of the estimate"""
    spec: ObjectSpec
    """object file: name, mass, markers"""
    model: ObjectModel
    """exterior of the object"""
    friction: float | None = None
    """coefficient of friction between table and object, as the rig file states it; None if it does not"""

    @classmethod
    def from_answer(cls, answer: Answer) -> ExportInput:
        """Input of an export from an answer that was estimated from recordings."""
        evidence = answer.estimate.evidence
        friction = stated_friction([head.rig_toml for head in evidence.recordings])
        return cls(answer.result, evidence.spec, evidence.model, friction)

    def body(self, wanted: Format, name: str) -> ExportBody:
        """Body to be written in the format `wanted`: shape, inertial parameters, and their origin.

        It has friction and restitution, measured or stated, if bodies of the format have them.

        Args:
            wanted: format of the file.
            name: name of the input, for messages.

        Raises:
            ExportError: the result has no complete, physically possible inertial parameters.
        """
        inertial = inertial_of(self.result, name)
        if wanted not in WITH_CONTACT:
            origin = provenance(self.result, self.spec.name, software_version())
            return ExportBody(self.spec.name, self.model.own, inertial, origin)
        contact = export_contact(self.result, self.friction)
        origin = provenance(self.result, self.spec.name, software_version(), contact.notes)
        return ExportBody(
            self.spec.name,
            self.model.own,
            inertial,
            origin,
            contact.friction,
            contact.restitution,
            contact.measured,
        )


def is_result(files: Sequence[Path]) -> bool:
    """True if `files` are one result (.json), False if they are recordings.

    Raises:
        ExportError: a result is given together with other files.
    """
    results = [file for file in files if file.suffix.lower() == RESULT_SUFFIX]
    if results and len(files) > 1:
        raise ExportError(
            f"{results[0]}: is a result, which must be the only file: give one result, or the recordings"
        )
    return bool(results)


def stated_friction(rigs: Sequence[str | None]) -> float | None:
    """Coefficient of friction between table and object, as the rig files of an object's sessions state it.

    The rig file states a lower bound (`table_friction`): of several, the greatest is returned. None if none
    states it.

    Args:
        rigs: texts of the rig files; None for a recording without one.
    """
    stated = []
    for rig in rigs:
        try:
            value = None if rig is None else tomllib.loads(rig).get("table_friction")
        except tomllib.TOMLDecodeError:
            continue
        if isinstance(value, int | float) and value > 0:
            stated.append(float(value))
    return max(stated, default=None)


def read_export_input(
    files: Sequence[Path],
    object_path: Path | None,
    exclude: frozenset[str],
    progress: Progress | None,
    cache: ResultCache | None = None,
) -> ExportInput:
    """Result and object of an export, from recordings or from a result file and an object file.

    Recordings are estimated first.

    Args:
        files: recordings (.mcap) of one object, or one result (.json).
        object_path: object file (TOML); it replaces that of recordings, and is required for a result. None
            for the recordings' own.
        exclude: ids of strikes to leave out of an estimate from recordings.
        progress: called with (text, strikes done, strikes in all) while recordings are estimated; None for
            silence.
        cache: cache of strikes read and estimates made before; None to compute all anew.

    Raises:
        ExportError: a result is given with other files, without its object file, with that of another
            object, or with strikes to leave out.
        RecordingError, MergeError, ShapeError, PlanError, TrackingError, EstimationError: the recordings or
            the object file cannot be read, merged, tracked or estimated.
        PlanError, DocumentError: the result cannot be read, or holds an entry that cannot be used.
    """
    if not is_result(files):
        answer = answer_recordings(files, EstimateOptions(object_path, exclude), progress, cache)
        return ExportInput.from_answer(answer)
    path = files[0]
    if object_path is None:
        raise ExportError(
            f"{path}: a result contains no shape: add --object OBJECT.toml, the file that it was estimated "
            "with"
        )
    if exclude:
        raise ExportError(
            f"{path}: --exclude does not apply to a result: use it with `analyze estimate`, or give the "
            "recording"
        )
    result, files_of_object = read_result(path), read_object_files(object_path)
    if files_of_object.sha256 != result.inputs.object_sha256:
        raise ExportError(
            f"{object_path}: is not the object of {path}, or has changed since: give the file that it was "
            "estimated with, or the recording"
        )
    model = load_object_model(files_of_object.spec, files_of_object.shape_bytes, files_of_object.shape_name)
    return ExportInput(result, files_of_object.spec, model)
