"""`analyze plan`: object file, rig file and results so far in, plan out. The planning itself is pure and lives in planning/."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from analyze.errors import PlanError
from analyze.estimation.cells import cells_from_voxels, wall_thickness
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.voxels import voxelise
from analyze.output_file import write_text
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.fillings import Pieces
from analyze.planning.given import Given
from analyze.planning.impact import StrikerModel
from analyze.planning.information import Errors
from analyze.planning.paper_strikes import paper_strike_plan
from analyze.planning.plan import FRICTION, Request, finish, prepare
from analyze.planning.striker_taught import taught
from analyze.reading.object_file import ObjectFiles, object_files
from analyze.types import CameraModel
from schemas.document import DocumentError, validate
from schemas.object_spec import ObjectSpec
from schemas.rig import RigConfig, StrikerConfig
from schemas.session_manifest import RIG_ATTACHMENT
from schemas.strike_plan import PlanMethod, StrikePlan

RECORDING_SUFFIX = ".mcap"
CELLS = 800
"""pieces of the body for the prediction of region masses"""
STRIKES = 9
"""how many, if nobody says"""
MOST_STRIKES = 200
STEPS = 7
"""that the progress bar counts; the last draws the cards"""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class PlanOptions:
    """What the user asks for beside the object."""

    rig_path: Path | None = None
    strikes: int = STRIKES
    target_com_mm: float | None = None
    given: tuple[Path, ...] = ()
    """recordings and results so far"""
    method: PlanMethod = PlanMethod.OURS
    gravity: bool = False
    """one strike more, turned by 180 degrees: it tells the table's tilt"""
    most_axes: int | None = None
    """at most so many different axes"""


@dataclass(frozen=True)
class PlannedObject:
    """A plan, and what it is of: the cards show both."""

    plan: StrikePlan
    model: ObjectModel
    spec: ObjectSpec
    camera: CameraModel


def plan_object(object_path: Path, options: PlanOptions, progress: Progress = lambda _text, _done, _total: None) -> PlannedObject:
    """Plan the strikes for an object file.

    Raises:
        DocumentError, ShapeError: the object file or its shape cannot be used.
        RecordingError, JoinError, EstimationError: of the recordings given as results so far.
        PlanError: the rig file or the result so far cannot be used, or no set of strikes determines the centre of mass; what was noted of
            the shape goes with it (`__notes__`).
    """
    progress("reading the files", 0, STEPS)
    rig, notes = _rig_of(options)
    files = object_files(object_path)
    progress("making a body of the shape", 1, STEPS)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    view.refuse_off_surface(model, files.spec)
    given, bench = None, rig.bench
    if options.given:
        from analyze.pipeline.given_results import read_given

        progress("reading the results so far", 2, STEPS)
        so_far = read_given(options.given, files.sha256, files.spec.mass_kg, rig.config)
        given = so_far.given
        if so_far.touches:
            bench = replace(bench, striker=taught(bench.striker, so_far.touches))
            notes.append(_note_on_striker(bench.striker, len(so_far.touches)))
    try:
        plan = _plan_of(files, model, bench, rig.errors, given, options, progress)
    except PlanError as error:
        for note in model.warnings:
            error.add_note(note)
        raise
    return PlannedObject(plan.model_copy(update={"warnings": [*plan.warnings, *notes]}), model, files.spec, bench.camera)


def _plan_of(
    files: ObjectFiles, model: ObjectModel, bench: Bench, errors: Errors, given: Given | None, options: PlanOptions, progress: Progress
) -> StrikePlan:
    progress("trying the axes", 3, STEPS)
    prepared = prepare(model, files.spec, bench, errors, given)
    if options.method is PlanMethod.PAPER:
        return paper_strike_plan(prepared, files.sha256, options.strikes)
    progress("cutting the body into pieces", 4, STEPS)
    cells = _pieces(model, wall_thickness(files.spec, model))
    progress("choosing the strikes", 5, STEPS)
    target = None if options.target_com_mm is None else options.target_com_mm / 1000
    return finish(prepared, files.sha256, Request(options.strikes, target, options.gravity, options.most_axes), cells)


