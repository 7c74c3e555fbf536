"""One frozen value per arrow: Recording -> MarkerTrack -> TipMotion -> EquiPlane -> CentreOfMass -> InertialParameters -> MassDistribution.

SI units, angles in rad. Arrays: the last axis is the vector.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from schemas.result import Verdict
from schemas.session_manifest import LensModel

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class CameraModel:
    """Pinhole with OpenCV distortion or OpenCV's fisheye, and its place in W."""

    width: int
    height: int
    K: Array
    """(3, 3) px"""
    distortion: Array
    """(5,) k1, k2, p1, p2, k3; of a fisheye (4,) k1, k2, k3, k4"""
    T_world_camera: Array
    """(4, 4)"""
    model: LensModel = LensModel.PINHOLE
    line_time_s: float = 0.0
    """by which each row is read later than the row above; a frame's time is that of its middle row"""


@dataclass(frozen=True)
class Marker:
    """A marker on the object."""

    id: int | str
    """its name: a number of 36h11, else as "25h9-3" (schemas.tags)"""
    size: float
    T_object_marker: Array | None
    """(4, 4)"""


@dataclass(frozen=True)
class ImageFrame:
    """One image of a recording."""

    time_ns: int
    """log_time: wall anchor + host monotonic time of mid-exposure"""
    sequence: int
    image: NDArray[np.uint8]
    """(height, width)"""


@dataclass(frozen=True)
class MarkerTrack:
    """One marker through one strike window; only frames in which it was found."""

    marker_id: int | str
    time_ns: IntArray
    """(n,) of the frames, unless `late_ns` says otherwise"""
    corners_px: Array
    """(n, 4, 2), OpenCV order: top-left, top-right, bottom-right, bottom-left of the marker"""
    corner_sd_px: Array
    """(n,)"""
    R_camera_marker: Array
    """(n, 3, 3)"""
    p_camera_marker: Array
    """(n, 3) m"""
    frames_total: int
    """frames in the window, found or not"""
    late_ns: IntArray | None = None
    """(n,) of a rolling shutter: by how much `time_ns`, at which the corners were where they are said to be, is later than the frame's"""

    @property
    def frame_ns(self) -> IntArray:
        """(n,) times of the images that it was found in."""
        return self.time_ns if self.late_ns is None else self.time_ns - self.late_ns


@dataclass(frozen=True)
class TipAngle:
    """Tipping angle since rest about the pivot axis, from one or more tracks."""

    time_ns: IntArray
    """(n,)"""
    theta: Array
    """(n,) rad, 0 at rest, + tips"""
    sd: Array
    """(n,) rad, random part per frame"""
    off_axis: Array
    """(n,) rad, rotation about other axes: wobble and twist"""
    slip: Array
    """(n,) m, displacement of the pivot point along the table, 0 where the full pose is not known"""
    zero_sd: float = 0.0
    """rad, 1 sigma of where 0 lies: shared by all frames, so that no number of them averages it out"""


@dataclass(frozen=True)
class Phases:
    """Index ranges [start, stop) into a TipAngle; None where a phase did not occur."""

    rest: tuple[int, int] | None
    strike: tuple[int, int] | None
    stage_one: tuple[int, int] | None
    stage_two: tuple[int, int] | None
    landing: tuple[int, int] | None


@dataclass(frozen=True)
class RollingContact:
    """Where a contact that rolls on a curved flank touches at phi: there it rolls like the circle of curvature about its centre."""

    along: float
    """m in the rest pose, of that centre from the plan's pivot point, the way the object tips"""
    over: float
    """m, the same upwards"""
    radius: float
    """m, of curvature"""
    sd: float
    """m, 1 sigma of the centre across itself; of a curve of the shape's own all of it, else beside the pivot's"""
    energy_ratio: float
    """energy over what standing up takes, on this flank"""
    of_shape: bool = False
    """whether the radius is the shape's own, and not the rounding that the object file gives its edges"""
    radius_sd: float = 0.0
    """m, 1 sigma of the radius: the centre lies nearer to c by as much as it is larger"""


@dataclass(frozen=True)
class MotionFit:
    """phi and k of one strike by one estimator."""

    estimator: str
    phi: float
    k: float | None
    """rad/s^2"""
    covariance: Array
    """(2, 2) of (phi, k), with what all frames of the strike share; k's row is 0 where k is None"""
    theta0: float
    omega0: float
    time0_ns: int
    """theta0, omega0 hold here"""
    damping: float
    window: tuple[int, int]
    """index range used"""
    residual: Array
    """(window length,) rad"""
    note: str = ""
    """why this estimator, this window"""
    violated: tuple[str, ...] = ()
    """assumptions of the estimator that the motion did not keep, each with its number"""
    rolling: RollingContact | None = None
    """where the contact rolls on a flank: what takes the place of the plan's pivot point and radius"""


