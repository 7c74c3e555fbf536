"""`analyze plan`: object file (and rig file) in, plan out. The planning itself is pure and lives in planning/."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.object_files import object_files
from analyze.output_file import write_text
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import FRICTION, make_plan
from analyze.types import CameraModel
from schemas.documents import CameraCalibrationSpec, DocumentError, StrikePlan, validate


def plan_object(object_path: Path, rig_path: Path | None, strikes: int) -> StrikePlan:
    """Plan the strikes for an object file; `rig_path` gives the camera's pose and the striker, else nominal ones are taken.

    Raises:
        DocumentError, ShapeError: the object file or its shape cannot be used.
        PlanError: the rig file cannot be used, or no set of strikes determines the centre of mass.
    """
    files = object_files(object_path)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    rig = _rig(rig_path)
    plan = make_plan(model, files.spec, files.sha256, rig.striker, rig.camera, strikes, rig.friction)
    return plan.model_copy(update={"warnings": [*model.warnings, *plan.warnings]})


def write_plan(plan: StrikePlan, path: Path) -> None:
    """Write the plan whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, plan.model_dump_json(indent=1) + "\n")


def render_plan(plan: StrikePlan) -> None:
    """The plan as a table on the terminal."""
    console = Console()
    table = Table(title=f"{plan.object_name}: {len(plan.strikes)} strikes", title_justify="left")
    for heading in ("strike", "axis"):
        table.add_column(heading)
    for heading in ("tips at", "strike at height", "tip speed", "tag"):
        table.add_column(heading, justify="right")
    for strike in plan.strikes:
        table.add_row(
            strike.id,
            strike.axis_id,
            f"{np.degrees(strike.phi_predicted_rad):.1f}° ± {np.degrees(strike.phi_predicted_sd_rad):.1f}°",
            f"{1000 * strike.impact_height_m:.0f} mm",
            f"{strike.tip_speed_m_s.target:.2f} m/s",
            ", ".join(map(str, strike.visible_markers)),
        )
    console.print(table)
    if plan.predicted_com_sd_m is not None:
        console.print(f"predicted: centre of mass to ±{1000 * plan.predicted_com_sd_m:.2f} mm (1 sigma, worst direction)", highlight=False)
    for warning in plan.warnings:
        console.print(f"note: {warning}", highlight=False)
    if plan.rejected:
        console.print(f"{len(plan.rejected)} axes were considered and left out; the plan file says why", highlight=False)


@dataclass(frozen=True)
class _Rig:
    striker: StrikerModel
    camera: CameraModel | None
    friction: float


def _rig(path: Path | None) -> _Rig:
    """What planning needs of a rig file, which belongs to `acquire`: [camera.calibration], [striker], table_friction."""
    striker = StrikerModel()
    if path is None:
        return _Rig(striker, None, FRICTION)
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        calibration = validate(CameraCalibrationSpec, data["camera"]["calibration"], f"{path}: camera.calibration")
        given: dict[str, Any] = data.get("striker", {})
        striker = replace(
            striker,
            effective_mass_kg=_between(given, "effective_mass_kg", striker.effective_mass_kg, 0.0, 10.0),
            restitution=_between(given, "restitution", striker.restitution, 0.0, 1.0),
        )
        friction = _between(data, "table_friction", FRICTION, 0.0, 10.0)
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
        raise PlanError(f"{path}: cannot be used as a rig file: {error}: correct [striker] or table_friction") from None
    camera = CameraModel(
        calibration.width,
        calibration.height,
        np.array(calibration.K),
        np.array(calibration.distortion),
        np.array(calibration.T_world_camera),
    )
    return _Rig(striker, camera, friction)


def _between(section: dict[str, Any], key: str, otherwise: float, low: float, high: float) -> float:
    value = float(section.get(key, otherwise))
    if not low < value <= high:
        raise ValueError(f"{key} = {value:g} is not between {low:g} and {high:g}")
    return value
