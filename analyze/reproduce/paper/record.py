"""Session record: results of one session in a small file, instead of a gigabyte of images."""

from __future__ import annotations

import enum
import json
from typing import TYPE_CHECKING

from pydantic import Field, field_validator

from analyze.errors import RecordingError
from schemas.document import Document, DocumentError, Matrix3, Vector3, validate
from schemas.strike_plan import PlanMethod

if TYPE_CHECKING:
    from pathlib import Path


_FORMER_NAIVE_NAMES = {"surface": "shell", "surface_and_uniform": "shell_and_uniform"}
"""Present names of naive answers, by their names in older records."""


class Condition(enum.StrEnum):
    """Calibration under which a session is analysed."""

    EXACT = "exact"
    """The rig's calibration as recorded."""
    DRAWN = "drawn"
    """Calibration errors drawn, and their sd stated: see miscalibrated.py."""


class ThetaSource(enum.StrEnum):
    """Origin of theta(t): tracked in rendered images, or simulated with the camera's noise."""

    IMAGES = "images"
    SIMULATED = "simulated theta(t)"


class AxisMoment(Document):
    """Errors of the moments of inertia of one pivot axis, relative to the ground truth."""

    axis_id: str
    distance_m: float = Field(description="R, ground truth")
    i_edge_off: float = Field(description="relative error")
    i_edge_sd: float = Field(description="relative, as estimated")
    i_com_off: float
    i_com_sd: float
    i_edge_kg_m2: float | None = Field(default=None, description="ground truth")
    corrected_off: float | None = Field(
        default=None, description="relative error of the paper's corrected I about the edge (3.3.2)"
    )
    left_out: float | None = Field(
        default=None, description="fraction of stage two's frames that eq. (5) leaves out"
    )


class MethodAnswer(Document):
    """Estimates of one method under one condition; region masses are those of shell, upper and lower part.

    The side of the dividing plane that the ground truth calls upper is called upper.
    """

    com_m: Vector3
    com_covariance_m2: Matrix3 | None = None
    masses_kg: Vector3 | None = None
    masses_sd_kg: Vector3 | None = None
    masses_low_kg: Vector3 | None = None
    masses_high_kg: Vector3 | None = None
    moments: list[AxisMoment] = Field(default=[])


class Angle(Document):
    """Angle phi of one strike's equi-plane, ground truth and estimates."""

    axis_id: str
    strike_id: str
    true_rad: float
    ours_rad: float
    ours_sd_rad: float
    paper_rad: float | None
    frame_residual_rad: float = Field(description="rms of theta(t) minus its fit")


class Sensitivity(Document):
    """Errors of a result at one level of an input's error."""

    level: float = Field(description="degrees, relative, or metres")
    ours: list[float | None]
    paper: list[float | None]


class Profile(Document):
    """theta(t) of one strike and its derivatives (paper, Fig. 6)."""

    time_s: list[float]
    theta_rad: list[float]
    rate_rad_s: list[float]
    acceleration_rad_s2: list[float]
    phases: dict[str, tuple[int, int]]
    phi_rad: float
    phi_true_rad: float


class Section(Document):
    """Silhouette, and the regions in a slice through c, in x and z of O (paper, Fig. 12)."""

    outline_m: list[tuple[float, float]]
    points_m: list[tuple[float, float]]
    ours: list[int]
    true: list[int]


class OwnChoice(Document):
    """Centre of mass from the paper's own three strikes, given angles without error."""

    refused: str | None = Field(
        default=None, description="reason why the paper's planner has no strikes; null if it has"
    )
    axes: int = 0
    spread: float = Field(
        default=0.0, description="least singular value of the unit normals, over the root of their number"
    )
    open_direction: Vector3 | None = Field(
        default=None, description="unit vector in O along which c is not observable; null if there is none"
    )
    friction_needed: float = Field(default=0.0, description="least friction coefficient without sliding")
    paper_off_m: float | None = None
    ours_off_m: float | None = None
    ours_sd_m: float | None = None
    ours_observed: bool = False


class SessionRecord(Document):
    """Ground truth and estimates of one session on one object."""

    object: str
    seed: int
    source: ThetaSource
    method: PlanMethod
    strikes: int
    axes: int
    singular: bool = Field(description="true if a direction of c is not observable")
    mass_kg: float
    volume_m3: float
    centroid_m: Vector3
    true_com_m: Vector3
    true_masses_kg: Vector3
    cpu_s: float = Field(description="CPU time from phi and k to all results, one core")
    angles: list[Angle]
    ours: dict[Condition, MethodAnswer]
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
    profile: Profile | None = None
    section: Section | None = None

    @field_validator("naive_kg", mode="before")
    @classmethod
    def _current_names(cls, value: object) -> object:
        """Rename naive answers of older records, so that their sessions need not be recorded again."""
        if not isinstance(value, dict):
            return value
        return {_FORMER_NAIVE_NAMES.get(name, name): masses for name, masses in value.items()}

    @property
    def name(self) -> str:
        """Name of the record's file, without suffix."""
        planned = "" if self.method is PlanMethod.OURS else "-paper"
        simulated = "" if self.source is ThetaSource.IMAGES else "-simulated"
        return f"{self.object}{planned}-{self.seed}{simulated}"


def read_records(folder: Path) -> list[SessionRecord]:
    """Read all session records of a folder, in the order of their file names.

    Raises:
        RecordingError: a file is not a session record.
    """
    found: list[SessionRecord] = []
    for path in sorted(folder.glob("*.json")):
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise RecordingError(
                f"{path}: cannot be read ({error}): remove the file and analyse its recording again"
            ) from None
        try:
            found.append(
                validate(SessionRecord, data, str(path), "remove the file and analyse its recording again")
            )
        except DocumentError as error:
            raise RecordingError(str(error)) from None
    return found
