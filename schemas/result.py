"""The Result document, printed by `analyze estimate --json`.

Schema 2.0 renamed keys of 1.x (docs/reference/renamed-keys.md); documents of 1.x are read and take the new
names.
"""

from __future__ import annotations

import enum
from typing import Any, ClassVar

from pydantic import Field, model_validator

from schemas.contact_result import ContactPropertiesResult
from schemas.contents_result import ContentsResult
from schemas.document import Document, SparseDocument, Vector3
from schemas.fixture_result import FixtureResult
from schemas.quantity import RENAMED, Quantity, RenamedDocument, json_entries
from schemas.result_inputs import ResultInputs
from schemas.robustness import AlternativeResult
from schemas.strike_result import StrikeResult
from schemas.toss_result import FlightResult

RESULT_VERSION = "2.0"
"""Schema version of results, reports and comparisons; recordings and plans have their own."""


class WarningCode(enum.Enum):
    """Codes of warnings about a result; the sentence of a warning explains its code."""

    RECORDING_INCOMPLETE = "recording_incomplete"
    RECORDING_RECOVERED = "recording_recovered"
    RECORDING_COMPACTED = "recording_compacted"
    RECORDINGS_DISAGREE = "recordings_disagree"
    FEW_STRIKES = "few_strikes"
    DIRECTION_UNOBSERVED = "direction_unobserved"
    OBJECT_OVERRIDDEN = "object_overridden"
    STRIKES_EXCLUDED = "strikes_excluded"
    FRAMES_LOST = "frames_lost"
    MARKERS_INCLUDED = "markers_included"
    ESTIMATORS_DISAGREE = "estimators_disagree"
    CENTRE_OUTSIDE_SHAPE = "centre_outside_shape"
    POOR_FIT = "poor_fit"
    GRAVITY_ASSUMED = "gravity_assumed"
    INERTIA_FROM_PRIOR = "inertia_from_prior"
    REGIONS_UNCERTAIN = "regions_uncertain"
    UNKNOWN_MARKER = "unknown_marker"
    MARKERS_UNPLACED = "markers_unplaced"
    ROLLING_CONTACT = "rolling_contact"
    MARKERS_SUBTRACTED = "markers_subtracted"
    STRIKE_NOT_PREDICTED = "strike_not_predicted"
    MOMENT_IMPOSSIBLE = "moment_impossible"
    GRAVITY_DISAGREES = "gravity_disagrees"
    FILLING_ASSUMED_RIGID = "filling_assumed_rigid"
    FILLING_UNEXPLAINED = "filling_unexplained"
    FRAME_RATE_WRONG = "frame_rate_wrong"
    FRAME_RATE_UNCHECKED = "frame_rate_unchecked"
    SHAPE_ERROR_ASSUMED = "shape_error_assumed"
    STRIKES_SCATTER = "strikes_scatter"
    REST_TURNED = "rest_turned"
    MARKER_MOVED = "marker_moved"
    NOT_RIGID = "not_rigid"
    PRINT_DIFFERS = "print_differs"
    TOSSES_NOT_USED = "tosses_not_used"


class ResultWarning(Document):
    """One warning about a result: its code and a sentence for the user."""

    code: WarningCode
    text: str


class AxisMoment(Document):
    """Moments of inertia [kg m^2] about one pivot axis and about its parallel through c.

    c is the centre of mass.
    """

    axis_id: str
    """name of the pivot edge"""
    direction: Vector3 = Field(description="unit direction of the axis, in O")
    i_edge: Quantity = Field(description="moment about the pivot edge")
    i_com: Quantity = Field(description="moment about the parallel through c")


class RegionResult(SparseDocument):
    """Mass of one region of the object.

    A region is the shell (outer wall), the interior on one side of a dividing plane (upper or lower), or a
    labelled part.
    """

    left_out: ClassVar[tuple[str, ...]] = ("limits_kg",)

    name: str
    """shell, upper, lower, or a label's name"""
    mass: Quantity
    """mass of the region [kg]"""
    limits_kg: list[float] | None = Field(
        default=None,
        description=(
            "least and greatest mass under any filling of a uniform shell; null in older results and the"
            " paper's"
        ),
    )

    @model_validator(mode="before")
    @classmethod
    def _take_new_name(cls, data: Any) -> Any:
        entries = json_entries(data)
        if entries is None or "name" not in entries:
            return data
        return {**entries, "name": RENAMED["RegionName"].get(entries["name"], entries["name"])}


