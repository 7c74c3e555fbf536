"""The table's tilt from one edge struck a second time with the object turned by 180 degrees (METHOD section 2, gravity)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.station import turned_camera
from analyze.planning import view
from analyze.planning.examine import Usable
from analyze.planning.information import Errors, Information
from analyze.types import CameraModel
from schemas.object_spec import ObjectSpec

TURNED = float(np.pi)
"""heading, rad"""


@dataclass(frozen=True)
class Turnable:
    """An edge that can be struck with the object turned as well."""

    index: int
    """among the usable axes"""
    usable: Usable
    """with the markers that the camera then sees"""
    tilt_sd: float
    """rad, of gravity's tilt by half the difference of phi of two strikes, one each way"""


def turnable(usable: Sequence[Usable], model: ObjectModel, spec: ObjectSpec, camera: CameraModel, errors: Errors) -> list[Turnable]:
    """Edges whose other side shows a marker to the camera, those that tell the tilt best first.

    Striker and object turn together: heights, speeds and the edge's hold are those of the strike as usual.

    Raises:
        PlanError: there is none; says of the one that comes nearest why.
    """
    other = turned_camera(camera, TURNED)
    known = any(marker.T_object_marker is not None for marker in spec.marker)
    found: list[Turnable] = []
    faults: list[view.Fault] = []
    for index, each in enumerate(usable):
        sight = view.visible_markers(model, spec, each.candidate.axis, each.candidate.expected.phi, other)
        if known and not sight.markers:
            faults.append(sight.fault)
            continue
        each_way = float(each.candidate.noise[0, 0]) + errors.strike_angle**2 + errors.axis_angle**2
        found.append(Turnable(index, replace(each, markers=sight.markers), float(np.sqrt(each_way / 2))))
    if not found:
        nearest = max(faults, key=lambda fault: view.CODES.index(fault.code), default=None)
        why = "" if nearest is None else f" ({nearest.text})"
        raise PlanError(
            f"{spec.name}: no edge can be struck with the object turned by 180 degrees, as the camera then sees its other side{why}: put a "
            "marker on the opposite side too, or hang a plumb line in view (`analyze gravity`)"
        )
    return sorted(found, key=lambda each: (round(each.tilt_sd, 9), each.index))


def with_tilt_told(information: Information, by: Turnable) -> Information:
    """As after such a pair of strikes: the tilt is known, so that no strike need be spent on cancelling it."""
    before = information.errors.tilt
    told = float(1 / np.hypot(1 / max(before, 1e-9), 1 / by.tilt_sd))
    return replace(information, errors=replace(information.errors, tilt=told))


def best_known(turnables: Sequence[Turnable], chosen: Collection[int]) -> Turnable:
    """The one that tells most among the edges that are struck anyway; else of all."""
    return next((each for each in turnables if each.index in chosen), turnables[0])
