"""Control charts of an archive: one per rig and quantity, and one per object and quantity.

Charts of a rig hold the sessions of one rig with one camera and one striker: another serial number, or
another striker, starts a new chart. Charts of an object hold its sessions on all rigs, as z-scores: value
less the baseline's weighted mean, over the sd that the session states. For the centre of mass that is the sd
without the errors that all sessions of the object may share, as these do not vary.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.batch.control_charts import (
    BASELINE,
    FALSE_ALARMS_PER_SESSION,
    MIN_SESSIONS,
    ControlChart,
    control_chart,
)
from analyze.batch.sessions import Row, distinct_sessions, start_seconds
from schemas.wording import counted


@dataclass(frozen=True)
class _RigQuantity:
    """Quantity of a rig: columns of the rows, and how it is shown."""

    name: str
    column: str
    sd_column: str
    origin: float
    factor: float
    unit: str


_DEGREES = math.degrees(1.0)
_RIG_QUANTITIES = (
    _RigQuantity("length scale by the tags", "range_ratio", "range_ratio_sd", 1.0, 1e2, "%"),
    _RigQuantity("turn of the resting object", "rest_turn_rad", "rest_turn_sd_rad", 0.0, _DEGREES, "°"),
    _RigQuantity("table tilt towards x", "tilt_x_rad", "tilt_x_sd_rad", 0.0, _DEGREES, "°"),
    _RigQuantity("table tilt towards y", "tilt_y_rad", "tilt_y_sd_rad", 0.0, _DEGREES, "°"),
    _RigQuantity(
        "striker speed over command", "striker_speed_ratio", "striker_speed_ratio_sd", 1.0, 1e2, "%"
    ),
    _RigQuantity("frame rate over nominal", "frame_rate_ratio", "frame_rate_ratio_sd", 1.0, 1e6, "ppm"),
)


@dataclass(frozen=True)
class SessionChart:
    """Control chart of one quantity, with the sessions that it holds."""

    subject: str
    """rig with its camera, or object with its hash, in words; with the striker where there are several"""
    of_rig: bool
    """True for a quantity of a rig, False for the z-scores of an object"""
    quantity: str
    """name of the quantity"""
    unit: str
    """unit of the values; sd for z-scores"""
    created: tuple[str, ...]
    """start times of the sessions, ISO 8601"""
    urls: tuple[str, ...]
    """URLs of the recordings"""
    stated_sd: tuple[float, ...]
    """stated sds in the unit; NaN where none is stated"""
    chart: ControlChart
    """the chart"""

    @property
    def severity(self) -> float:
        """Largest distance from the centre over the limit, of a session or of the EWMA; above 1 if out."""
        chart = self.chart
        distances = (
            np.abs(chart.value - chart.centre) / chart.half,
            np.abs(chart.ewma - chart.centre) / chart.ewma_half,
        )
        return float(max(each.max() for each in distances))


@dataclass(frozen=True)
class ControlSummary:
    """All control charts of an archive, and why others are missing."""

    charts: tuple[SessionChart, ...] = ()
    """charts: rigs first, by subject"""
    missing: tuple[str, ...] = ()
    """sentences on subjects without a chart, and on sessions left out"""

    @property
    def out_of_control(self) -> tuple[SessionChart, ...]:
        """Charts with a session outside its limits or a drift, the worst first."""
        found = [each for each in self.charts if not each.chart.in_control]
        return tuple(sorted(found, key=lambda each: -each.severity))

    @property
    def expected_false_alarms(self) -> float:
        """Upper bound of the number of signals that chance alone gives in all charts together."""
        return FALSE_ALARMS_PER_SESSION * sum(len(each.chart.value) for each in self.charts)


def control_summary(
    rows: Sequence[Row], quantities: Sequence[tuple[str, str, str, float, str]], baseline: int = BASELINE
) -> ControlSummary:
    """Control charts of all rigs and objects of an archive.

    Args:
        rows: rows of recordings with a result, as dicts by column.
        quantities: quantities of an object: name, column, column of the sd, and two entries not used here.
        baseline: number of sessions, from a chart's first, that give its limits.

    Raises:
        ValueError: the baseline is too small.
    """
    dated: list[Row] = [row for row in rows if math.isfinite(start_seconds(row["created"]))]
    notes: list[str] = []
    if undated := len(rows) - len(dated):
        left_out = "is" if undated == 1 else "are"
        notes.append(f"{counted(undated, 'session')} without a start time {left_out} in no chart")
    charts: list[SessionChart] = []
    for make, groups in (
        (_rig_series, _by_rig(distinct_sessions(dated))),
        (_object_series(quantities, baseline), _by_object(dated)),
    ):
        for subject, group in sorted(groups.items()):
            sessions = distinct_sessions(group)
            found = [
                each
                for each in (_charted(subject, series, baseline) for series in make(sessions))
                if each is not None
            ]
            charts += found
            if not found:
                notes.append(_why_missing(subject, len(sessions)))
    return ControlSummary(tuple(charts), tuple(_shortened(notes)))


@dataclass(frozen=True)
class _Series:
    """Values of one quantity by session, in the unit shown."""

    of_rig: bool
    quantity: str
    unit: str
    sessions: list[Row]
    value: list[float]
    sd: list[float]


def _charted(subject: str, series: _Series, baseline: int) -> SessionChart | None:
    chart = control_chart(np.array(series.value), np.array(series.sd), baseline)
    if chart is None:
        return None
    return SessionChart(
        subject=subject,
        of_rig=series.of_rig,
        quantity=series.quantity,
        unit=series.unit,
        created=tuple(row["created"] for row in series.sessions),
        urls=tuple(row["url"] for row in series.sessions),
        stated_sd=tuple(series.sd),
        chart=chart,
    )


def _by_rig(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Sessions by rig, camera and striker, in words; recordings that no rig made are left out."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row["rig"]:
            camera = f", camera {row['camera_serial']}" if row["camera_serial"] else ""
            found.setdefault((f"rig {row['rig']}{camera}", row["striker"] or ""), []).append(row)
    strikers = Counter(name for name, _ in found)
    return {
        f"{name}, striker {striker or 'not known'}" if strikers[name] > 1 else name: group
        for (name, striker), group in found.items()
    }


def _by_object(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Sessions by object, with the first letters of its hash."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(f"{row['object']} ({row['object_sha256'][:8]})", []).append(row)
    return found


def _rig_series(sessions: Sequence[Row]) -> Iterator[_Series]:
    for each in _RIG_QUANTITIES:
        known = [row for row in sessions if row[each.column] is not None]
        value = [each.factor * (row[each.column] - each.origin) for row in known]
        sds = [row[each.sd_column] for row in known]
        sd = [math.nan if one is None else each.factor * one for one in sds]
        yield _Series(True, each.name, each.unit, known, value, sd)


def _object_series(
    quantities: Sequence[tuple[str, str, str, float, str]], baseline: int
) -> Callable[[Sequence[Row]], Iterator[_Series]]:
    def series(sessions: Sequence[Row]) -> Iterator[_Series]:
        for quantity, column, sd_column, _, _ in quantities:
            known = [row for row in sessions if is_measured(row, column) and row[sd_column]]
            if not known:
                continue
            value = np.array([row[column] for row in known])
            sd = np.array([own_sd(row, sd_column) for row in known])
            weight = 1.0 / sd[:baseline] ** 2
            scores = (value - weight @ value[:baseline] / weight.sum()) / sd
            yield _Series(False, quantity, "sd", known, scores.tolist(), [1.0] * len(known))

    return series


def is_measured(row: Row, column: str) -> bool:
    """True if a session measured an object's quantity: it has a value, and not one by the shape alone."""
    measured = row.get(column.replace("_kg_m2", "_measured"), True) is not False
    return measured and bool(row["com_observed"]) and row[column] is not None


def own_sd(row: Row, sd_column: str) -> float:
    """Stated sd without the part that all sessions of the object may share, where that is known."""
    sd, shared = float(row[sd_column]), row.get(sd_column.replace("_sd_", "_shared_sd_"))
    if sd_column.startswith("com_") and shared is not None and shared < sd:
        return math.sqrt(sd**2 - shared**2)
    return sd


def _why_missing(subject: str, sessions: int) -> str:
    if sessions < MIN_SESSIONS:
        return f"{subject} has no chart: {counted(sessions, 'session')} of at least {MIN_SESSIONS}"
    return f"{subject} has no chart: no quantity varies over {MIN_SESSIONS} sessions that measured it"


def _shortened(notes: Sequence[str], shown: int = 6) -> list[str]:
    """Notes, the later ones of many in one."""
    if len(notes) <= shown:
        return list(notes)
    return [*notes[:shown], f"and {len(notes) - shown} more rigs or objects without a chart"]
