"""Estimated poses of markers and tables, with the directions in which they are too uncertain.

A direction is undetermined if the standard deviation is above 0.5 deg (rotation, tilt) or 1 mm (position,
height). For a marker, a sentence states which strikes or measurements would determine it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.registration.solution import Solution
from analyze.registration.table import corrected_camera

if TYPE_CHECKING:
    from analyze.registration.views import StrikeView
    from analyze.types import Array, CameraModel

MAX_TURN_SD, MAX_PLACE_SD = math.radians(0.5), 1e-3
"""standard deviations of rotation [rad] and position [m] above which a direction is undetermined"""


@dataclass(frozen=True)
class MarkerPlace:
    """Estimated pose of one marker (frame M) on the object (frame O), with its errors."""

    marker_id: int | str
    """name of the marker"""
    T_object_marker: Array
    """(4, 4) pose of M in O"""
    covariance: Array
    """(6, 6) covariance of its turn in O [rad] and its centre in O [m]"""
    strikes: tuple[str, ...]
    """ids of the used strikes that show the marker"""
    rms_px: float
    """rms residual of its corners [px]"""
    on_surface: bool
    """True if its height over the surface was constrained to its card's thickness"""
    undetermined: tuple[str, ...]
    """undetermined directions in O, in words; empty if there are none"""
    remedy: str = ""
    """action that would determine the undetermined directions; empty if all are determined"""

    @property
    def turn_sd(self) -> float:
        """Standard deviation [rad] of the marker's rotation about the axis where it is least certain."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def place_sd(self) -> float:
        """Standard deviation [m] of the marker's centre in its least certain direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1]))


@dataclass(frozen=True)
class TablePlace:
    """Pose of the table in one recording, relative to the recorded pose of the camera.

    The table's tilts [rad] about x and y of the world frame W, and its height [m], have standard deviations;
    `T_world_camera` (4, 4) is the camera's pose in the W that lies on the estimated table.
    """

    setup: int
    """number of the recording"""
    offset: Array
    """(3,) tilts about W's x and y [rad], and the height [m]"""
    sd: Array
    """(3,) standard deviations of `offset` [rad, m]"""
    T_world_camera: Array
    """(4, 4) pose of C in the W whose z = 0 is the estimated table"""
    undetermined: tuple[str, ...]
    """undetermined components, in words; empty if there are none"""


def marker_place(
    name: int | str,
    solution: Solution,
    used: Sequence[StrikeView],
    on_surface: bool,
    against: int | str | None = None,
) -> MarkerPlace:
    """Estimated pose of one marker on the object, and the directions that the strikes leave undetermined.

    Args:
        name: name of the marker.
        solution: the joint fit.
        used: views of the strikes that were used.
        on_surface: True if the marker was constrained to the body's surface.
        against: on a body of revolution, the marker that defines O's direction about the axis; else None.

    Returns:
        Pose T_object_marker (4, 4), translation in m, with its covariance (6, 6): turn [rad], then centre
        [m], in the object frame O. Also the ids of the strikes that show the marker, the rms residual of its
        corners [px], `on_surface`, the undetermined directions, in words, and what the user can do to
        determine them; both texts are empty if there are none.
    """
    covariance = solution.covariance[name]
    mine = [view for view in used if name in view.marker_ids]
    words = [
        *(f"turn about {_axis(v)}" for v in _undetermined_directions(covariance[:3, :3], MAX_TURN_SD)),
        *(f"place along {_axis(v)}" for v in _undetermined_directions(covariance[3:, 3:], MAX_PLACE_SD)),
    ]
    return MarkerPlace(
        name,
        solution.T_object_marker[name],
        covariance,
        tuple(view.strike_id for view in mine),
        solution.rms_px[name],
        on_surface,
        tuple(words),
        _remedy(mine, against) if words else "",
    )


def _remedy(mine: Sequence[StrikeView], against: int | str | None) -> str:
    """Advice to the user, in words, for a marker whose pose the strikes determine only in part.

    Args:
        mine: views of the strikes that show the marker.
        against: on a body of revolution, the marker that defines O's direction about the axis; else None.
    """
    tipped = [view for view in mine if len(view.theta) > 1]
    if against is not None and tipped and all(against not in view.marker_ids for view in mine):
        return (
            f"the body is round: how this marker is turned about its axis against marker {against} is "
            "unknown: strike it in a direction in which the camera sees both, or markers between them, or "
            "measure T_object_marker by hand"
        )
    if any(view.rolls for view in mine):
        return "the body is round there: its turn about its axis is unknown: measure T_object_marker by hand"
    if not tipped and any(view.on_curve for view in mine):
        return (
            "the body rolls on a curve there, about no line:"
            " strike it over a sharp edge, or measure T_object_marker by hand"
        )
    if not tipped:
        return "strike the object so that this marker is seen while it tips"
    return "strike it on another resting face, over an edge that is not parallel to " + ", ".join(
        sorted({v.axis_id for v in tipped})
    )


def _undetermined_directions(covariance: Array, limit: float) -> list[Array]:
    """List of unit vectors (3,) along which the standard deviation exceeds `limit`; empty if none.

    They are eigenvectors of the covariance, in its frame.

    Args:
        covariance: (3, 3) covariance of a turn [rad^2] or a place [m^2].
        limit: standard deviation [rad or m].
    """
    values, vectors = np.linalg.eigh(covariance)
    return [vectors[:, i] for i in range(3) if math.sqrt(max(float(values[i]), 0.0)) > limit]


def _axis(vector: Array) -> str:
    """Name of a direction (3,) in the object frame O, regardless of its sign: an axis, or its components."""
    v = vector if vector[np.argmax(np.abs(vector))] > 0 else -vector
    largest = int(np.argmax(v))
    if v[largest] > 0.99:
        return f"O's {'xyz'[largest]}"
    return f"({v[0]:.2f}, {v[1]:.2f}, {v[2]:.2f}) in O"


def table_place(setup: int, solution: Solution, camera: CameraModel) -> TablePlace:
    """Pose of the table (two tilts, height) in one recording, with names of undetermined components.

    Tilts [rad] about x and y of the world frame W and height [m] are relative to the recorded camera pose.

    Undetermined is a tilt with a standard deviation above 0.5 deg, or a height with one above 1 mm.

    Args:
        setup: number of the recording.
        solution: the joint fit.
        camera: camera of the recording with its recorded pose.
    """
    offset, sd = solution.table[setup], np.sqrt(np.diag(solution.table_covariance[setup]))
    names = ("tilt about W's x", "tilt about W's y", "height")
    limits = (MAX_TURN_SD, MAX_TURN_SD, MAX_PLACE_SD)
    unknown = tuple(name for name, value, limit in zip(names, sd, limits, strict=True) if value > limit)
    return TablePlace(setup, offset, sd, corrected_camera(camera, offset).T_world_camera, unknown)