@dataclass(frozen=True)
class TipMotion:
    """One strike: what happened, and what was fitted."""

    strike_id: str
    plan_strike_id: str
    verdict: Verdict
    reason: str
    angle: TipAngle | None
    phases: Phases | None
    fit: MotionFit | None
    """the one used"""
    alternatives: tuple[MotionFit, ...]
    energy_ratio: float | None
    faster: float | None = None
    """true frame rate over the stated one at which it would be a tip, where it is none as stated; None: as stated, or at none"""


@dataclass(frozen=True)
class EquiPlane:
    """Plane in O that holds the pivot's centre line and c. normal . (c - point) = 0."""

    strike_id: str
    axis_id: str
    point: Array
    """(3,) on the centre line"""
    direction: Array
    """(3,) unit, +theta about it tips"""
    up: Array
    """(3,) unit, W's z in O at rest"""
    normal: Array
    """(3,) unit"""
    phi: float
    sd_phi: float
    """random part"""
    k: float | None
    sd_k: float | None
    cov_phi_k: float
    edge_radius: float
    edge_sd: float
    """m, position of the line across itself, shared by strikes on the axis"""
    heading: float = 0.0
    """rad, how the strike was turned on the table: which part of gravity's tilt it feels"""
    face: str = ""
    """that it rested on, whose place all edges of the face share; "": not known"""
    rounded: bool = True
    """`edge_radius` is the edges' rounding, whose error all edges share; False: a flank's curvature"""
    level: int = 0
    """number of the levelling of the table that it was made on: whose tilt of gravity it feels"""
    radius_sd: float = 0.0
    """m, of a flank's radius of curvature: the line lies nearer to c by as much as it is larger"""


@dataclass(frozen=True)
class TableTilt:
    """How far the vertical leans from the table's normal, on one levelling."""

    lean: Array
    """(2,) rad, towards W's x (where objects tip) and y: the table rises that way by as much"""
    covariance: Array
    """(2, 2) rad^2"""
    prior_sd: Array
    """(2,) rad, 1 sigma before any strike"""

    @property
    def sd(self) -> Array:
        """(2,) rad."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class CentreOfMass:
    """c in O."""

    position: Array
    """(3,) m"""
    covariance: Array
    """(3, 3) m^2; unobserved directions carry the prior's variance"""
    observed: bool
    unobserved_direction: Array | None
    """(3,) unit, worst known, where not observed"""
    residuals: Array
    """(strikes,) m, signed distance of c from each of `planes`"""
    weights: Array
    """(strikes,) relative, sum 1"""
    distances: Array
    """(strikes,) R, m"""
    distance_covariance: Array
    """(strikes, strikes) m^2, of R"""
    position_distance_covariance: Array
    """(3, strikes) m^2, between c and R"""
    robust: Array
    """(strikes,) 1 = as good as its sd says, towards 0 = an outlier that was given little weight"""
    tilts: tuple[TableTilt, ...] = ()
    """of each levelling of the table"""
    planes: tuple[EquiPlane, ...] = ()
    """of the strikes, upright in gravity as it was found to lean"""


@dataclass(frozen=True)
class AxisInertia:
    """Moments about one pivot axis."""

    axis_id: str
    direction: Array
    i_edge: float
    i_edge_sd: float
    i_com: float
    i_com_sd: float


@dataclass(frozen=True)
class InertialParameters:
    """Mass, c and the inertia tensor about c, axes of O."""

    mass: float
    mass_sd: float
    com: CentreOfMass
    inertia: Array
    """(3, 3) kg m^2"""
    inertia_sd: Array
    """(3, 3)"""
    measured: NDArray[np.bool_]
    """(3, 3) True where strikes determine the entry, False where the prior does"""
    axes: tuple[AxisInertia, ...] = field(default=())
    joint_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(4 + axes, 4 + axes) of (mass, c, i_com per axis)"""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(10, 10) of (mass, c, Ixx, Iyy, Izz, Ixy, Ixz, Iyz)"""


@dataclass(frozen=True)
class WallThickness:
    """What the moments say of a wall whose thickness is not given."""

    value: float
    """m"""
    sd: float
    interval: tuple[float, float]
    """m, that hold 95 %"""
    swept: tuple[float, float]
    """m, that were tried"""


@dataclass(frozen=True)
class MassDistribution:
    """Masses of the shell (R1) and the interior on either side of a plane (R2 where n.x > offset, R3 elsewhere)."""

    names: tuple[str, ...]
    masses: Array
    """(n,) kg"""
    covariance: Array
    """(n, n) kg^2"""
    intervals: Array
    """(n, 2) kg, that hold 95 %: of such a body's masses, or the limits where it is not `explained` as such a body"""
    limits: Array
    """(n, 2) kg, between which they lie whatever fills the interior of an even shell"""
    misfit: float
    """chi^2 of the moments at the best border"""
    explained: bool
    """whether that is as errors of measurement would have it"""
    border_normal: Array
    """(3,) unit, in O; across the body's middle where none explains the moments"""
    border_offset: float
    border_offset_interval: tuple[float, float]
    baselines: dict[str, Array]
    """naive answers"""
    wall: WallThickness | None = None
    """where its thickness is not given"""
