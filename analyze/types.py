"""Data types between the stages of the analysis; one file, as each is made from those before it.

Recording -> MarkerTrack -> TipMotion -> EquiPlane; the types of what the strikes give together (centre of
mass, inertia, inner masses) are in estimation/mass_properties.py. All are frozen dataclasses. SI units,
angles in rad. Arrays: the last axis is the vector. Frames: W (world, z up, table z = 0), O (object, the frame
of its shape file), C (camera, OpenCV: x right, y down, z forward), M (marker), B (calibration board); "sd" is
one standard deviation, c the centre of mass, log_time the recording's clock.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.session_manifest import LensModel
from schemas.strike_result import FollowedBy, Verdict

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

MARKER_PLACE_SD, MARKER_TURN_SD = 3e-4, math.radians(0.3)
"""standard deviations of a marker's stated place on the object [m] and of its turn there [rad], where the
object file does not give them"""
TENSOR_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""indices of the six entries of a symmetric tensor, in the order of every list and table of such entries"""


def tensor_entry_name(entry: tuple[int, int]) -> str:
    """Name of the entry (i, j) of an inertia tensor, such as Ixx or Ixy."""
    return "I" + "".join("xyz"[index] for index in entry)


@dataclass(frozen=True)
class CameraModel:
    """Pinhole camera with OpenCV distortion, or OpenCV's fisheye, and its pose in the world frame W."""

    width: int
    """image width [px]"""
    height: int
    """image height [px]"""
    K: Array
    """(3, 3) camera matrix [px]"""
    distortion: Array
    """(5,) k1, k2, p1, p2, k3; for a fisheye (4,) k1, k2, k3, k4"""
    T_world_camera: Array
    """(4, 4) pose of C in W, translation in m"""
    model: LensModel = LensModel.PINHOLE
    """lens model: pinhole or fisheye"""
    line_time_s: float = 0.0
    """delay [s] between the readout of neighbouring rows; a frame's time is that of its middle row"""
    strain_sd: float = 0.0
    """standard deviation of the strain that the calibration leaves in the image: relative error of a length
    in one direction against one across it"""


@dataclass(frozen=True)
class Marker:
    """Square marker (AprilTag) on the object: name, edge length [m] and pose in the object frame O."""

    id: int | str
    """name of the marker: a number of family 36h11, otherwise a text such as "25h9-3" (schemas.tags)"""
    size: float
    """edge of the black square [m]"""
    T_object_marker: Array | None
    """(4, 4) pose of M in O, translation in m; None if unknown"""
    place_sd: float = MARKER_PLACE_SD
    """standard deviation [m] of the marker's centre in O, where the pose is known"""
    turn_sd: float = MARKER_TURN_SD
    """standard deviation [rad] of the marker's rotation in O, where the pose is known"""


@dataclass(frozen=True)
class RestTurn:
    """Turn [rad] of the resting object about the pivot axis from its planned pose, as one marker shows."""

    angle: float
    """turn [rad], positive towards the tip"""
    sd: float
    """1 sigma [rad] of the error that is this strike's own"""
    marker: str
    """name of the marker"""
    marker_sd: float
    """1 sigma [rad] of the error of the marker's pose on the object, which all views of the marker share"""
    camera: str
    """name of the camera's pose in the world frame, whose error all views from it share"""


@dataclass(frozen=True)
class ImageFrame:
    """One grey image of a recording, with its time."""

    time_ns: int
    """log_time [ns] of the middle of the exposure: wall-clock anchor + host monotonic time"""
    sequence: int
    """frame number in the recording"""
    image: NDArray[np.uint8]
    """(height, width) grey levels"""


