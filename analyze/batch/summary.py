"""Summary of an archive's results: objects, repeatability, drift, and the reasons for failures.

Repeatability is the standard deviation of an answer from session to session of one object (ISO 5725-1, 3.14),
including everything that changed between the sessions; the sd that the answers state is shown with it. Drift
is the slope of a weighted straight line over time.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from scipy.special import chdtrc, stdtr, stdtrit

from analyze.batch.control_charts import BASELINE
from analyze.batch.control_rows import ControlSummary, control_summary, is_measured
from analyze.batch.sessions import Row, distinct_sessions, start_seconds
from analyze.result.digits import ScaledUnit
from analyze.types import Array
from schemas.session_manifest import TimeSource

SECONDS_PER_DAY = 86400.0
MAX_CHANCE_PROBABILITY = 1e-4
"""p-value below which scatter or drift is reported; low, since a table has hundreds of values"""
INERTIA_UNIT = ScaledUnit(-6, "kg\u00a0m²")
"""unit of all moments of inertia, so that objects can be compared"""
QUANTITIES: tuple[tuple[str, str, str, float, str], ...] = (
    ("centre of mass x", "com_x_m", "com_sd_x_m", 1e3, "mm"),
    ("centre of mass y", "com_y_m", "com_sd_y_m", 1e3, "mm"),
    ("centre of mass z", "com_z_m", "com_sd_z_m", 1e3, "mm"),
    ("Ixx", "ixx_kg_m2", "ixx_sd_kg_m2", INERTIA_UNIT.factor, INERTIA_UNIT.label),
    ("Iyy", "iyy_kg_m2", "iyy_sd_kg_m2", INERTIA_UNIT.factor, INERTIA_UNIT.label),
    ("Izz", "izz_kg_m2", "izz_sd_kg_m2", INERTIA_UNIT.factor, INERTIA_UNIT.label),
)
"""per quantity: name, column of the results, column of its sd, factor from the column's unit to the shown
one, shown unit"""


@dataclass(frozen=True)
class Repeated:
    """Repeatability of one quantity of one object over its sessions (recordings), in `unit`."""

    object: str
    """name of the object"""
    object_sha256: str
    """hash of the object file and its shape"""
    quantity: str
    """name of the quantity, such as Ixx"""
    unit: str
    """unit of the quantity: mm or 10⁻⁶ kg m²"""
    sessions: int
    """number of sessions with a value"""
    mean: float
    """mean of the sessions' values, each weighted by 1 / stated sd², in `unit`"""
    scatter: float
    """sd of the values from session to session, in `unit`; NaN for one session"""
    stated: float
    """median of the sd that the sessions' results state, in `unit`"""
    chi_square: float
    """chi-square of the sessions about their mean, per degree of freedom; far above 1 if they scatter more
    than stated, NaN for one session"""
    drift: float
    """drift [`unit` per day]; NaN for fewer than three sessions with a start time, or if these span less than
    an hour"""
    drift_sd: float
    """sd of the drift [`unit` per day]; NaN if `drift` is"""
    drift_half: float
    """half width of the drift's 95 % interval (Student's t, for few sessions); NaN if `drift` is"""
    drift_freedom: int
    """degrees of freedom of the drift: sessions with a start time, less two"""

    @property
    def stands_out(self) -> str:
        """In words, how a quantity varies over an object's sessions beyond chance; "" if it does not.

        The text "scatters 1.8 times as much as stated" says that the sessions' values deviate from their mean
        by 1.8 times the sd that the sessions' results state; "drifts" says that the values change steadily
        with time. Both are joined by ", ". Beyond chance is a p-value below `MAX_CHANCE_PROBABILITY` (1e-4).
        """
        said: list[str] = []
        if (
            self.sessions > 1
            and chdtrc(self.sessions - 1, self.chi_square * (self.sessions - 1)) < MAX_CHANCE_PROBABILITY
        ):
            said.append(f"scatters {math.sqrt(self.chi_square):.1f} times as much as stated")
        if (
            self.drift_sd > 0
            and 2 * stdtr(self.drift_freedom, -abs(self.drift) / self.drift_sd) < MAX_CHANCE_PROBABILITY
        ):
            said.append("drifts")
        return ", ".join(said)


@dataclass(frozen=True)
class Summary:
    """Summary of all results of an archive of recordings: counts, failures, repeatability, objects."""

    recordings: int
    """number of distinct recordings with results, without those that failed"""
    failures: tuple[tuple[str, int, str], ...]
    """kind of failure, number of recordings, one example of the reason"""
    repeated: tuple[Repeated, ...]
    """repeatability of each measured quantity of each object, by object"""
    objects: tuple[tuple[str, str, int, int, int, int], ...]
    """per object: name, SHA-256, and numbers of sessions, of strikes recorded and used, and of sessions whose
    frame times come from a file instead of a rig's clock"""
    control: ControlSummary = field(default_factory=ControlSummary)
    """control charts of the rigs, and of the objects' values"""

    @property
    def standing_out(self) -> tuple[Repeated, ...]:
        """Quantities, each of one object, that vary over its sessions beyond chance, the largest chi^2 first.

        Their values scatter more than the sd that the sessions state, drift with time, or both. Chi^2 is that
        of the values about their mean, per degree of freedom.
        """
        found = [each for each in self.repeated if each.stands_out]
        return tuple(sorted(found, key=lambda each: -each.chi_square))


