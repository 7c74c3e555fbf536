"""Reads object file, rig file and earlier results, and plans the strikes with `analyze.planning`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analyze.errors import PlanError
from analyze.estimation.cells import cells_from_voxels, shell_thickness
from analyze.geometry.held_object import HeldObject
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.voxels import voxelise
from analyze.planning import view
from analyze.planning.earlier_results import EarlierResult, updated_hypothesis
from analyze.planning.examine import Bench
from analyze.planning.fillings import Pieces
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.paper_strikes import paper_strike_plan
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import PreparedObject, prepare_object
from analyze.planning.striker_update import updated_striker
from analyze.planning.tosses import plan_tosses, toss_notes, with_tosses
from analyze.progress import Progress, no_progress
from analyze.reading.object_file import ObjectFiles, read_object_files
from analyze.types import CameraModel
from analyze.verbs.plan.hub_clearance import note_on_hub
from analyze.verbs.plan.nominal_striker import prepared_for_mat, prepared_for_striker
from analyze.verbs.plan.phone import phone_bench
from analyze.verbs.plan.rig import PlannedRig, planned_rig, rig_from_text
from schemas.object_spec import ObjectSpec
from schemas.output_file import write_text
from schemas.session_manifest import RIG_ATTACHMENT
from schemas.strike_plan import TOSS_PLAN_VERSION, PlanMethod, StrikePlan
from schemas.wording import counted

CELLS = 800
"""number of voxels for the prediction of region masses"""
STRIKES = 9
"""default number of strikes"""
TOSSED_ALONE = "that gives the centre of mass and the ratios of the moments"
"""what tosses without strikes are good for, in words"""
SIZE_NOTE = (
    "without a strike the size of the tensor comes from the shape: where the object has an edge to tip over, "
    "one strike measures it (`--strikes 1`)"
)
"""note on a plan of tosses alone"""
STEPS = 7
"""steps of the progress bar; the last draws the cards"""


@dataclass(frozen=True)
class PlanOptions:
    """Options of `analyze plan`: rig file, strikes already made, and what is planned.

    What is planned is given by the number of strikes or the error to reach [mm], the method (by expected
    accuracy, or the paper's), the largest number of pivot edges, and whether strikes measure the table's tilt
    or test for contents that move.
    """

    rig_path: Path | None = None
    """rig file (with `camera_path` one of the table only); None for the rig of the latest recording in
    `given`, else the nominal rig"""
    strikes: int = STRIKES
    """number of strikes; with `given`, of additional strikes"""
    target_com_mm: float | None = None
    """rms error of the centre of mass to reach [mm], in place of a number of strikes; None if not set"""
    given: tuple[Path, ...] = ()
    """recordings and results of strikes already made"""
    method: PlanMethod = PlanMethod.OURS
    """way to choose the strikes: by their expected accuracy (OURS), or as in the paper (VISAPP 2013)"""
    gravity: bool = False
    """True to add a strike, turned by 180 degrees, which determines the table's tilt"""
    most_axes: int | None = None
    """largest number of different axes (pivot edges); None for no limit"""
    contents: bool = False
    """True to test whether something moves inside: three energies on one edge, and two faces"""
    camera_path: Path | None = None
    """camera file of a phone, for strikes by hand; None for a rig"""
    tosses: int = 0
    """number of tosses by hand after the strikes"""


@dataclass(frozen=True)
class PlannedObject:
    """A plan of strikes, with the object (shape, object file) and camera that it was made for."""

    plan: StrikePlan
    """the strikes, with their expected accuracy"""
    model: ObjectModel
    """exterior shape of the object"""
    spec: ObjectSpec
    """content of the object file"""
    camera: CameraModel
    """camera of the rig, with its pose"""


def plan_object(object_path: Path, options: PlanOptions, progress: Progress = no_progress) -> PlannedObject:
    """Plan the strikes for an object file; writes nothing.

    Args:
        object_path: the object file (TOML); its shape file is in the same folder.
        options: rig file, number of strikes, method and earlier results.
        progress: called with (text, done, total).

    Returns:
        The plan, with object and camera. Its warnings include a note on the rig, and one on the striker,
        where they were taken from recordings.

    Raises:
        ShapeError: the object file or its shape cannot be used.
        RecordingError, MergeError, TrackingError, EstimationError: the recordings given cannot be used.
        DocumentError, CalibrationError: a result or the camera file given cannot be used.
        PlanError: the rig file or a result cannot be used, a marker is not on the object's surface, or no set
            of strikes determines the centre of mass. In the last case its notes (`__notes__`) are the
            warnings about the shape.
    """
    progress("reading the files", 0, STEPS)
    rig, notes = _rig_of(options)
    files = read_object_files(object_path)
    progress("reading the shape", 1, STEPS)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    view.refuse_off_surface(model, files.spec)
    given, bench = None, rig.bench
    if options.camera_path is not None:
        if options.rig_path is not None and rig.devices:
            tables = " and ".join(f"[{name}]" for name in sorted(rig.devices))
            raise PlanError(
                f"{options.rig_path}: with --camera, for strikes by hand, a rig file states the table only "
                f"(table_friction, gravity): leave out {tables}, or --camera"
            )
        bench = phone_bench(options.camera_path, model, bench)
    if options.given:
        from analyze.result.given_results import read_given

        progress("reading the results so far", 2, STEPS)
        so_far = read_given(options.given, files.sha256, files.spec.mass_kg, rig.config)
        given = so_far.given
        if so_far.touches and options.camera_path is None and options.strikes != 0:
            bench = replace(bench, striker=updated_striker(bench.striker, so_far.touches))
            notes.append(_note_on_striker(bench.striker, len(so_far.touches)))
    if options.strikes == 0:
        plan = _tosses_alone(files, model, bench, options.tosses, notes, given)
        return PlannedObject(plan, model, files.spec, bench.camera)
    progress("examining the axes", 3, STEPS)
    try:
        prepared = prepare_object(model, files.spec, bench, rig.errors, given)
        if not options.given and options.camera_path is None and "striker" not in rig.devices:
            prepared, note = prepared_for_striker(
                prepared,
                lambda striker: prepare_object(
                    model, files.spec, replace(bench, striker=striker), rig.errors, given
                ),
            )
            notes += [note] if note else []
        if not options.given and options.rig_path is None and options.camera_path is None:
            prepared, note = prepared_for_mat(prepared)
            notes += [note] if note else []
        plan = _plan_of(prepared, files.sha256, options, progress)
        plan = with_tosses(plan, files.spec, model, prepared.believed, prepared.bench, options.tosses)
    except PlanError as error:
        whole = PlanError(f"{error}{_toss_remedy(files.spec, model, bench, options)}")
        for note in model.warnings:
            whole.add_note(note)
        raise whole from None
    notes += _notes_on(plan, model, rig)
    return PlannedObject(
        plan.model_copy(update={"warnings": [*plan.warnings, *notes]}), model, files.spec, bench.camera
    )


def _tosses_alone(
    files: ObjectFiles,
    model: ObjectModel,
    bench: Bench,
    count: int,
    notes: Sequence[str],
    given: EarlierResult | None,
) -> StrikePlan:
    """Plan of tosses without a strike, with `notes` for the user: no edge of the object is looked for.

    Beside the result `given` of strikes, which know the size of the inertia, SIZE_NOTE is left out.

    Raises:
        PlanError: no toss can be planned.
    """
    believed = hypothesis(model)
    if given is not None:
        believed = updated_hypothesis(believed, given)
    tosses = plan_tosses(files.spec, believed, bench, count)
    size = [] if given is not None and given.strikes else [SIZE_NOTE]
    return StrikePlan(
        schema_version=TOSS_PLAN_VERSION,
        object_name=files.spec.name,
        object_sha256=files.sha256,
        strikes=[],
        tosses=tosses,
        warnings=[*model.warnings, *toss_notes(tosses), *size, *notes],
    )


def _toss_remedy(spec: ObjectSpec, model: ObjectModel, bench: Bench, options: PlanOptions) -> str:
    """Text that offers tosses where strikes cannot be planned; "" if tosses cannot be planned either."""
    if options.given:
        return ""
    try:
        plan_tosses(spec, hypothesis(model), bench, 3)
    except PlanError:
        return ""
    return f"; or toss it (`--strikes 0 --tosses 3`): {TOSSED_ALONE}"


def _notes_on(plan: StrikePlan, model: ObjectModel, rig: PlannedRig) -> list[str]:
    """Notes on a fixture, and on strikes at which the arm's hub would touch the object."""
    notes = [_note_on_fixture(model.held)] if model.held is not None else []
    if rig.config is not None and "striker" in rig.devices:
        note = note_on_hub(plan.strikes, model.vertices, rig.config.striker.arm_length_m)
        notes += [note] if note else []
    return notes


def _plan_of(prepared: PreparedObject, sha256: str, options: PlanOptions, progress: Progress) -> StrikePlan:
    if options.method is PlanMethod.PAPER:
        return paper_strike_plan(prepared, sha256, options.strikes)
    progress("dividing the body into voxels", 4, STEPS)
    model, cells = prepared.model, None
    # Of an object that is refused no masses of regions are predicted.
    if model.held is None and np.isfinite(prepared.com_error):
        cells = _pieces(model, shell_thickness(prepared.spec, model))
    progress("choosing the strikes", 5, STEPS)
    target = None if options.target_com_mm is None else options.target_com_mm / 1000
    return plan_strikes(
        prepared,
        sha256,
        PlanRequest(
            options.strikes, target, options.gravity, options.most_axes, options.contents, options.tosses > 0
        ),
        cells,
    )


def _rig_of(options: PlanOptions) -> tuple[PlannedRig, list[str]]:
    """Rig to plan for: that of the rig file, else of the latest recording among the earlier results.

    Without either, or if that recording contains no rig file, it is the nominal rig.

    Returns:
        The rig, and the notes for the user: one if the rig is a recording's, otherwise none.
    """
    from analyze.result.given_results import RECORDING_SUFFIX

    recordings = [path for path in options.given if path.suffix == RECORDING_SUFFIX]
    if options.rig_path is None and recordings:
        from analyze.pipeline.merge import by_start_time
        from analyze.pipeline.read_evidence import read_head

        latest = by_start_time([read_head(path) for path in recordings])[-1]
        if latest.rig_toml is not None:
            note = f"planned for the rig of {latest.path}: for another rig give its file with --rig"
            return rig_from_text(latest.rig_toml, f"{latest.path}: {RIG_ATTACHMENT}"), [note]
    return planned_rig(options.rig_path), []


def _pieces(model: ObjectModel, wall: float) -> Pieces:
    """Body divided into about `CELLS` voxels, with a shell (outer wall) of thickness `wall` [m]."""
    cells = cells_from_voxels(voxelise(model, (model.volume / CELLS) ** (1 / 3), wall))
    return Pieces(cells.points, cells.shell, cells.interior, cells.own_inertia, cells.pitch)


def write_plan(plan: StrikePlan, path: Path) -> None:
    """Write a strike plan as JSON; the file appears complete or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, plan.model_dump_json(indent=1) + "\n")


def _note_on_fixture(held: HeldObject) -> str:
    """Note that the expected accuracy is that of object and fixture, of which the fixture is subtracted."""
    return (
        f"what is struck is object and fixture, {1000 * (held.mass + held.fixture_mass):.0f} g, of which"
        f" the fixture {1000 * held.fixture_mass:.0f} g: the expected accuracy is that of both together;"
        " `analyze estimate` subtracts the fixture, with its errors"
    )


def _note_on_striker(striker: StrikerModel, strikes: int) -> str:
    """Sentence: the plan's speeds are for the striker as estimated from `strikes` earlier strikes.

    It states the striker's effective mass [g] and restitution, each with its sd.
    """
    many = counted(strikes, "strike")
    mass, mass_sd = 1000 * striker.effective_mass_kg, 1000 * striker.effective_mass_sd_kg
    return (
        f"speeds are for the striker as estimated from {many}: effective mass {mass:.0f} ± {mass_sd:.0f} g, "
        f"restitution {striker.restitution:.2f} ± {striker.restitution_sd:.2f}"
    )