@dataclass(frozen=True)
class MarkerTrack:
    """Track of one marker through a strike's time window, in the n frames in which it was found.

    Per frame: time [ns], corners (4, 2) [raw px] with sd, and the marker's pose in the camera frame C [m].
    """

    marker_id: int | str
    """name of the marker"""
    time_ns: IntArray
    """(n,) log_time [ns] at which the corners were at `corners_px`; with a rolling shutter it differs from
    the frame's own time by `late_ns`"""
    corners_px: Array
    """(n, 4, 2) raw pixels, OpenCV order: top-left, top-right, bottom-right, bottom-left of the marker"""
    corner_sd_px: Array
    """(n,) standard deviation of a corner's coordinate [px]"""
    R_camera_marker: Array
    """(n, 3, 3) rotation from M to C"""
    p_camera_marker: Array
    """(n, 3) marker centre in C [m]"""
    frames_total: int
    """number of frames in the window, with or without the marker"""
    late_ns: IntArray | None = None
    """(n,) delay [ns] of `time_ns` after the frame's own time, caused by a rolling shutter; None if it is
    0"""

    @property
    def frame_ns(self) -> IntArray:
        """Log times (n,) [ns] of the images in which the marker was found."""
        return self.time_ns if self.late_ns is None else self.time_ns - self.late_ns


@dataclass(frozen=True)
class TipAngle:
    """Tipping angle theta [rad] since rest about the pivot axis, in n frames, with its sd.

    It comes from the tracks of one or more markers, with the other rotation [rad] and the pivot's slip [m].
    """

    time_ns: IntArray
    """(n,) log_time of the frames [ns]"""
    theta: Array
    """(n,) tipping angle [rad], 0 at rest, positive as the object tips"""
    sd: Array
    """(n,) standard deviation of theta [rad], independent from frame to frame"""
    off_axis: Array
    """(n,) rotation about the other two axes [rad]: wobble and twist"""
    slip: Array
    """(n,) displacement of the pivot point along the table [m], 0 if the full pose is unknown"""
    zero_sd: float = 0.0
    """standard deviation [rad] of theta's zero; all frames share this error, so averaging frames does not
    reduce it"""
    slow_sd: float = 0.0
    """standard deviation [rad] of the error of theta that frames at nearly the same theta share"""
    strain_sd: float = 0.0
    """standard deviation of the image's strain by the camera's calibration: relative error of a length in one
    direction against one across it"""


@dataclass(frozen=True)
class Phases:
    """Frame ranges [start, stop) of a strike's phases, rest to landing; None if one did not occur.

    A range holds indices into the arrays of the strike's TipAngle, its measured tipping angle by frame.
    """

    rest: tuple[int, int] | None
    """object at rest, before the contact"""
    strike: tuple[int, int] | None
    """first motion until only gravity and the table act"""
    stage_one: tuple[int, int] | None
    """free motion up to the balance; to its end if the object does not reach the balance"""
    stage_two: tuple[int, int] | None
    """free motion from the balance on"""
    landing: tuple[int, int] | None
    """from the end of the free motion: the object lands, or is back at rest"""

    def spans(self) -> dict[str, tuple[int, int]]:
        """Frame range [start, stop) of each phase that occurred, by its name, in their order in time."""
        return {name: span for name in PHASE_NAMES if (span := getattr(self, name)) is not None}


PHASE_NAMES = ("rest", "strike", "stage_one", "stage_two", "landing")
"""names of the phases in their order in time, as fields of `Phases`"""


@dataclass(frozen=True)
class RollingContact:
    """Circle of curvature of the object's cross-section at its contact with the table, at balance.

    The cross-section is perpendicular to the pivot axis. At balance the centre of mass c stands above the
    contact.
    """

    forward: float
    """offset [m] of the circle's centre from the plan's pivot point in the rest pose, horizontal, in the
    direction of tipping"""
    up: float
    """offset [m] of the circle's centre from that point, upwards"""
    radius: float
    """radius of curvature [m]"""
    sd: float
    """standard deviation [m] of the centre across the axis: the total for a curve of the shape itself,
    otherwise in addition to the pivot's"""
    energy_ratio: float
    """energy of the strike over the energy needed to stand up on this section"""
    of_shape: bool = False
    """True if the radius belongs to the shape itself, not to the rounding that the object file states"""
    radius_sd: float = 0.0
    """standard deviation [m] of the radius; a larger radius moves the centre towards c by the same amount"""


