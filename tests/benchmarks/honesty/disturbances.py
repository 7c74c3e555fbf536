"""Disturbances of `make bench-honesty`: how description, rig and handling differ from the truth.

Each is drawn per session. A disturbance is `covered` if the standard deviations that the user states cover
it: then no doubt is expected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from schemas.object_spec import ObjectSpec

RADIUS_IS_OPTIONAL = ObjectSpec.model_fields["edge_radius_m"].default is None
"""True if an object file without a radius says that the radius is unknown, not that it is 0"""


@dataclass(frozen=True)
class Disturbance:
    """Sizes of a session's errors; angles in rad, lengths in m, standard deviations of what is drawn."""

    covered: bool = False
    """True if the stated standard deviations cover it"""
    radius: str = "stated"
    """"stated", "missing", "per edge", or "wrong": 1.0 ± 0.1 mm, or 0.3 ± 0.1 mm where it is 1 mm or more"""
    tilt: float = math.radians(0.05)
    tilt_stated: float = math.radians(0.05)
    scan: str = "none"
    """"none", "scale", "offset" (whole surface), "faces" (each its own) or "cloud" (a point cloud)"""
    scan_sd: float = 0.0
    scan_stated: bool = True
    """True if the object file states the error of the shape, 0 where it is undisturbed"""
    tag_place: float = 1e-4
    tag_turn: float = math.radians(0.05)
    unplaced: float | None = None
    """error of the object's placing on the table, where the tags' places are not given; None if they are"""
    lens: float = 1e-4
    """strain that the calibration leaves in the image, by default that of a good one"""
    lens_stated: bool = True
    """True if the calibration states it, as one of `analyze calibrate` does"""
    mass: float = 0.0
    """relative error of the mass, stated"""
    rest: float = 0.0
    """turn of the rest pose against the planned one, for each strike"""
    mislabelled: bool = False
    strikes: tuple[int, int] | None = None
    """least and largest number of strikes; None for all planned"""
    edges: str = "planned"
    """"planned" by our planner, "own" (any edges that tip) or "vertex" (three that meet at a vertex)"""


DISTURBANCES = {
    "none": Disturbance(covered=True),
    "radius_missing": Disturbance(covered=RADIUS_IS_OPTIONAL, radius="missing"),
    "radius_wrong": Disturbance(radius="wrong"),
    "level": Disturbance(covered=True, tilt=math.radians(0.2), tilt_stated=math.radians(0.2)),
    "level_understated": Disturbance(tilt=math.radians(0.2)),
    "scan_scale": Disturbance(covered=True, scan="scale", scan_sd=3e-4),
    "scan_offset": Disturbance(covered=True, scan="offset", scan_sd=3e-4),
    "scan_faces": Disturbance(covered=True, scan="faces", scan_sd=3e-4),
    "scan_unstated": Disturbance(covered=True, scan="faces", scan_sd=3e-4, scan_stated=False),
    "shape_unstated": Disturbance(covered=True, scan_stated=False),
    "cloud": Disturbance(covered=True, scan="cloud", scan_sd=1.5e-4),
    "tag_place": Disturbance(covered=True, tag_place=3e-4, tag_turn=math.radians(0.3)),
    "tags_unplaced": Disturbance(covered=True, unplaced=3e-3),
    "lens": Disturbance(covered=True, lens=1e-3),
    "mass": Disturbance(covered=True, mass=0.01),
    "rest_pose": Disturbance(rest=math.radians(0.3)),
    "mislabelled": Disturbance(mislabelled=True),
    "few_strikes": Disturbance(covered=True, strikes=(3, 5)),
    "own_edges": Disturbance(covered=True, edges="own"),
    "singular": Disturbance(covered=True, edges="vertex"),
    "all_mild": Disturbance(
        covered=True,
        tilt=math.radians(0.1),
        tilt_stated=math.radians(0.1),
        scan="faces",
        scan_sd=1e-4,
        tag_place=1.5e-4,
        tag_turn=math.radians(0.1),
        lens=2e-4,
        mass=0.002,
        rest=math.radians(0.03),
    ),
    "radius_per_edge": Disturbance(covered=True, radius="per edge"),
    "lens_unstated": Disturbance(lens=1e-3, lens_stated=False),
}
"""all disturbances, by name"""
