"""Rewrites a recording for an object file that was edited after the strikes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import PlanError, RecordingError
from analyze.geometry.object_model import load_object_model
from analyze.geometry.surface_error import surface_sd
from analyze.pipeline.read_evidence import struck_object, with_marker_masses
from analyze.progress import Progress, no_progress
from analyze.reading.file_series import find_series_files, missing_files_text
from analyze.reading.indexed_file import IndexedFile, open_finished
from analyze.reading.object_file import ObjectFiles, read_object_files
from analyze.reading.recording import Recording, open_recording
from analyze.reading.recording_head import checked_manifest
from analyze.rebase.changes import Change, object_changes
from analyze.rebase.copy_file import Head, copy_with_head
from analyze.rebase.edge_shifts import EdgeShift, edge_shifts
from schemas.document import canonical_json, read_text, sha256_text
from schemas.mcap.records import AttachmentRecord
from schemas.object_spec import ObjectSpec
from schemas.output_file import OutputError
from schemas.session_manifest import (
    OBJECT_ATTACHMENT,
    PLAN_ATTACHMENT,
    SEAL_NAME,
    SHAPE_ATTACHMENT_PREFIX,
    RebaseEntry,
)
from schemas.software import software_version
from schemas.strike_plan import StrikePlan

KEPT_PREFIX = "rebase-"
"""beginning of the names of attachments that were replaced, before the number of the change"""


@dataclass(frozen=True)
class Rebase:
    """A recording and the object file that it is to have, with what differs and what the plan becomes."""

    recording: Path
    """the recording, any file of its series"""
    object_path: Path
    """the other object file"""
    files: ObjectFiles
    """the other object file and its shape"""
    object_text: str
    """text of the other object file"""
    plan: StrikePlan
    """the plan for the other object file: pivots, moments and hash follow it"""
    plan_text: str
    """the plan as it is attached: the recorded text where nothing of it changes"""
    changes: tuple[Change, ...]
    """entries in which the object files differ"""
    shifts: tuple[EdgeShift, ...]
    """displacement of each planned edge that was struck; empty if the shape is the same"""

    def refuse_moved_edges(self) -> None:
        """Check that every struck edge of the plan is still an edge of the shape, within the shapes' errors.

        Raises:
            PlanError: one is not; the worst is named with its displacement.
        """
        moved = [shift for shift in self.shifts if not shift.is_same_edge]
        if not moved:
            return
        # Rounded, so that of edges which moved alike the first is named on every machine.
        worst = max(moved, key=lambda shift: round(max(shift.shift_m / shift.allowed_m, shift.turn_rad), 6))
        more = f" (so do {len(moved) - 1} more)" if len(moved) > 1 else ""
        if worst.shift_m > worst.allowed_m:
            what = (
                f"lies {1000 * worst.shift_m:.2f} mm off the recorded shape's{more}, by its errors at most "
            )
            what += f"{1000 * worst.allowed_m:.2f} mm"
        else:
            degrees = 57.29578 * worst.turn_rad, 57.29578 * worst.allowed_rad
            what = (
                f"belongs to a resting face turned by {degrees[0]:.2f} deg{more}, by the shape's errors at "
            )
            what += f"most {degrees[1]:.2f} deg"
        raise PlanError(
            f"{self.object_path}: the edge of strike {worst.strike_id} ({worst.axis_id}) {what}: the strikes "
            "were made on other edges: give the object as it was struck, or plan and strike this one"
        )


def prepare_rebase(recording_path: Path, object_path: Path) -> Rebase:
    """Compare a recording's object file with another one, and bring its plan up to that one.

    Args:
        recording_path: a finished recording.
        object_path: the other object file, its shape file beside it.

    Raises:
        RecordingError: the recording cannot be read, or a file of its series is missing.
        ShapeError: the object's file or shape cannot be used.
        PlanError: the recording's plan is of another object, or its edges do not lie on the other shape.
    """
    files, text = read_object_files(object_path), read_text(object_path)
    with open_recording(recording_path) as recording:
        if recording.missing_parts:
            raise RecordingError(
                f"{recording_path}: {missing_files_text(recording.missing_parts)} missing: put all files "
                "into one folder"
            )
        before, shape_bytes = recording.object_spec, recording.shape_bytes
        names = _short_hash(shape_bytes), _short_hash(files.shape_bytes)
        changes = object_changes(before, files.spec, shape_differs=names[0] != names[1], shape_names=names)
        shifts = tuple(_edge_shifts(recording, files)) if any(change.of_shape for change in changes) else ()
        struck = struck_object(recording, object_path)
        plan, plan_text = recording.plan, recording.attachments[PLAN_ATTACHMENT].decode()
        if struck.sha256 != plan.object_sha256:
            plan = _plan_for(struck.plan, struck.sha256, before, files.spec)
            plan_text = canonical_json(plan)
        return Rebase(recording_path, object_path, files, text, plan, plan_text, tuple(changes), shifts)


def write_rebase(
    rebase: Rebase, output: Path, progress: Progress = no_progress, *, replace: bool = False
) -> tuple[Path, ...]:
    """Write a copy of the recording with the other object file; the recording itself is only read.

    Images and all other messages are copied byte for byte. What is replaced (object file, plan, shape) is
    attached to the copy too. Every file of a series is copied; all appear once they are complete.

    Args:
        rebase: recording and object file.
        output: path of the copy; further files of a series get its name with their numbers.
        progress: called with a text, the number of files copied and of all.
        replace: True to replace files that exist.

    Returns:
        Paths of the files written.

    Raises:
        PlanError: a struck edge of the plan is no edge of the other shape.
        RecordingError: the recording is damaged.
        OutputError: a file exists already, or cannot be written.
    """
    rebase.refuse_moved_edges()
    sources = find_series_files(rebase.recording).files
    outputs = output_paths(output, len(sources))
    parts = [path.with_name(f".{path.name}.{os.getpid()}.part") for path in outputs]
    try:
        for number, (source, part) in enumerate(zip(sources, parts, strict=True)):
            progress(f"copying {source.name}", number, len(sources))
            _write_file(rebase, source, part)
        if (taken := next((path for path in outputs if path.exists()), None)) is not None and not replace:
            raise OutputError(f"{taken}: was created meanwhile: choose another name")
        for path, part in reversed(list(zip(outputs, parts, strict=True))):
            part.replace(path)
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error.strerror}: choose another place") from None
    finally:
        for part in parts:
            with suppress(OSError):
                part.unlink()
    return outputs


def output_paths(output: Path, count: int) -> tuple[Path, ...]:
    """Paths of the files of a copy: the given one, then `NAME-0002.mcap` and so on."""
    further = (
        output.with_name(f"{output.stem}-{number:04d}{output.suffix}") for number in range(2, count + 1)
    )
    return (output, *further)


def _write_file(rebase: Rebase, source: Path, part: Path) -> None:
    """Copy one file of the recording to a new file, and force it to the disk.

    Raises:
        RecordingError: the file is damaged.
        OSError: the new file cannot be written.
    """
    file = open_finished(source)
    try:
        head = _head(rebase, file)
        fd = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        try:
            copy_with_head(file.data, source, head, fd)
            os.fsync(fd)
        finally:
            os.close(fd)
    finally:
        file.close()


def _head(rebase: Rebase, file: IndexedFile) -> Head:
    """Manifest and attachments of the copy of one file, with what they replace."""
    manifest = checked_manifest(file)
    seal = file.metadata.get(SEAL_NAME, {})
    entry = RebaseEntry(
        manifest_sha256=sha256_text(canonical_json(manifest)),
        content_id=seal.get("content_id"),
        object_sha256=manifest.object_sha256,
        plan_sha256=manifest.plan_sha256,
        software=software_version(),
        changed=[change.entry for change in rebase.changes],
    )
    if "manifest_sha256" in seal:
        entry = entry.model_copy(update={"manifest_sha256": seal["manifest_sha256"]})
    history = [*(manifest.rebased or []), entry]
    attachments = _attachments(rebase, list(file.attachments.values()), len(history))
    updated = manifest.model_copy(
        update={
            "object": rebase.files.spec,
            "object_sha256": rebase.files.sha256,
            "plan_sha256": sha256_text(rebase.plan_text),
            "hashes": {each.name: hashlib.sha256(each.data).hexdigest() for each in attachments},
            "rebased": history,
        }
    )
    return Head(canonical_json(updated), attachments)


def _attachments(rebase: Rebase, recorded: Sequence[AttachmentRecord], number: int) -> list[AttachmentRecord]:
    """Files attached to the copy: the recorded ones, those replaced under another name, and the new ones.

    Args:
        rebase: recording and object file.
        recorded: files attached to the recording.
        number: number of this change, from 1.
    """
    new = {
        OBJECT_ATTACHMENT: AttachmentRecord(
            OBJECT_ATTACHMENT, "application/toml", 0, rebase.object_text.encode()
        ),
        PLAN_ATTACHMENT: AttachmentRecord(PLAN_ATTACHMENT, "application/json", 0, rebase.plan_text.encode()),
    }
    shape = rebase.files.shape_bytes
    if shape is not None:
        name = SHAPE_ATTACHMENT_PREFIX + Path(rebase.files.shape_name).name
        new[name] = AttachmentRecord(name, "application/octet-stream", 0, shape)
    found: list[AttachmentRecord] = []
    for each in recorded:
        replaced = each.name in new or each.name.startswith(SHAPE_ATTACHMENT_PREFIX)
        if not replaced:
            found.append(each)
        elif each.name not in new or new[each.name].data != each.data:
            kept = f"{KEPT_PREFIX}{number}/{each.name}"
            found.append(AttachmentRecord(kept, each.media_type, each.log_time_ns, each.data))
    return [*new.values(), *found] if recorded else []


def _plan_for(plan: StrikePlan, sha256: str, before: ObjectSpec, after: ObjectSpec) -> StrikePlan:
    """The plan for another object file: its hash and name, and the predicted moments by the other mass."""
    ratio = with_marker_masses(after).mass_kg / with_marker_masses(before).mass_kg
    strikes = [
        strike.model_copy(update={"i_edge_predicted_kg_m2": strike.i_edge_predicted_kg_m2 * ratio})
        for strike in plan.strikes
    ]
    return plan.model_copy(
        update={
            "object_name": after.name,
            "object_sha256": sha256,
            "strikes": strikes if ratio != 1 else plan.strikes,
        }
    )


def _edge_shifts(recording: Recording, files: ObjectFiles) -> list[EdgeShift]:
    """Displacements of the edges that were struck, from the recorded shape to another one."""
    before = recording.object_spec
    shape_name = before.shape.file or str(recording.path)
    model = load_object_model(before, recording.shape_bytes, shape_name)
    other = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    struck = {record.plan_strike_id for record in recording.strikes}
    planned = [strike for strike in recording.plan.strikes if strike.id in struck]
    return edge_shifts(planned, model, other, surface_sd(files.spec.shape, other.noise_sd))


def _short_hash(data: bytes | None) -> str:
    return "-" if data is None else f"{len(data)} bytes, {hashlib.sha256(data).hexdigest()[:12]}"