@dataclass(frozen=True)
class MotionFit:
    """Fit of one strike's motion by one estimator: balance angle phi and rate constant k.

    The motion is theta'' = -k sin(phi - theta), with theta the tipping angle since rest, or the form of this
    equation for a rolling contact.
    """

    estimator: str
    """name of the estimator"""
    phi: float
    """balance angle [rad]: theta at which c stands above the contact"""
    k: float | None
    """m g R / (I_c,l + m (R + rho)^2) [rad/s^2], with R the distance of c from the pivot's centre line, rho
    the edge radius and I_c,l the moment about the parallel axis through c; None if not reported"""
    covariance: Array
    """(2, 2) covariance of (phi [rad], k [rad/s^2]), including errors shared by all frames of the strike; row
    and column of k are 0 if k is None"""
    theta0: float
    """theta [rad] at `time0_ns`"""
    omega0: float
    """angular speed [rad/s] at `time0_ns`"""
    time0_ns: int
    """log_time [ns] of theta0 and omega0"""
    window: tuple[int, int]
    """index range [start, stop) of the fitted frames"""
    residual: Array
    """(stop - start,) measured minus fitted theta [rad]; 0 for an estimator that fits no curve"""
    note: str = ""
    """reason for the choice of this estimator and this window"""
    violated: tuple[str, ...] = ()
    """assumptions of the estimator that the motion violated, each with the figure that shows it"""
    rolling: RollingContact | None = None
    """circle that replaces the plan's pivot point and radius; None if the edge does not roll on a curve"""
    by_radius: tuple[float, float] = (0.0, 0.0)
    """errors of phi [rad/m] and k [rad/s^2/m] per metre by which the edge's radius exceeds the planned one"""


@dataclass(frozen=True)
class SupportLine:
    """Line parallel to the pivot axis over which the object turns for a range of tipping angles theta.

    The line is the centre line of the rounding of the edge (or corner) that touches the table. Its place is
    given in the rest pose, from the centre line of the planned pivot. The object turns over it
    until a face lands that ends at the next line of the sequence, then over that one.
    """

    along_m: float
    """place from the planned pivot's centre line, horizontally towards where the object tips, at rest [m]"""
    up_m: float
    """place from the planned pivot's centre line, vertically, at rest [m]"""
    takes_over_rad: float
    """tipping angle theta [rad] from which this line carries, as the face before it lies on the table; 0 for
    the first line, at which the resting face ends"""
    takes_over_sd_rad: float = 0.0
    """standard deviation of that angle [rad], from the errors of the shape"""
    radius_m: float = 0.0
    """radius of the rounding [m]"""
    is_curve: bool = False
    """True if a curved flank touches from here on, which rolls: the place is that of the curve's first point,
    and the contact moves on from there"""

    def ahead_m(self, theta: float) -> float:
        """Horizontal distance [m] of this support line ahead of the planned pivot, at a tipping angle [rad].

        A strike that balances over this line at that angle determines a plane through this line; taken
        through the planned pivot instead, the plane misses the centre of mass by this distance.
        """
        return self.along_m * math.cos(theta) + self.up_m * math.sin(theta)


@dataclass(frozen=True)
class PivotPlace:
    """Measured place [m], against the planned pivot line, of the line about which a body turned at balance.

    Distances are horizontal and vertical in the pose at balance.
    """

    ahead: float
    """distance of the line ahead of the planned one, towards where the object tips"""
    sd: float
    """standard deviation of `ahead`, with that of the markers' place on the object"""
    above: float = 0.0
    """height over the planned line of the centre of curvature of what rolled on the table"""
    above_sd: float = 1.0
    """standard deviation of `above`, likewise; 1 m if it is not measured"""
    lift: float = 0.0
    """height of the planned line over its height at rest"""


