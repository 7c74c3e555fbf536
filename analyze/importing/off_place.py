"""Whether the object stood where its card puts it, by a camera whose pose is known from the mat."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from analyze.cameras.camera_file import CameraFile
from analyze.geometry.rotations import transform
from analyze.geometry.station import turned_camera
from analyze.importing.tip_view import TipView
from analyze.importing.windows import StrikeWindow
from analyze.tracking.camera_model import camera_from_spec
from schemas.strike_plan import StrikePlan

MAX_TURN, MAX_OFF_M = math.radians(3.0), 0.01
"""heading [rad] and place of the pivot edge [m] off the card above which they are remarked"""
MAX_LEAN, MAX_RISE_M = math.radians(1.5), 0.003
"""tilt [rad] and height [m] of the resting face against the table above which they are remarked"""


def off_place(
    plan: StrikePlan, camera: CameraFile, views: Sequence[TipView | None], windows: Sequence[StrikeWindow]
) -> Iterator[str]:
    """Yield a remark for each strike whose object did not stand as planned, or not flat on the table.

    Args:
        plan: strike plan with the object's resting poses.
        camera: camera with its pose.
        views: the object as it is seen at each tip.
        windows: windows of the strikes.
    """
    lens = camera_from_spec(camera.calibration)
    by_id = {strike.id: strike for strike in plan.strikes}
    for window in windows:
        view, planned = views[window.tip], by_id[window.plan_strike_id]
        if view is None:
            continue
        there = turned_camera(lens, planned.heading_rad).T_world_camera @ view.T_camera_object
        card = transform(np.array(planned.R_world_object), np.array(planned.p_world_object))
        turned = there[:3, :3] @ card[:3, :3].T
        heading = math.atan2(float(turned[1, 0] - turned[0, 1]), float(turned[0, 0] + turned[1, 1]))
        lean = math.acos(float(np.clip(turned[2, 2], -1.0, 1.0)))
        pivot = np.append(planned.pivot.point, 1.0)
        shift = (there @ pivot - card @ pivot)[:3]
        off = float(np.linalg.norm(shift[:2]))
        if abs(heading) > MAX_TURN or off > MAX_OFF_M:
            yield (
                f"{window.strike_id}: the object stood {math.degrees(heading):.1f} deg turned and "
                f"{1000 * off:.0f} mm off its card, by the mat: put its edge on the pivot line"
            )
        if lean > MAX_LEAN or abs(float(shift[2])) > MAX_RISE_M:
            yield (
                f"{window.strike_id}: the object rested {math.degrees(lean):.1f} deg tilted and "
                f"{1000 * float(shift[2]):.0f} mm over the mat: was something under it, or is its tag's "
                "place in the object file not right?"
            )
