"""`analyze plan`: object file, rig file and results so far in, plan out. The planning itself is pure and lives in planning/."""

from __future__ import annotations

import json
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
from analyze.object_files import object_files
from analyze.output_file import write_text
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.fillings import Pieces
from analyze.planning.given import Given, StrikeMade
from analyze.planning.impact import StrikerModel
from analyze.planning.information import Errors
from analyze.planning.paper_strikes import paper_strike_plan
from analyze.planning.plan import FRICTION, Request, finish, prepare
from analyze.types import CameraModel
from schemas.documents import CameraCalibrationSpec, DocumentError, ObjectSpec, PlanMethod, Result, StrikePlan, validate

CELLS = 800
"""pieces of the body for the prediction of region masses"""
STRIKES = 9
"""how many, if nobody says"""
MOST_STRIKES = 200

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class PlanOptions:
    """What the user asks for beside the object."""

    rig_path: Path | None = None
    strikes: int = STRIKES
    target_com_mm: float | None = None
    given_path: Path | None = None
    method: PlanMethod = PlanMethod.OURS


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
        RecordingError, EstimationError: of the recording given as result so far.
        PlanError: the rig file or the result so far cannot be used, or no set of strikes determines the centre of mass.
    """
    progress("reading the shape", 0, 4)
    files = object_files(object_path)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    rig = _rig(options.rig_path)
    given = None if options.given_path is None else _given(options.given_path, files.sha256, files.spec.mass_kg)
    progress("trying the axes", 1, 4)
    prepared = prepare(model, files.spec, Bench(rig.striker, rig.camera, rig.friction, rig.gravity), rig.errors, given)
    if options.method is PlanMethod.PAPER:
        return PlannedObject(paper_strike_plan(prepared, files.sha256, options.strikes), model, files.spec, rig.camera)
    progress("cutting the body into pieces", 2, 4)
    cells = _pieces(model, wall_thickness(files.spec, model))
    progress("choosing the strikes", 3, 4)
    target = None if options.target_com_mm is None else options.target_com_mm / 1000
    return PlannedObject(finish(prepared, files.sha256, Request(options.strikes, target), cells), model, files.spec, rig.camera)


def _pieces(model: ObjectModel, wall: float) -> Pieces:
    cells = cells_from_voxels(voxelise(model, (model.volume / CELLS) ** (1 / 3), wall))
    return Pieces(cells.points, cells.wall, cells.interior, cells.own, cells.pitch)


def write_plan(plan: StrikePlan, path: Path) -> None:
    """Write the plan whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, plan.model_dump_json(indent=1) + "\n")


def _given(path: Path, object_sha256: str, mass: float) -> Given:
    """A result so far: what `analyze estimate --json` printed, or a recording, which is then estimated."""
    if path.suffix == ".mcap":
        from analyze.pipeline import estimate_recording

        result = estimate_recording(path).result
    else:
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise PlanError(f"{path}: no such file: give a recording (.mcap) or what `analyze estimate --json` printed") from None
        except OSError as error:
            raise PlanError(f"{path}: cannot be read: {error.strerror}") from None
        except (ValueError, RecursionError):
            raise PlanError(f"{path}: is no result: give a recording (.mcap) or what `analyze estimate --json` printed") from None
        result = validate(Result, data, str(path))
    if result.inputs.object_sha256 != object_sha256:
        raise PlanError(f"{path}: is of another object, or of this one before its file was changed: give a result of this object file")
    return given_from_result(result, str(path), mass)


def given_from_result(result: Result, name: str, mass: float) -> Given:
    """What a Result says to the planner.

    Raises:
        PlanError: it holds no strike that was used, or no centre of mass.
    """
    com, inertia = result.centre_of_mass, result.inertia
    strikes = [
        StrikeMade(
            strike.axis_id,
            _single(strike.phi.sd, 1e-3),
            None if strike.k is None or strike.k.sd is None else _single(strike.k.sd, 0.0) / max(_single(strike.k.value, 1.0), 1e-9),
        )
        for strike in result.strikes
        if strike.used and strike.phi is not None
    ]
    if not strikes or com.value is None or com.covariance is None:
        raise PlanError(f"{name}: holds no strike that was used: plan from the first strike, without --given")
    unit_inertia = None if inertia.value is None else np.array(inertia.value, dtype=np.float64) / mass
    return Given(name, np.array(com.value, dtype=np.float64), np.array(com.covariance), unit_inertia, tuple(strikes), _directions(result))