def _rig_of(options: PlanOptions) -> tuple[PlannedRig, list[str]]:
    """The rig named; else that of the latest recording given, which is noted; else the nominal one."""
    recordings = [path for path in options.given if path.suffix == RECORDING_SUFFIX]
    if options.rig_path is None and recordings:
        from analyze.pipeline.evidence import read_head  # takes what estimates need, which other plans do not
        from analyze.pipeline.merge import in_order

        latest = in_order([read_head(path) for path in recordings])[-1]
        if latest.rig_toml is not None:
            note = f"planned for the rig of {latest.path}: for another, give its file with --rig"
            return rig_from_text(latest.rig_toml, f"{latest.path}: {RIG_ATTACHMENT}"), [note]
    return planned_rig(options.rig_path), []


def _pieces(model: ObjectModel, wall: float) -> Pieces:
    cells = cells_from_voxels(voxelise(model, (model.volume / CELLS) ** (1 / 3), wall))
    return Pieces(cells.points, cells.wall, cells.interior, cells.own, cells.pitch)


def write_plan(plan: StrikePlan, path: Path) -> None:
    """Write the plan whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, plan.model_dump_json(indent=1) + "\n")


def _note_on_striker(striker: StrikerModel, strikes: int) -> str:
    many = "1 strike" if strikes == 1 else f"{strikes} strikes"
    mass, mass_sd = 1000 * striker.effective_mass_kg, 1000 * striker.effective_mass_sd_kg
    return (
        f"speeds are for the striker as {many} so far showed it: effective mass {mass:.0f} ± {mass_sd:.0f} g, "
        f"restitution {striker.restitution:.2f} ± {striker.restitution_sd:.2f}"
    )


@dataclass(frozen=True)
class PlannedRig:
    """What planning takes from a rig file."""

    bench: Bench
    errors: Errors
    config: RigConfig | None = None
    """the file's content"""


def planned_rig(path: Path | None) -> PlannedRig:
    """The rig of a rig file; without one, the nominal rig.

    Raises:
        PlanError: as `rig_from_text`, or the file cannot be read.
    """
    if path is None:
        return PlannedRig(Bench(StrikerModel(), view.default_camera(), FRICTION), Errors())
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise PlanError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise PlanError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise PlanError(f"{path}: not valid TOML: {error}") from None
    return rig_from_text(text, str(path))


def rig_from_text(text: str, name: str) -> PlannedRig:
    """A rig file's content, which holds for planning as it does for `acquire`.

    Only the camera's address may be missing: nobody is asked anything.

    Raises:
        PlanError: `acquire` would refuse it, or its striker can swing at no speed at all; it begins with `name`.
    """
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # not TOML, nested too deep
        raise PlanError(f"{name}: not valid TOML: {error}") from None
    camera = data.get("camera")
    if isinstance(camera, dict):
        camera.setdefault("address", "none")
    try:
        rig = validate(RigConfig, data, name)
    except DocumentError as error:
        raise PlanError(str(error)) from None
    striker = striker_model(rig.striker)
    if striker.slowest_m_s > striker.fastest_m_s:
        raise PlanError(
            f"{name}: its striker can swing at no speed: {striker.slowest_m_s:.3g} m/s is its least, {striker.fastest_m_s:.3g} m/s all "
            "that velocity_limit_rad_s and cocked_angle_rad leave: raise them"
        )
    seen = rig.camera.calibration
    lens = CameraModel(seen.width, seen.height, np.array(seen.K), np.array(seen.distortion), np.array(seen.T_world_camera), seen.model)
    tilt = rig.gravity_tilt_sd_rad if rig.level is None else rig.level.towards_x_sd_rad
    errors = Errors(tilt=max(tilt, 1e-6), gravity=max(rig.g_sd_m_s2 / rig.g_m_s2, 1e-7))
    return PlannedRig(Bench(striker, lens, rig.table_friction, rig.g_m_s2, rig.camera.frame_rate_hz), errors, rig)


def striker_model(striker: StrikerConfig) -> StrikerModel:
    """The striker of a rig file as plans reckon with it; an sd of 0 is none."""
    speeds = striker.tip_speeds()
    lowest, highest = striker.reach_m
    return StrikerModel(
        effective_mass_kg=striker.effective_mass_kg,
        restitution=striker.restitution,
        effective_mass_sd_kg=max(striker.effective_mass_sd_kg, 1e-4),
        restitution_sd=max(striker.restitution_sd, 1e-3),
        slowest_m_s=speeds.slowest_m_s,
        fastest_m_s=speeds.fastest_m_s,
        lowest_m=lowest,
        highest_m=highest,
    )
