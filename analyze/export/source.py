"""Where a body to export comes from: recordings, estimated now, or what `analyze estimate --json` printed with the object's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ExportError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.pipeline.estimate import EstimateOptions
from analyze.result.answer import answer_recordings
from analyze.pipeline.evidence import Progress
from analyze.result.given_results import read_result
from analyze.reading.object_file import read_object_files
from schemas.object_spec import ObjectSpec
from schemas.result import Result

RESULT_SUFFIX = ".json"


@dataclass(frozen=True)
class Source:
    """A result, and the object that it is of."""

    result: Result
    spec: ObjectSpec
    model: ObjectModel


def is_result(files: Sequence[Path]) -> bool:
    """Whether `files` are one result instead of recordings.

    Raises:
        ExportError: results among several files.
    """
    results = [file for file in files if file.suffix.lower() == RESULT_SUFFIX]
    if results and len(files) > 1:
        raise ExportError(
            f"{results[0]}: is a result, which stands alone: give one result, or the recordings"
        )
    return bool(results)


def read_source(
    files: Sequence[Path], object_path: Path | None, exclude: frozenset[str], progress: Progress | None
) -> Source:
    """Estimate, or read what was estimated.

    Raises:
        AnalyzeError: as `estimate_recordings`.
        ExportError: a result without its object file, with that of another, or with strikes to leave out.
    """
    if not is_result(files):
        answer = answer_recordings(files, EstimateOptions(object_path, exclude), progress)
        evidence = answer.estimate.evidence
        return Source(answer.result, evidence.spec, evidence.model)
    path = files[0]
    if object_path is None:
        raise ExportError(
            f"{path}: a result holds no shape: add --object OBJECT.toml, the file that it was estimated with"
        )
    if exclude:
        raise ExportError(
            f"{path}: is estimated already: leave strikes out with `analyze estimate --exclude`, or give the recording"
        )
    result, files_of_object = read_result(path), read_object_files(object_path)
    if files_of_object.sha256 != result.inputs.object_sha256:
        raise ExportError(
            f"{object_path}: is not the object that {path} is of, or was changed since: give the file that it was estimated with, "
            "or give the recording"
        )
    model = load_object_model(files_of_object.spec, files_of_object.shape_bytes, files_of_object.shape_name)
    return Source(result, files_of_object.spec, model)
