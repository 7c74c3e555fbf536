"""The rig that a plan is made for: camera, striker, friction and gravity of a rig file, or nominal ones."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from analyze.errors import PlanError
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.information import SharedErrors
from analyze.planning.prepared import FRICTION
from analyze.tracking.camera_model import camera_from_spec
from schemas.document import DocumentError, validate
from schemas.input_file import read_text
from schemas.rig import RigConfig, StrikerConfig
from schemas.servo_models import UNMEASURED_MASS_SD_KG


@dataclass(frozen=True)
class PlannedRig:
    """Camera, striker, friction and gravity that a plan assumes, with the standard deviations of errors."""

    bench: Bench
    """striker, camera, friction coefficient, gravity and frame rate"""
    errors: SharedErrors
    """standard deviations of the errors that strikes share: tilt, gravity and others"""
    config: RigConfig | None = None
    """content of the rig file; None for the nominal rig"""
    devices: frozenset[str] = frozenset()
    """those of "camera" and "striker" that the rig file states; the others are nominal"""


def planned_rig(path: Path | None) -> PlannedRig:
    """Rig of a rig file; the nominal rig if `path` is None.

    Returns:
        Striker, camera, friction, gravity and frame rate, with the standard deviations of the errors that all
        strikes share (such as the table's tilt).

    Raises:
        PlanError: the file cannot be read, is not a valid rig file, or its striker has no possible speed.
    """
    if path is None:
        striker = StrikerModel(effective_mass_sd_kg=UNMEASURED_MASS_SD_KG)
        return PlannedRig(Bench(striker, view.default_camera(), FRICTION), SharedErrors())
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise PlanError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise PlanError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise PlanError(f"{path}: not valid TOML: {error}") from None
    return rig_from_text(text, str(path))


def rig_from_text(text: str, name: str) -> PlannedRig:
    """Rig from the text of a rig file, which must be valid for `acquire` too.

    As planning uses no device, the camera's address may be missing, and so may the camera as a whole: the
    nominal one then stands in its place. The standard deviations of the table's tilt and of gravity are
    raised to at least 1e-6 rad and 1e-7 (relative).

    Args:
        text: content of the rig file (TOML).
        name: name of the file, for messages.

    Raises:
        PlanError: the text is not TOML, an entry is missing or has a value that is not allowed, or the
            striker's slowest speed is above its fastest.
    """
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # not TOML, nested too deep
        raise PlanError(f"{name}: not valid TOML: {error}") from None
    devices = frozenset({"camera", "striker"} & data.keys())
    camera = data.setdefault("camera", {"calibration": _nominal_calibration()})
    if _is_camera_file(data):
        raise PlanError(
            f"{name}: is a camera file, not a rig file: it has neither T_world_camera nor [striker]: give it "
            "with --camera for strikes by hand"
        )
    if isinstance(camera, dict):
        camera.setdefault("address", "none")
    try:
        rig = validate(RigConfig, data, name)
    except DocumentError as error:
        raise PlanError(str(error)) from None
    striker = striker_model(rig.striker)
    if striker.slowest_m_s > striker.fastest_m_s:
        raise PlanError(
            f"{name}: its striker has no possible speed: the slowest is {striker.slowest_m_s:.3g} m/s, but "
            f"velocity_limit_rad_s and cocked_angle_rad limit it to {striker.fastest_m_s:.3g} m/s: raise them"
        )
    lens = camera_from_spec(rig.camera.calibration)
    tilt = rig.gravity_tilt_sd_rad if rig.level is None else rig.level.towards_x_sd_rad
    errors = SharedErrors(tilt=max(tilt, 1e-6), gravity=max(rig.g_sd_m_s2 / rig.g_m_s2, 1e-7))
    return PlannedRig(
        Bench(
            striker,
            lens,
            rig.table_friction,
            rig.g_m_s2,
            rig.camera.frame_rate_hz,
            table_far_edge=rig.table_far_edge_m,
        ),
        errors,
        rig,
        devices,
    )


def _is_camera_file(data: dict[str, Any]) -> bool:
    """True if TOML data have a lens without pose and nothing else, as `analyze calibrate -o` writes them."""
    camera = data.get("camera")
    if not isinstance(camera, dict) or data.keys() != {"camera"}:
        return False
    lens = cast("dict[str, Any]", camera).get("calibration")
    return isinstance(lens, dict) and "K" in lens and "T_world_camera" not in lens


def _nominal_calibration() -> dict[str, Any]:
    """Table [camera.calibration] of the nominal camera (`view.default_camera`)."""
    camera = view.default_camera()
    return {
        "width": camera.width,
        "height": camera.height,
        "K": camera.K.tolist(),
        "T_world_camera": camera.T_world_camera.tolist(),
    }


def striker_model(striker: StrikerConfig) -> StrikerModel:
    """Planner's model of a rig file's striker: effective mass, restitution, range of tip speed and height.

    Standard deviations are raised to at least 0.1 g (effective mass) and 0.001 (restitution).
    """
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
