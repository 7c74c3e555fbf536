"""Session record: results of one session in a small file, instead of a gigabyte of images."""

from __future__ import annotations

import enum
import json
from typing import TYPE_CHECKING

from pydantic import Field

from analyze.errors import RecordingError
from schemas.document import (
    Document,
    DocumentError,
    Matrix3,
    Vector3,
    canonical_json,
    sha256_text,
    validate,
)
from schemas.input_file import read_text
from schemas.strike_plan import PlanMethod

if TYPE_CHECKING:
    from pathlib import Path

_REMEDY = "remove the file, and run `make reproduce` or analyse its recording again"


class Condition(enum.StrEnum):
    """Calibration under which a session is analysed: exact, or with random errors drawn and applied."""

    EXACT = "exact"
    """The rig's calibration as recorded."""
    DRAWN = "drawn"
    """Random calibration errors applied, and their sd stated to the estimators (miscalibrated.py)."""


class ThetaSource(enum.StrEnum):
    """Origin of the tipping angle theta(t): tracked in rendered images, or simulated without images."""

    IMAGES = "images"
    """Tracked in rendered images."""
    SIMULATED = "simulated theta(t)"
    """Simulated with the camera's noise, without images."""


class AxisMoment(Document):
    """Errors and sds of one pivot axis's moments of inertia, as fractions of the ground truth.

    Names with `i_edge` are of the moment about the edge, those with `i_com` of that about the parallel axis
    through the centre of mass. `distance_m` is R, the distance of the centre of mass from the pivot line.
    """

    axis_id: str
    """Id of the axis in the plan."""
    distance_m: float = Field(description="R, ground truth")
    i_edge_off: float = Field(description="relative error")
    i_edge_sd: float = Field(description="relative, as estimated")
    i_com_off: float
    """Relative error of the moment about the parallel axis through the centre of mass."""
    i_com_sd: float
    """Relative sd of that moment, as estimated; 0 for the paper's method, which states none."""
    i_edge_kg_m2: float | None = Field(default=None, description="ground truth")
    corrected_off: float | None = Field(
        default=None, description="relative error of the paper's corrected I about the edge (3.3.2)"
    )
    left_out: float | None = Field(
        default=None, description="fraction of stage two's frames that eq. (5) leaves out"
    )


class MethodAnswer(Document):
    """Estimates of one method, ours or the paper's, under one condition of calibration.

    Region masses are those of shell, upper and lower part of the body. The side of the dividing plane that
    the ground truth calls upper is called upper.
    """

    com_m: Vector3
    """Centre of mass in O [m]."""
    com_covariance_m2: Matrix3 | None = None
    """Covariance of the centre of mass [m^2]; None for the paper's method."""
    masses_kg: Vector3 | None = None
    """Region masses [kg]; None if the method found none."""
    masses_sd_kg: Vector3 | None = None
    """Standard deviations of the region masses [kg]; None for the paper's method."""
    masses_low_kg: Vector3 | None = None
    """Lower limits of their 95 % intervals [kg]; None for the paper's method."""
    masses_high_kg: Vector3 | None = None
    """Upper limits of their 95 % intervals [kg]; None for the paper's method."""
    moments: list[AxisMoment] = Field(default=[])
    """Errors of the moments of inertia, one entry per axis."""


class Angle(Document):
    """Balance angle phi [rad] of one strike: ground truth, our estimate, and that by the paper's method."""

    axis_id: str
    """Id of the strike's pivot axis."""
    strike_id: str
    """Id of the strike."""
    true_rad: float
    ours_rad: float
    ours_sd_rad: float
    """Standard deviation that our estimate states [rad]."""
    paper_rad: float | None
    """Angle at the sign change of the acceleration [rad]; None if the strike's verdict is not "good"."""
    frame_residual_rad: float = Field(description="rms of theta(t) minus its fit")


class Sensitivity(Document):
    """Errors of a result (centre of mass or region masses) at one level of noise added to an input."""

    level: float = Field(description="degrees, relative, or metres")
    ours: list[float | None]
    """Errors by our method, one per draw of the noise; None where it has no result.

    They are in m for the centre of mass; for region masses they are the mean error over the total mass.
    """
    paper: list[float | None]
    """Errors by the paper's method, in the same unit; None where it has no result."""


class Profile(Document):
    """Tipping angle theta(t) of one strike with its rate and acceleration, by frame (paper, Fig. 6)."""

    time_s: list[float]
    """Time since the fit's first frame [s]."""
    theta_rad: list[float]
    rate_rad_s: list[float]
    acceleration_rad_s2: list[float]
    phases: dict[str, tuple[int, int]]
    """Ranges [start, stop) of frames by name of the phase."""
    phi_rad: float
    """Balance angle by our fit [rad]."""
    phi_true_rad: float
    """Balance angle [rad], ground truth."""


class Section(Document):
    """Slice of the object through its centre of mass c: outline, and region of each cell (Fig. 12).

    Points are x, z [m] in the object frame O; the outline is the convex hull's, c is the estimated one. Cells
    are small cubes. A region is 0 for the shell, 1 for the upper and 2 for the lower part of the interior.
    """

    outline_m: list[tuple[float, float]]
    """Corners (x, z) [m] of the convex outline."""
    points_m: list[tuple[float, float]]
    """Middles (x, z) [m] of the slice's cells."""
    ours: list[int]
    """Estimated region of each cell."""
    true: list[int]
    """True region of each cell."""