@dataclass(frozen=True)
class EdgePath:
    """Measured path [m] of the planned pivot edge in the n frames of a strike, along and off the table."""

    slip: Array
    """(n,) displacement along the table since rest, less the rolling on the planned radius [m]"""
    lift: Array
    """(n,) height over the position at rest [m]"""
    covariance: Array
    """(n, 3, 3) covariance of theta, slip and lift in each frame [rad, m], random part only"""
    place_sd: float | None
    """standard deviation [m] of the edge's place by those of the markers on the object; None if no marker's
    place is known"""


@dataclass(frozen=True)
class TipMotion:
    """Motion of one strike: verdict, tipping angle theta(t) [rad], its phases, and fits to it."""

    strike_id: str
    """id of the strike"""
    plan_strike_id: str
    """id of the planned strike"""
    verdict: Verdict
    """outcome: good, rocked_back, slid, twisted, marker_lost, ..."""
    reason: str
    """explanation of the verdict, one sentence with the figures behind it"""
    angle: TipAngle | None = None
    """theta(t); None if no marker was followed"""
    phases: Phases | None = None
    """phases of theta(t); None if there is no theta(t)"""
    fit: MotionFit | None = None
    """the fit that the estimate uses; None if no estimator fits the motion"""
    alternatives: tuple[MotionFit, ...] = ()
    """fits by other estimators, for comparison"""
    energy_ratio: float | None = None
    """kinetic energy after the strike over the energy needed to reach the balance; None without a fit"""
    frame_rate_ratio: float | None = None
    """ratio of true to stated frame rate at which the motion would be a tip; None if it is a tip at the
    stated rate, or at none of the ratios tried"""
    pivot_place: PivotPlace | None = None
    """measured place of the line about which the object turned at balance; None if not measured"""
    carried_by: SupportLine | None = None
    """line that took over from the planned pivot edge before balance, to which the fit belongs; None if the
    fit belongs to the planned edge"""
    rest_turns: tuple[RestTurn, ...] = ()
    """turns of the object at rest against its planned pose, one by each marker whose place on it is known"""
    edge_path: EdgePath | None = None
    """path of the planned pivot edge in the frames of theta(t); None if no marker was followed"""
    followed_by: FollowedBy = FollowedBy.TAGS
    """what the object was followed by"""


class RadiusSource(enum.Enum):
    """Origin of the prior knowledge of an edge's radius; the value is its name in words."""

    STATED = "stated for all edges"
    EDGE = "stated for this edge"
    SCAN = "measured on the scan"
    BLURRED = "at most that on the scan"
    SHAPE = "part of the shape"
    ASSUMED = "not given"


@dataclass(frozen=True)
class RadiusPrior:
    """Radius [m] of one edge's rounding as known before any strike: mean, independent errors, origin."""

    mean: float
    """mean [m]"""
    common_sd: float
    """1 sigma [m] of the error that all edges of the object share"""
    own_sd: float
    """1 sigma [m] of this edge's own deviation"""
    source: RadiusSource
    """origin of the figures"""
    face_sd: float = 0.0
    """1 sigma [m] of the deviation that the edges of one resting face share"""

    @property
    def sd(self) -> float:
        """Standard deviation [m] of the radius, from its shared errors and its own together."""
        return math.hypot(self.common_sd, self.face_sd, self.own_sd)

    @property
    def blurred_sd(self) -> float | None:
        """`sd` [m] if a scan leaves the radius open, as its meshing rounds every edge; None otherwise."""
        return self.sd if self.source is RadiusSource.BLURRED else None