class Regions(RenamedDocument, SparseDocument):
    """Masses of the shell (outer wall) and of the interior on either side of a dividing plane.

    The plane is n.x = offset in O, the object's frame: x a position, n the unit normal, which points towards
    the upper region. Intervals hold for a model body: a uniform shell with two uniform parts inside, on
    either side of a plane, or one of them a ball (a lump, a void). If no model body has the measured mass,
    centre of mass and inertia (`explained` is false), the intervals are the limits under any filling, and the
    plane divides the object in the middle of its longest direction.
    """

    left_out: ClassVar[tuple[str, ...]] = ("explained", "shell_thickness")

    @model_validator(mode="before")
    @classmethod
    def _take_new_baseline_names(cls, data: Any) -> Any:
        entries = json_entries(data)
        baselines = None if entries is None else json_entries(entries.get("baselines"))
        if entries is None or baselines is None:
            return data
        renamed = RENAMED["RegionName"]
        return {
            **entries,
            "baselines": {renamed.get(name, name): masses for name, masses in baselines.items()},
        }

    regions: list[RegionResult]
    """mass of each region"""
    dividing_plane_normal: Vector3 | None = Field(description="unit normal n, towards the upper region")
    dividing_plane_offset_m: float | None = Field(description="offset n.x [m]")
    dividing_plane_offset_interval95_m: list[float] | None = None
    """lower and upper end of the offset's 95 % interval [m]"""
    baselines: dict[str, list[float]] = Field(
        default={}, description="naive answers: masses [kg] of the regions by name of the answer"
    )
    explained: bool | None = Field(
        default=None,
        description="true if such a body can have the moments; null in older results and the paper's",
    )
    shell_thickness: Quantity | None = Field(
        default=None, description="estimated shell thickness [m] where the object file gives none"
    )


class PartResult(Document):
    """Mass, volume and density of one part that the object file labels, taken as of uniform density.

    The mass is not observed if the object's measured mass, centre of mass and moments of inertia leave it
    open.
    """

    name: str
    """name of the part in the object file"""
    mass: Quantity
    """mass [kg]"""
    volume_m3: float = Field(description="volume [m^3]")
    density: Quantity
    """density [kg/m^3]"""


class Parts(Document):
    """Masses of the parts that the object file labels, and the misfit of an object of such parts.

    The misfit compares its mass, centre of mass and moments of inertia with the measured ones.
    """

    parts: list[PartResult]
    """mass and density of each part"""
    uniform: list[float] = Field(description="naive answer: masses [kg] with one density for all parts")
    misfit: float = Field(
        description=(
            "rms of the moments' residuals over their sd; far above 1 if a part is missing or not uniform"
        )
    )


class Filling(RenamedDocument):
    """Filling of the object's interior up to an estimated level, with the mass of the shell around it.

    The level is the height [m] of the filling's surface over the origin of the object frame O, along the
    direction that was up; the shell is the outer wall. The 95 % intervals may be asymmetric.
    """

    name: str
    """name of the filling in the object file"""
    along: Vector3 = Field(description="unit direction that was up when the object was filled, in O")
    level: Quantity = Field(description="height of the filling's surface along `along` from O [m]")
    filled_share: Quantity = Field(description="filled share of the interior's volume")
    mass: Quantity
    """mass of the filling [kg]"""
    density: Quantity
    """density of the filling [kg/m^3]"""
    shell: Quantity = Field(description="mass of the shell")
    shell_thickness: Quantity | None = Field(
        default=None, description="shell thickness; null where the object file gives it"
    )
    misfit: float = Field(
        description="rms of the moments' residuals over their sd; far above 1 if there is no such filling"
    )


class TableTilt(Document):
    """Tilt of the table: angles [rad] of the vertical from the table's normal towards W's x and y.

    The vertical leans towards the table's higher side. `source` of an angle is measured (by the strikes),
    given (the rig file's level reading) or prior (assumed, with no measurement or reading). W is the world
    frame, z along the table's normal.
    """

    recordings: list[int] = Field(description="numbers of the recordings made on this levelling, from 1")
    towards_x: Quantity
    """angle towards W's +x, positive if that side of the table is the higher one"""
    towards_y: Quantity
    """angle towards W's +y, positive if that side of the table is the higher one"""


class EdgeRadiusResult(Document):
    """Radius [m] of one pivot edge's rounding: as all strikes determine it, and as it was known before."""

    axis_id: str
    """name of the pivot edge"""
    radius: Quantity
    """radius by all strikes together [m]"""
    expected_m: float = Field(description="radius expected before the strikes")
    expected_sd_m: float = Field(description="1 sigma of the expected radius")
    expected_from: str = Field(
        description="origin of the expected radius in words: stated for all edges, stated for this edge, "
        "measured on the scan, at most that on the scan, part of the shape, or not given"
    )


