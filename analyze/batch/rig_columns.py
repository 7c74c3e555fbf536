"""Columns of a recording's row on the state of its rig: identity, calibration, tilt, striker, frame rate.

Control charts compare them from session to session (control_rows.py). A quantity that each strike shows is
the mean over strikes, its sd that of the mean, from the strikes' scatter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from analyze.estimation.sensitivity import ErrorSource
from analyze.geometry.station import turned_camera
from analyze.tracking.camera_model import camera_of_strike
from schemas.quantity import Quantity
from schemas.session_manifest import SessionManifest, TimeSource
from schemas.strike_result import USABLE_VERDICTS
from schemas.striker_kind import STRIKER_KINDS, KindName

if TYPE_CHECKING:
    from analyze.estimation.sensitivity import Sensitivity
    from analyze.pipeline.evidence import Evidence
    from analyze.types import Array, TipMotion
    from schemas.result import Result
    from schemas.strike_plan import PlannedStrike

OWN_SOURCES = (ErrorSource.NOISE, ErrorSource.SCATTER)
"""error sources that are new in every session; the others may be the same in all sessions of an object"""
MIN_COSINE = 0.5
"""least |cos(heading)| of strikes that show the camera's turn: across it, the turn is out of the image"""
MIN_FRAMES = 10
"""fewest frames of a strike from which its frame interval is taken"""


def rig_columns(evidence: Evidence, result: Result) -> dict[str, Any]:
    """Columns on the rig of one recording: value by name, in SI units, None if not known.

    - `rig`, `camera_serial`, `striker`: names of rig, camera and striker; None for an imported recording.
    - `range_ratio`: distance of the tags at rest from the camera, measured by their size in the image, over
      that by the camera's calibrated pose and the planned placement. It changes with the focal length, the
      camera's place, and the tags' size.
    - `rest_turn_rad`: turn of the resting object about the pivot edge, as its tags show it, in the direction
      of strikes at heading 0. It changes with the camera's roll against the table.
    - `tilt_x_rad`, `tilt_y_rad`: table tilt, measured or read; None where it is only assumed.
    - `striker_speed_ratio`: measured over commanded tip speed.
    - `frame_rate_ratio`: frame rate by the host's clock over the nominal one.

    Args:
        evidence: strikes of the recording.
        result: result of the estimate from them.
    """
    manifest = evidence.manifest
    usable = [motion for motion in evidence.motions if motion.verdict in USABLE_VERDICTS]
    return {
        **_identity(manifest),
        **_mean_columns("range_ratio", "range_ratio_sd", _range_ratios(evidence, usable)),
        **_mean_columns("rest_turn_rad", "rest_turn_sd_rad", _rest_turns(evidence, usable)),
        **_tilt_columns(result),
        **_mean_columns("striker_speed_ratio", "striker_speed_ratio_sd", _speed_ratios(evidence)),
        **_mean_columns("frame_rate_ratio", "frame_rate_ratio_sd", _frame_rate_ratios(manifest, usable)),
    }


def shared_columns(sensitivity: Sensitivity) -> dict[str, float | list[float]]:
    """Columns on the two parts of the error of c: new in each session, and shared by sessions of one object.

    New are the frames' noise and the scatter from strike to strike. The others may be shared: shape, edges,
    masses, markers, gravity, and the table's tilt, which only sessions on one levelling share.

    - `com_shared_sd_x_m`, y and z: sd [m] by what may be shared;
    - `com_own_covariance_m2`: covariance (3, 3) [m^2] by what is new, row by row in the object frame O.
    """
    shared, own = np.zeros((3, 3)), np.zeros((3, 3))
    for share in sensitivity.shares:
        part = own if share.source in OWN_SOURCES else shared
        part += share.covariance
    return {
        **{
            f"com_shared_sd_{axis}_m": math.sqrt(max(0.0, float(each)))
            for axis, each in zip("xyz", np.diag(shared), strict=True)
        },
        "com_own_covariance_m2": own.ravel().tolist(),
    }


def _identity(manifest: SessionManifest) -> dict[str, str | None]:
    """Names of rig, camera and striker; None for a recording that no rig made.

    The manifest has no serial number of the striker: its kind, model, bus id and arm tell strikers apart.
    """
    name, striker = manifest.rig.get("name"), manifest.striker
    if not name or not striker:
        return {"rig": str(name) if name else None, "camera_serial": manifest.cameras[0].serial or None}
    kind = str(striker.get("kind", ""))
    parts, traits = [kind], STRIKER_KINDS.get(cast("KindName", kind))
    if traits is not None and traits.has_servo:
        parts += [str(striker.get("model", "")), f"id {striker.get('id', '')}"]
    if traits is not None and traits.has_port and isinstance(striker.get("arm_length_m"), int | float):
        parts.append(f"arm {1e3 * striker['arm_length_m']:.0f} mm")
    return {
        "rig": str(name),
        "camera_serial": manifest.cameras[0].serial or None,
        "striker": ", ".join(part for part in parts if part),
    }