@dataclass(frozen=True)
class EquiPlane:
    """Equi-plane of one strike: the plane through the pivot's centre line and the centre of mass c.

    The centre line is the axis of the pivot edge's rounding, or the edge itself if it is sharp. In the object
    frame O the plane is normal . (c - point) = 0.
    """

    strike_id: str
    """id of the strike"""
    axis_id: str
    """id of the pivot axis"""
    point: Array
    """(3,) point on the centre line [m]"""
    direction: Array
    """(3,) unit vector of the axis; positive theta about it tips the object"""
    up: Array
    """(3,) unit vector, W's z in O at rest"""
    normal: Array
    """(3,) unit normal"""
    phi: float
    """balance angle [rad]"""
    sd_phi: float
    """random standard deviation of phi [rad]"""
    k: float | None
    """rate constant of the motion, m g R over the moment about the contact [rad/s^2]; None if not reported"""
    sd_k: float | None
    """standard deviation of k [rad/s^2]; None if k is"""
    cov_phi_k: float
    """covariance of phi and k [rad * rad/s^2]"""
    edge_radius: float
    """radius of the edge's rounding, or of curvature [m]"""
    edge_sd: float
    """standard deviation [m] of the centre line across itself, shared by the strikes on the axis"""
    heading: float = 0.0
    """heading [rad] of the strike on the table; it selects the component of the table tilt that acts"""
    face: str = ""
    """id of the resting face; its edges share its position error; "" if unknown"""
    rounded: bool = True
    """True if `edge_radius` is the edges' rounding, whose error all edges share; False if it is a curvature
    of the section"""
    level: int = 0
    """index of the levelling (set-up of the table), from 0; strikes on one levelling share its tilt"""
    radius_sd: float = 0.0
    """standard deviation [m] of a section's radius of curvature; a larger radius moves the line towards c by
    the same amount"""
    radius_prior: RadiusPrior | None = None
    """errors and origin of a rounded edge's radius, whose mean is `edge_radius`; None: the errors that
    `SystematicErrors` states for all edges"""
    wall: str = ""
    """id of the side face that rises from the edge; its place error is that of the face as a resting face;
    "" if unknown"""
    wall_lean: float = 0.0
    """lean [rad] of that side face: angle of its outward normal over the horizontal with `base_up` upwards"""
    phi_by_turn: Array | None = None
    """(3,) change of phi [rad] on a round rim by 1 sd of the markers' common turn about each axis of O, by
    which the object is put down turned; None where no such error acts"""
    by_radius: tuple[float, float] = (0.0, 0.0)
    """errors of phi [rad/m] and k [rad/s^2/m] per metre by which the radius exceeds `edge_radius`"""
    rest_turn: float = 0.0
    """turn of the object at rest towards the tip [rad], added to the measured balance angle to give `phi`"""
    phi_by_rest: Array | None = None
    """(n,) change of phi [rad] by 1 sd of each of the n errors of the turns at rest of all strikes, which
    markers show; None where no marker shows them"""
    facet_rad: float = 0.0
    """tipping angle [rad] at which the face that ends at the pivot line lies on the table: 0 for the resting
    face; larger if the line took over from the planned edge"""

    @property
    def base_up(self) -> Array:
        """Unit normal (3,), into the object, of the face that lies on the table and ends at the pivot line.

        It is in the object frame O. If the line is the planned edge, the face is the resting face, and the
        normal is W's z at rest. Otherwise the face is the one that landed before the object turned over the
        line.
        """
        if self.facet_rad == 0.0:
            return self.up
        ahead = np.cross(self.direction, self.up)
        return np.cos(self.facet_rad) * self.up - np.sin(self.facet_rad) * ahead


@dataclass(frozen=True)
class FlightEstimate:
    """Centre of mass c and shape of the inertia tensor, without its size, from a body's free flights.

    The eight numbers are c in the object frame O [m], and the five of `second_moments.scale_free`.
    """

    mean: Array
    """(8,) c (3) [m], then the numbers of the tensor's shape (5)"""
    covariance: Array
    """(8, 8) their covariance, with the errors of tag places, camera and the air's law"""
    tosses: tuple[str, ...] = ()
    """ids of the tosses used"""
