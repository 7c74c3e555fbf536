"""Check of motion blur: how far a tag moves on the image while it is exposed, from the rig file alone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from acquire.preflight.check import Check, Measured, failed_check, passed_check, skipped_check

if TYPE_CHECKING:
    from schemas.rig import RigConfig

BLUR_LINE = "motion blur"
"""name of the check"""
MAX_BLUR_PX = 6.0
"""largest way of a tag on the image during an exposure [px]

Measured with this project's tracker on rendered tags of 60 px, the width from which angles are precise: up
to 6 px every tag was found, with corners right to 0.08 px rms and angles to 0.03 degrees (0.02 at rest); at
8 px corners were off by 0.4 px, at 14 px two in three tags were lost. Tags of 30 px bear half of it."""


def fastest_edge_m_s(rig: RigConfig) -> float:
    """Greatest speed of a struck object at the impact point [m/s]: (1 + e)·v.

    e is the restitution of the rig file, v the striker's fastest tip speed. An object that resists at the
    impact point like a free mass M leaves a tip of effective mass m with (1 + e)·v·m / (m + M); M = 0 bounds
    that from above (W. J. Stronge, Impact Mechanics, 2000, chapter 2; docs/explanation/method.md, 1.5).
    """
    return (1 + rig.striker.restitution) * rig.striker.tip_speeds().fastest_m_s


def px_per_m(rig: RigConfig) -> float | None:
    """Scale of the image at the world's origin [px/m]: f / Z, with the focal length f [px].

    Z is the origin's depth before the camera, by T_world_camera. None if it is not before the camera.
    """
    calibration = rig.camera.calibration
    pose = np.asarray(calibration.T_world_camera, dtype=float)
    depth_m = float(-pose[:3, 2] @ pose[:3, 3])
    focal_px = max(calibration.K[0][0], calibration.K[1][1])
    return focal_px / depth_m if depth_m > 0 else None


def check_blur(rig: RigConfig) -> Check:
    """Check that a tag at the impact point moves at most MAX_BLUR_PX on the image during an exposure.

    b = t·(1 + e)·v·f / Z, with the exposure t, the greatest speed (1 + e)·v of the object at the impact point
    after the striker's fastest strike (`fastest_edge_m_s`), and the scale f / Z (`px_per_m`). A tag above the
    impact point moves faster in proportion to its height over the pivot edge.
    """
    scale, speed = px_per_m(rig), fastest_edge_m_s(rig)
    if scale is None:
        return skipped_check(BLUR_LINE, "the origin of W is not before the camera (T_world_camera)")
    exposure_s = 1e-6 * rig.camera.exposure_us
    blur = exposure_s * speed * scale
    measured = Measured(blur, MAX_BLUR_PX, "px")
    found = (
        f"up to {blur:.1f} px in {rig.camera.exposure_us:g} us, at {speed:.2f} m/s and "
        f"{1e-3 * scale:.2f} px/mm (limit {MAX_BLUR_PX:g} px)"
    )
    if blur > MAX_BLUR_PX:
        longest = math.floor(1e6 * MAX_BLUR_PX / (speed * scale))
        remedy = f"exposure_us = {longest} or less, with more light; or a lower limit of the striker's speed"
        return failed_check(BLUR_LINE, found, remedy, measured)
    return passed_check(BLUR_LINE, found, measured)