def _mean_columns(name: str, sd_name: str, values: Iterable[float]) -> dict[str, float | None]:
    """Mean of the strikes' values and its sd; the sd is None for one strike, both are for none."""
    each = np.array([value for value in values if math.isfinite(value)])
    if not len(each):
        return {name: None, sd_name: None}
    sd = float(each.std(ddof=1)) / math.sqrt(len(each)) if len(each) > 1 else None
    return {name: float(each.mean()), sd_name: sd or None}


def _range_ratios(evidence: Evidence, usable: Iterable[TipMotion]) -> Iterator[float]:
    """Yield per strike the measured over the expected distance of the tags at rest from the camera."""
    places = {
        marker.name: np.array(marker.T_object_marker)[:3, 3]
        for marker in evidence.spec.marker
        if marker.T_object_marker is not None
    }
    for motion in usable:
        report = evidence.tracking.get(motion.strike_id)
        end_ns = _rest_end_ns(motion)
        if report is None or end_ns is None:
            continue
        centre = _camera_centre(evidence, motion)
        ratios = [
            float(np.median(np.linalg.norm(track.p_camera_marker[track.frame_ns <= end_ns], axis=1)))
            / float(np.linalg.norm(_at_rest(evidence.planned(motion), places[track.marker_id]) - centre))
            for track in report.tracks
            if track.marker_id in places and np.any(track.frame_ns <= end_ns)
        ]
        if ratios:
            yield float(np.mean(ratios))


def _rest_end_ns(motion: TipMotion) -> int | None:
    """Log time [ns] of the last frame in which the object rests before the strike; None if unknown."""
    if motion.angle is None or motion.phases is None or motion.phases.rest is None:
        return None
    start, stop = motion.phases.rest
    return int(motion.angle.time_ns[stop - 1]) if stop > start else None


def _camera_centre(evidence: Evidence, motion: TipMotion) -> Array:
    """Centre of the camera (3,) [m] in the world frame of a strike, which turns with its heading."""
    own_pose = evidence.camera_poses.get(motion.strike_id, ())
    camera = camera_of_strike(evidence.manifest.cameras[0].calibration, own_pose)
    return turned_camera(camera, evidence.planned(motion).heading_rad).T_world_camera[:3, 3]


def _at_rest(planned: PlannedStrike, point: Array) -> Array:
    """Point (3,) [m] of the object, given in O, in the world frame of a strike before it."""
    return np.array(planned.R_world_object) @ point + np.array(planned.p_world_object)


def _rest_turns(evidence: Evidence, usable: Iterable[TipMotion]) -> Iterator[float]:
    """Yield per strike the mean turn [rad] at rest by its tags, towards the tip of strikes at heading 0."""
    for motion in usable:
        along = math.cos(evidence.planned(motion).heading_rad)
        if motion.rest_turns and abs(along) > MIN_COSINE:
            yield along * float(np.mean([turn.angle for turn in motion.rest_turns]))


def _speed_ratios(evidence: Evidence) -> Iterator[float]:
    """Yield per strike the striker's measured over its commanded tip speed, where both are known."""
    for impact in evidence.impacts.values():
        if impact.commanded_speed is not None:
            yield impact.tip_speed / impact.commanded_speed


def _frame_rate_ratios(manifest: SessionManifest, usable: Iterable[TipMotion]) -> Iterator[float]:
    """Yield per strike the frame rate by the host's clock over the nominal one; none for a file's times."""
    if manifest.time_source is not TimeSource.DEVICE_MAPPED or not manifest.rig:
        return
    nominal_ns = 1e9 / manifest.cameras[0].frame_rate_hz
    for motion in usable:
        if motion.angle is None or len(motion.angle.time_ns) < MIN_FRAMES:
            continue
        time_ns = (motion.angle.time_ns - motion.angle.time_ns[0]).astype(np.float64)
        number = np.round(time_ns / nominal_ns)
        yield nominal_ns / float(np.polyfit(number, time_ns, 1)[0])


def _tilt_columns(result: Result) -> dict[str, float | None]:
    """Tilt of the table towards x and y with sds; None where the strikes and a level leave it open."""
    tilt = result.table_tilt[0] if result.table_tilt else None
    found: dict[str, float | None] = {}
    for axis in "xy":
        angle: Quantity | None = None if tilt is None else getattr(tilt, f"towards_{axis}")
        known = angle is not None and angle.source != "prior"
        found[f"tilt_{axis}_rad"] = _number(angle.value) if angle is not None and known else None
        found[f"tilt_{axis}_sd_rad"] = _number(angle.sd) if angle is not None and known else None
    return found


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