def _directions(result: Result) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    return {moment.axis_id: np.array(moment.direction, dtype=np.float64) for moment in result.moments}


def _single(value: float | list[float] | list[list[float]] | None, otherwise: float) -> float:
    return value if isinstance(value, float | int) else otherwise


@dataclass(frozen=True)
class _Rig:
    striker: StrikerModel
    camera: CameraModel
    friction: float
    gravity: float
    errors: Errors


def _rig(path: Path | None) -> _Rig:
    """What planning needs of a rig file, which belongs to `acquire`: camera, striker, table_friction, gravity and its tilt."""
    striker, errors = StrikerModel(), Errors()
    if path is None:
        return _Rig(striker, view.default_camera(), FRICTION, 9.81, errors)
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        calibration = validate(CameraCalibrationSpec, data["camera"]["calibration"], f"{path}: camera.calibration")
        given: dict[str, Any] = data.get("striker", {})
        fastest = striker.fastest_m_s
        if "velocity_limit_rad_s" in given and "arm_length_m" in given:
            fastest = _between(given, "velocity_limit_rad_s", 8.0, 0.0, 100.0) * _between(given, "arm_length_m", 0.12, 0.0, 2.0)
        striker = replace(
            striker,
            effective_mass_kg=_between(given, "effective_mass_kg", striker.effective_mass_kg, 0.0, 10.0),
            restitution=_between(given, "restitution", striker.restitution, -1e-12, 1.0),
            effective_mass_sd_kg=max(_between(given, "effective_mass_sd_kg", striker.effective_mass_sd_kg, -1e-12, 10.0), 1e-4),
            restitution_sd=max(_between(given, "restitution_sd", striker.restitution_sd, -1e-12, 1.0), 1e-3),
            fastest_m_s=fastest,
            **_reach(given),
        )
        friction = _between(data, "table_friction", FRICTION, 0.0, 10.0)
        gravity = _between(data, "g_m_s2", 9.81, 9.7, 9.9)
        tilt = _between(data, "gravity_tilt_sd_rad", errors.tilt, -1e-12, 1.0)
        gravity_sd = _between(data, "g_sd_m_s2", errors.gravity * gravity, -1e-12, 1.0)
        errors = replace(errors, tilt=max(tilt, 1e-6), gravity=max(gravity_sd / gravity, 1e-7))
    except FileNotFoundError:
        raise PlanError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise PlanError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PlanError(f"{path}: not valid TOML: {error}") from None
    except KeyError:
        raise PlanError(f"{path}: cannot be used as a rig file: it has no section [camera.calibration]") from None
    except DocumentError as error:
        raise PlanError(str(error)) from None
    except (TypeError, ValueError, AttributeError) as error:
        raise PlanError(f"{path}: cannot be used as a rig file: {error}: correct [striker], table_friction or gravity") from None
    camera = CameraModel(
        calibration.width,
        calibration.height,
        np.array(calibration.K),
        np.array(calibration.distortion),
        np.array(calibration.T_world_camera),
    )
    return _Rig(striker, camera, friction, gravity, errors)


def _reach(section: dict[str, Any]) -> dict[str, float]:
    """Heights [m] over the table that the striker's tip can be set to."""
    if "reach_m" not in section:
        return {}
    low, high = (float(value) for value in section["reach_m"])
    if not 0 < low < high < 2:
        raise ValueError(f"reach_m = [{low:g}, {high:g}] is not two rising heights in metres")
    return {"lowest_m": low, "highest_m": high}


def _between(section: dict[str, Any], key: str, otherwise: float, low: float, high: float) -> float:
    value = float(section.get(key, otherwise))
    if not low < value <= high:
        raise ValueError(f"{key} = {value:g} is not between {low:g} and {high:g}")
    return value
