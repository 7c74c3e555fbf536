"""Estimated marker poses and table poses as a table on the terminal and as JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.geometry.rotations import angle_between
from analyze.registration.places import MarkerPlace, TablePlace
from analyze.types import Array
from analyze.verbs.register.marker_poses import RegisterAnswer, is_implausible, pose_toml
from schemas.document import SCHEMA_VERSION
from schemas.terminal import Terminal
from schemas.wording import counted


def render_registration(answer: RegisterAnswer, console: Terminal | None = None) -> None:
    """Print the marker poses with remarks, then each recording's table pose and the strikes not used.

    Args:
        answer: the estimated poses.
        console: where to print; None for standard output.
    """
    console = console or Terminal()
    found, given = answer.registration, answer.given
    used = {strike for place in found.markers for strike in place.strikes}
    table = Table(
        "marker",
        "centre in O (mm)",
        "± (mm)",
        "± (deg)",
        "rms (px)",
        "strikes",
        title=f"{answer.evidence.spec.name}: {counted(len(found.markers), 'marker')} from "
        f"{counted(len(used), 'strike')}, 1 sigma along the worst direction",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    if given:
        table.add_column("against the file")
    for place in found.markers:
        row = [str(place.marker_id), *_place_cells(place), ", ".join(place.strikes)]
        if given:
            row.append(_difference_text(place, given.get(place.marker_id)))
        table.add_row(*row)
    console.print(table)
    for place in found.markers:
        if place.undetermined:
            console.print(
                f"marker {place.marker_id}: not determined: {'; '.join(place.undetermined)}: {place.remedy}"
            )
        elif not place.on_surface:
            console.print(
                f"marker {place.marker_id}: not on the surface: its pose comes from the strikes alone: check "
                "the shape"
            )
    for table_place in found.tables:
        console.print(_table_text(answer, table_place))
        if answer.options.find_table:
            console.print(f"T_world_camera = {pose_toml(table_place.T_world_camera)}")
    for left in answer.unused:
        console.print(f"not used: {left.strike_id}: {left.reason}")


def _place_cells(place: MarkerPlace) -> list[str]:
    if place.undetermined:
        return ["not determined", "", "", f"{place.rms_px:.3f}"]
    centre = 1000 * place.T_object_marker[:3, 3] + 0.0
    return [
        f"({centre[0]:.2f}, {centre[1]:.2f}, {centre[2]:.2f})",
        f"{1000 * place.place_sd:.2f}",
        f"{math.degrees(place.turn_sd):.2f}",
        f"{place.rms_px:.3f}",
    ]


def pose_difference(T: Array, other: Array) -> tuple[float, float]:
    """Angle [rad] between the rotations, and distance [m] between the origins, of two poses (4, 4) in m."""
    turn = float(angle_between(T[:3, :3], other[:3, :3]))
    return turn, float(np.linalg.norm(T[:3, 3] - other[:3, 3]))


def _difference_text(place: MarkerPlace, given: Array | None) -> str:
    if given is None or place.undetermined:
        return ""
    turn, distance = pose_difference(place.T_object_marker, given)
    return f"{1000 * distance:.2f} mm, {math.degrees(turn):.2f} deg"


def _table_text(answer: RegisterAnswer, table: TablePlace) -> str:
    several = f" of recording {table.setup + 1}" if len(answer.registration.tables) > 1 else ""
    tilts, sds = np.degrees(table.offset[:2]), np.degrees(table.sd[:2])
    text = (
        f"the table{several} against the recorded T_world_camera: tilts {tilts[0]:+.3f} ± {sds[0]:.3f} and "
        f"{tilts[1]:+.3f} ± {sds[1]:.3f} deg about W's x and y, height {1000 * table.offset[2]:+.3f} ± "
        f"{1000 * table.sd[2]:.3f} mm"
    )
    if is_implausible(table) and not answer.options.find_table:
        text += (
            ": more than the error of a board laid by hand: if the camera was moved, --table estimates it "
            "from the strikes alone"
        )
    return text


def registration_json(answer: RegisterAnswer) -> dict[str, Any]:
    """Marker poses, table poses, misfits and strikes not used, as JSON values in SI units.

    Poses are (4, 4) matrices with covariances or standard deviations. `misfit` is, by strike id, the chi^2 of
    marker corners per degree of freedom. Only `rms_px`, the rms residual of a marker's corners, is in pixels.
    The pose of a marker that is not determined is None, and its `observed` is False.
    """
    found, given = answer.registration, answer.given
    markers: list[dict[str, Any]] = []
    for place in found.markers:
        known = not place.undetermined
        entry: dict[str, Any] = {
            "marker": place.marker_id,
            "observed": known,
            "T_object_marker": place.T_object_marker.tolist() if known else None,
            "covariance": place.covariance.tolist() if known else None,
            "turn_sd_rad": place.turn_sd if known else None,
            "place_sd_m": place.place_sd if known else None,
            "undetermined": list(place.undetermined),
            "remedy": place.remedy,
            "strikes": list(place.strikes),
            "rms_px": place.rms_px,
            "on_surface": place.on_surface,
        }
        if known and place.marker_id in given:
            turn, distance = pose_difference(place.T_object_marker, given[place.marker_id])
            entry |= {"against_file": {"turn_rad": turn, "distance_m": distance}}
        markers.append(entry)
    return {
        "schema_version": SCHEMA_VERSION,
        "object_name": answer.evidence.spec.name,
        "markers": markers,
        "tables": [
            {
                "recording": table.setup + 1,
                "observed": not table.undetermined,
                "offset": {
                    "tilt_x_rad": table.offset[0],
                    "tilt_y_rad": table.offset[1],
                    "height_m": table.offset[2],
                },
                "sd": {"tilt_x_rad": table.sd[0], "tilt_y_rad": table.sd[1], "height_m": table.sd[2]},
                "T_world_camera": table.T_world_camera.tolist(),
                "undetermined": list(table.undetermined),
                "found": answer.options.find_table,
            }
            for table in found.tables
        ],
        "misfit": dict(found.solution.misfit),
        "not_used": [{"strike": left.strike_id, "reason": left.reason} for left in answer.unused],
    }
