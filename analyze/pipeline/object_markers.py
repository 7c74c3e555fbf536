"""Markers of an object as its object file places them, for tracking."""

from __future__ import annotations

import numpy as np

from analyze.types import MARKER_PLACE_SD, MARKER_TURN_SD, Marker
from schemas.object_spec import ObjectSpec


def placed_markers(spec: ObjectSpec) -> list[Marker]:
    """Markers (square tags) of the object: name, edge length [m], and pose in the object frame O.

    The pose is None where the object file does not give it. The 1 sigma of a marker's place [m] and turn
    [rad] on the object is that of the object file, or else a default.
    """
    return [
        Marker(
            marker.name,
            marker.size_m,
            None if marker.T_object_marker is None else np.array(marker.T_object_marker),
            MARKER_PLACE_SD if marker.place_sd_m is None else marker.place_sd_m,
            MARKER_TURN_SD if marker.turn_sd_rad is None else marker.turn_sd_rad,
        )
        for marker in spec.marker
    ]


def unplaced_markers(spec: ObjectSpec) -> list[Marker]:
    """Markers (square tags) of the object: name and edge length [m], without poses.

    A pose in the object file is not used.
    """
    return [Marker(marker.name, marker.size_m, None) for marker in spec.marker]