def summarise(rows: pa.Table, baseline: int = BASELINE) -> Summary:
    """Summarise an archive's results: objects, repeatability per object, failures by kind, control charts.

    Args:
        rows: table with one row per recording, from `read_recording_rows`.
        baseline: number of sessions, from a control chart's first, that give its limits; at least 8.

    Returns:
        Number of recordings with results; the objects with their numbers of sessions and strikes; for each
        quantity of each object, its sd from session to session and its drift (change per day over the
        sessions), in the unit named with it (mm, 10^-6 kg m^2 or g); and the failures by kind.
    """
    listed = rows.to_pylist()
    good = [row for row in listed if row["status"] == "ok"]
    listed_by_object: dict[tuple[str, str], list[Row]] = {}
    for row in good:
        listed_by_object.setdefault((row["object"], row["object_sha256"]), []).append(row)
    by_object = {key: distinct_sessions(sessions) for key, sessions in listed_by_object.items()}
    failures: dict[str, list[str]] = {}
    for row in listed:
        if row["status"] != "ok":
            failures.setdefault(row["failure"], []).append(row["reason"])
    return Summary(
        recordings=len(good),
        failures=tuple(
            (kind, len(reasons), reasons[0])
            for kind, reasons in sorted(failures.items(), key=lambda item: -len(item[1]))
        ),
        repeated=tuple(
            found for key, sessions in sorted(by_object.items()) for found in _repeated(*key, sessions)
        ),
        objects=tuple(
            (
                name,
                sha256,
                len(each),
                _total(each, "strikes_recorded"),
                _total(each, "strikes_used"),
                _without_rig_clock(each),
            )
            for (name, sha256), each in sorted(by_object.items())
        ),
        control=control_summary(good, QUANTITIES, baseline),
    )


def _total(sessions: Sequence[Row], column: str) -> int:
    return sum(row[column] for row in sessions)


def _without_rig_clock(sessions: Sequence[Row]) -> int:
    return sum(row["time_source"] not in {None, TimeSource.DEVICE_MAPPED.value} for row in sessions)


def _repeated(name: str, sha256: str, sessions: Sequence[Row]) -> Iterator[Repeated]:
    for quantity, column, sd_column, factor, unit in QUANTITIES:
        # A value taken from the shape repeats without being measured.
        known = [
            (row[column], row[sd_column], start_seconds(row["created"]))
            for row in sessions
            if is_measured(row, column) and row[sd_column]
        ]
        if known:
            yield _statistics(name, sha256, quantity, unit, factor, known)
    for region in dict.fromkeys(each["name"] for row in sessions for each in row["regions"] or []):
        # If the body is not a shell with two uniform parts, its region masses are the middle of the interval
        # that any filling allows: they repeat without being measured.
        known = [
            (each["mass_kg"], each["sd_kg"], start_seconds(row["created"]))
            for row in sessions
            for each in row["regions"] or []
            if each["name"] == region
            and row["regions_explained"] is not False
            and each["mass_kg"] is not None
            and each["sd_kg"]
        ]
        if known:
            yield _statistics(name, sha256, f"mass, {region}", "g", 1e3, known)


def _statistics(
    name: str,
    sha256: str,
    quantity: str,
    unit: str,
    factor: float,
    known: Sequence[tuple[float, float, float]],
) -> Repeated:
    """Statistics of one quantity of one object over its sessions: mean, spread, chi^2 and drift.

    They are in `unit`: weighted mean; scatter (sd of the values from session to session) and median of the
    stated sd; chi^2 about the mean per degree of freedom; drift (trend over the start times) per day, with
    its sd and half 95 % interval.

    Args:
        name: name of the object.
        sha256: hash of the object file and its shape.
        quantity: name of the quantity.
        unit: unit of the result.
        factor: factor from SI units to `unit`.
        known: value and standard deviation in SI units, and start time [s since 1970], of each session.
    """
    value, sd, when = (np.array(column, dtype=np.float64) for column in zip(*known, strict=True))
    weight = 1.0 / sd**2
    mean = float(weight @ value / weight.sum())
    many = len(value)
    drift, drift_sd = _drift(value, sd, when)
    freedom = int(np.isfinite(when).sum()) - 2
    return Repeated(
        object=name,
        object_sha256=sha256,
        quantity=quantity,
        unit=unit,
        sessions=many,
        mean=factor * mean,
        scatter=factor * float(value.std(ddof=1)) if many > 1 else math.nan,
        stated=factor * float(np.median(sd)),
        chi_square=float(weight @ (value - mean) ** 2) / (many - 1) if many > 1 else math.nan,
        drift=factor * drift,
        drift_sd=factor * drift_sd,
        drift_half=factor * drift_sd * float(stdtrit(max(freedom, 1), 0.975)),
        drift_freedom=freedom,
    )


def _drift(value: Array, sd: Array, when: Array) -> tuple[float, float]:
    """Drift of a quantity over sessions: slope of a weighted straight line through its values.

    Args:
        value: (n,) value of the quantity in each session.
        sd: (n,) standard deviations that the sessions' results state.
        when: (n,) start times [s]; sessions with NaN are left out.

    Returns:
        Slope [unit of `value` per day] and its standard deviation, from the stated ones or from the scatter
        about the line where that is larger; both NaN for fewer than three sessions with a start time, or if
        these span less than an hour.
    """
    known = np.isfinite(when)
    value, sd, when = value[known], sd[known], when[known]
    if len(when) < 3 or np.ptp(when) < 3600:
        return math.nan, math.nan
    days = (when - when.mean()) / SECONDS_PER_DAY
    # The stated sd, or the sessions' scatter where that is larger.
    weight = 1.0 / sd**2
    days = days - weight @ days / weight.sum()
    slope = float(weight @ (days * value) / (weight @ days**2))
    left = value - weight @ value / weight.sum() - slope * days
    wider = max(1.0, float(weight @ left**2) / (len(when) - 2))
    return slope, math.sqrt(wider / float(weight @ days**2))