class OwnChoice(Document):
    """Errors [m] of the centre of mass, by the paper's method and ours, for the paper's choice of strikes.

    The paper is VISAPP 2013. Both methods are given the true balance angles of these strikes, one strike per
    pivot axis. If the paper's planner has no strikes, `refused` says why, and there are no errors.
    """

    refused: str | None = Field(
        default=None, description="reason why the paper's planner has no strikes; null if it has"
    )
    axes: int = 0
    """Number of axes struck."""
    spread: float = Field(
        default=0.0, description="least singular value of the unit normals, over the root of their number"
    )
    open_direction: Vector3 | None = Field(
        default=None, description="unit vector in O along which c is not observable; null if there is none"
    )
    friction_needed: float = Field(default=0.0, description="least friction coefficient without sliding")
    paper_off_m: float | None = None
    """Distance of the centre of mass by the paper's method from the true one [m]."""
    ours_off_m: float | None = None
    """Distance of the centre of mass by our method from the true one [m]."""
    ours_sd_m: float | None = None
    """Standard deviation of the distance that our method states [m]."""
    ours_observed: bool = False
    """True if our method reports all directions as observed."""


class SessionRecord(Document):
    """Ground truth of one session on one object, and its estimates by our and by the paper's method."""

    object: str
    """Name of the object."""
    seed: int
    """Seed of the virtual session."""
    source: ThetaSource
    """Origin of the tipping angles."""
    method: PlanMethod
    """Method by which the strikes were planned."""
    strikes: int
    """Number of strikes used."""
    axes: int
    """Number of pivot axes among them."""
    singular: bool = Field(description="true if a direction of c is not observable")
    mass_kg: float
    """True mass [kg]."""
    volume_m3: float
    """Volume of the shape [m^3]."""
    centroid_m: Vector3
    """Centroid of the volume in O [m]."""
    true_com_m: Vector3
    """True centre of mass in O [m]."""
    true_masses_kg: Vector3
    """True masses of shell, upper and lower part [kg]."""
    cpu_s: float = Field(description="CPU time from phi and k to all results, one core")
    angles: list[Angle]
    """Balance angle of each strike used."""
    ours: dict[Condition, MethodAnswer]
    """Our answer by condition."""
    paper: dict[Condition, list[MethodAnswer]] = Field(
        description="one answer per round of strikes, as in the paper's tables"
    )
    naive_kg: dict[str, Vector3] = Field(description="naive region masses, with the estimated dividing plane")
    angle_noise: list[Sensitivity] = Field(default=[], description="c [m] over noise of the angles [deg]")
    moment_noise: list[Sensitivity] = Field(
        default=[], description="region masses' metric over relative errors of I and c"
    )
    scan_noise_com: list[Sensitivity] = Field(default=[], description="c [m] over scan noise [m]")
    scan_noise_masses: list[Sensitivity] = Field(
        default=[], description="region masses' metric over scan noise [m]"
    )
    own_choice: OwnChoice | None = None
    """Result from the strikes of the paper's own planner; None in older records."""
    profile: Profile | None = None
    """Motion of one strike for Fig. 6; None for most objects."""
    section: Section | None = None
    """Silhouette and slice for Fig. 12; None in older records."""

    @property
    def name(self) -> str:
        """Name of the record's file without suffix: object and seed, with marks for special sessions.

        Between object and seed is "-paper" if the paper's method planned the strikes; at the end is
        "-simulated" if the tipping angles were simulated without images.
        """
        planned = "" if self.method is PlanMethod.OURS else "-paper"
        simulated = "" if self.source is ThetaSource.IMAGES else "-simulated"
        return f"{self.object}{planned}-{self.seed}{simulated}"


class _SealedRecord(Document):
    """Content of a record's file: the record with its hash, by which damage is noticed."""

    sha256: str
    """SHA-256 of the record's canonical JSON, in hexadecimal digits."""
    record: SessionRecord


def sealed_json(record: SessionRecord) -> str:
    """JSON of a record's file: the record with its hash."""
    return _SealedRecord(sha256=sha256_text(canonical_json(record)), record=record).model_dump_json()


def read_records(folder: Path) -> list[SessionRecord]:
    """Read all session records (JSON) of a folder, in the order of their file names.

    The list is empty if the folder contains none.

    Raises:
        RecordingError: a file cannot be read, is not a session record, or does not match its hash.
    """
    found: list[SessionRecord] = []
    for path in sorted(folder.glob("*.json")):
        try:
            data = json.loads(read_text(path))
        except (OSError, ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: cannot be read ({error}): {_REMEDY}") from None
        try:
            sealed = validate(_SealedRecord, data, str(path), _REMEDY)
        except DocumentError as error:
            raise RecordingError(str(error)) from None
        if sha256_text(canonical_json(sealed.record)) != sealed.sha256:
            raise RecordingError(f"{path}: does not match its own hash, so it is damaged: {_REMEDY}")
        found.append(sealed.record)
    return found
