"""Strike with the object turned by 180 degrees about the vertical, for the table's tilt (method 2)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.station import turned_camera
from analyze.planning import view
from analyze.planning.examine import TURNED, UsableAxis
from analyze.planning.information import Information, SharedErrors
from analyze.types import CameraModel
from schemas.object_spec import ObjectSpec


@dataclass(frozen=True)
class TurnableAxis:
    """Axis (edge to tip about) that can be struck with object and striker turned by 180 degrees too.

    The two strikes, one each way, measure the table's tilt; phi is their balance angle.
    """

    index: int
    """Index among the usable axes."""
    usable: UsableAxis
    """Usable axis with the markers that the camera sees when the object is turned."""
    tilt_sd: float
    """1 sigma [rad] of gravity's tilt from half the difference of phi of two strikes, one each way."""


def turnable_axes(
    usable: Sequence[UsableAxis],
    model: ObjectModel,
    spec: ObjectSpec,
    camera: CameraModel,
    errors: SharedErrors,
) -> list[TurnableAxis]:
    """Axes that can also be struck with object and striker turned by 180 degrees on the table.

    The camera must see a marker at both headings; if no marker has a pose, all axes count. Impact height,
    speed and friction needed are those of the usual strike. Strikes both ways measure the table's tilt; the
    axis that measures it most precisely comes first.

    Args:
        usable: Axes (edges to tip about) that passed every check.
        model: Shape of the object.
        spec: Name and markers.
        camera: Camera at the usual heading.
        errors: 1 sigma of errors that strikes share, such as the table's tilt.

    Returns:
        For each axis its index in `usable`, the axis with the markers seen when the object is turned, and
        1 sigma [rad] of the tilt that two strikes, one each way, measure.

    Raises:
        PlanError: there is none; the message has the fault of the marker nearest to being visible.
    """
    other = turned_camera(camera, TURNED)
    known = any(marker.T_object_marker is not None for marker in spec.marker)
    found: list[TurnableAxis] = []
    faults: list[view.Fault] = []
    for index, each in enumerate(usable):
        sight = view.visible_markers(model, spec, each.candidate.axis, each.candidate.expected.phi, other)
        if each.candidate.heading:
            continue
        if known and not sight.markers:
            faults.append(sight.fault)
            continue
        each_way = float(each.candidate.noise[0, 0]) + errors.strike_angle**2 + errors.axis_angle**2
        found.append(TurnableAxis(index, replace(each, markers=sight.markers), float(np.sqrt(each_way / 2))))
    if not found:
        nearest = max(faults, key=lambda fault: view.FAULT_CODES.index(fault.code), default=None)
        why = "" if nearest is None else f" ({nearest.text})"
        raise PlanError(
            f"{spec.name}: no edge can be struck with the object turned by 180 degrees, as the camera then "
            f"sees its other side{why}: put a marker on the opposite side too, or hang a plumb line "
            "in view (`analyze gravity`)"
        )
    return sorted(found, key=lambda each: (round(each.tilt_sd, 9), each.index))


def with_tilt_measured(information: Information, by: TurnableAxis) -> Information:
    """Copy of `information` in which two strikes on one axis have measured the table's tilt.

    One of the strikes is at the usual heading, the other with object and striker turned by 180 degrees. The
    new 1 sigma of the tilt combines that of these two strikes with the 1 sigma before.

    Args:
        information: Information of planned strikes about the object, with the errors that they share; it is
            not changed.
        by: Axis on which both strikes are made.
    """
    before = information.errors.tilt
    after = float(1 / np.hypot(1 / max(before, 1e-9), 1 / by.tilt_sd))
    return replace(information, errors=replace(information.errors, tilt=after))


def best_turnable(turnables: Sequence[TurnableAxis], chosen: Collection[int]) -> TurnableAxis:
    """Axis, preferably in `chosen`, whose usual and turned strike measure the table's tilt most precisely.

    For the turned strike, object and striker are turned by 180 degrees about the vertical. If none of the
    axes is in `chosen`, it is the most precise of all.

    Args:
        turnables: Axes, the most precise first; at least one.
        chosen: Indices among the usable axes.
    """
    return next((each for each in turnables if each.index in chosen), turnables[0])