class FrameTimes(Document):
    """Source of the frame times of an imported recording, and limits and estimate of its true frame rate.

    A rate ratio is the true frame rate over the stated one.
    """

    recording: int = Field(ge=1, description="number of the recording by start time")
    source: str = Field(description="the manifest's `time_source`")
    sd_s: float = Field(ge=0, description="1 sigma of a frame's time against the others'")
    frame_rate_hz: float = Field(description="stated frame rate")
    frame_rate_sd_hz: float | None = Field(
        default=None, description="1 sigma as a drop measured it; null if only stated"
    )
    contact_sd_s: float | None = Field(
        description=(
            "1 sigma of a strike's contact time, from the onset of motion; null where no strike has one"
        )
    )
    rate_limits: list[float] | None = Field(
        description="least and greatest ratio that any filling of the shape allows; null if none was found"
    )
    rate_ratio: Quantity | None = Field(
        description=(
            "ratio from axes at different distances from the centre of mass; null where there are none"
        )
    )
    possible: bool = Field(description="true if the stated rate can be the true one")
    likely_rate_hz: float | None = Field(
        description="the one usual rate that is possible where the stated one is not; null otherwise"
    )


class Result(SparseDocument):
    """Result of an estimate, printed by `analyze estimate --json`: strikes, mass, centre of mass, inertia.

    Further entries are the masses of regions and parts, warnings, and a verdict on what to trust and what to
    repeat. Vectors and matrices are in O, the object's frame.
    """

    left_out: ClassVar[tuple[str, ...]] = (
        "table_tilt",
        "edge_radii",
        "robustness",
        "parts",
        "verdict",
        "parameters_covariance",
        "filling",
        "frame_times",
        "fixture",
        "contents",
        "contact_properties",
        "flight",
    )

    schema_version: str = RESULT_VERSION
    inputs: ResultInputs
    warnings: list[ResultWarning]
    strikes: list[StrikeResult]
    mass: Quantity
    """mass of the object [kg]"""
    centre_of_mass: Quantity
    """centre of mass [m, in O]"""
    centre_of_mass_paper: Quantity | None = None
    """centre of mass by the paper's method; null if not computed"""
    moments: list[AxisMoment]
    """moments of inertia about each pivot axis"""
    inertia: Quantity = Field(
        description="tensor about the centre of mass; `source` is prior as soon as one entry is"
    )
    inertia_measured: list[list[bool]] | None = Field(
        default=None,
        description=(
            "per entry: true if strikes measured it, false if the shape's prior stands; null in older results"
        ),
    )
    regions: Regions | None
    """masses of the regions; null if not computed"""
    regions_paper: Regions | None = None
    """regions by the paper's method; null if not computed"""
    verdict: list[str] | None = Field(
        default=None, description="sentences on what to trust, doubt and repeat; not written in older results"
    )
    parameters_covariance: list[list[float]] | None = Field(
        default=None,
        description=(
            "(10, 10) covariance of mass, centre of mass, Ixx, Iyy, Izz, Ixy, Ixz, Iyz about it, SI; not"
            " written in older results"
        ),
    )
    parts: Parts | None = Field(
        default=None, description="labelled parts; not written where the object file labels none"
    )
    filling: Filling | None = Field(
        default=None, description="filling; not written where the object file names none"
    )
    table_tilt: list[TableTilt] | None = Field(
        default=None, description="one per levelling; not written in older results"
    )
    edge_radii: list[EdgeRadiusResult] | None = Field(
        default=None, description="one per pivot edge that is rounded; not written in older results"
    )
    frame_times: list[FrameTimes] | None = Field(
        default=None, description="recordings whose times come from a file's time stamps; else not written"
    )

    fixture: FixtureResult | None = Field(
        default=None, description="what was struck with the object and subtracted; not written without one"
    )

    contents: ContentsResult | None = Field(
        default=None, description="whether something moves inside; not written in older results"
    )
    contact_properties: ContactPropertiesResult | None = Field(
        default=None,
        description="friction and restitution on the table; not written in older results, or if none is seen",
    )

    flight: FlightResult | None = Field(
        default=None, description="tosses and what they determine; not written where nothing was tossed"
    )

    robustness: list[AlternativeResult] | None = Field(
        default=None, description="changes under alternatives; not written where c is not observed"
    )

    @model_validator(mode="before")
    @classmethod
    def _take_new_version(cls, data: Any) -> Any:
        """Rewrite warning codes and version of a result of schema 1.x; leave other data unchanged.

        Returns:
            The entries in the form of the present version. Keys of inner documents are left: these documents
            rename their own.
        """
        entries = json_entries(data)
        if entries is None or not str(entries.get("schema_version", RESULT_VERSION)).startswith("1."):
            return data
        warnings = [_with_new_code(each) for each in entries.get("warnings", [])]
        return {**entries, "schema_version": RESULT_VERSION, "warnings": warnings}


def _with_new_code(warning: Any) -> Any:
    entries = json_entries(warning)
    if entries is None or entries.get("code") not in RENAMED["WarningCode"]:
        return warning
    return {**entries, "code": RENAMED["WarningCode"][entries["code"]]}
