"""Estimate of one object over all its sessions in an archive, from their stored results.

Each quantity is estimated by the random-effects model of between_sessions.py. Its mean also has the error
that all sessions share, which no scatter between them can show: the shape, the edges, the mass. For the
centre of mass the sessions' rows hold that part, and the model takes the stated sds without it. Where they do
not, and for the moments, the smallest stated sd stands for it, which is at least as large; the model takes
the stated sds as they are, and the upper end of the sd between sessions supposes that they are all shared.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from scipy.special import chdtrc, chdtri

from analyze.batch.between_sessions import (
    SessionsEstimate,
    estimate_over_sessions,
    homogeneity,
    weighted_chi_square,
)
from analyze.batch.control_rows import is_measured, own_sd
from analyze.batch.sessions import Row, distinct_sessions
from analyze.batch.summary import QUANTITIES
from analyze.errors import ArchiveError
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array
from schemas.wording import counted

ResultTexts = Callable[[Sequence[str]], Mapping[str, str]]
"""results in JSON by key, of the keys given"""
HASH_LETTERS = 6
"""fewest letters of an object's hash that name it"""
MAX_NAMES = 8
"""largest number of objects that a message names"""


@dataclass(frozen=True)
class ObjectSession:
    """One session of the object, as the archive knows it."""

    url: str
    """URL of the recording"""
    created: str | None
    """start time, ISO 8601; None if unknown"""
    rig: str | None
    """name of the rig; None for an imported recording"""
    strikes_used: int
    """number of strikes that its result uses"""

    @property
    def day(self) -> str:
        """Date of the start; "no date" if it is unknown."""
        return (self.created or "")[:10] or "no date"


@dataclass(frozen=True)
class QuantityOverSessions:
    """One quantity of the object: values of the sessions that measured it, and the estimate from them."""

    name: str
    """name of the quantity"""
    unit: str
    """unit of all numbers here: mm or 10⁻⁶ kg m²"""
    sessions: tuple[int, ...]
    """indices of the sessions that measured it"""
    value: tuple[float, ...]
    """their values"""
    sd: tuple[float, ...]
    """their stated sds"""
    estimate: SessionsEstimate
    """mean, sd between sessions, and checks, from the sds without what all sessions share, where known"""
    between_high: float
    """upper end of the 95 % interval of the sd between sessions; NaN for one session"""
    stated_p_value: float
    """probability by chance of so large a scatter with the whole stated sds; NaN for one session"""
    shared_sd: float
    """sd of the error that all sessions share, or an upper bound of it"""
    shared_known: bool
    """True if the sessions' rows hold the shared sd, False if it is only bounded"""

    @property
    def shared_half(self) -> float:
        """Half width of the 95 % interval of the error that all sessions share, or an upper bound of it."""
        return SIGMAS_95 * self.shared_sd

    @property
    def half(self) -> float:
        """Half width of the mean's 95 % interval: by the scatter, and by what all sessions share.

        For one session it is that of the session's own interval.
        """
        if self.estimate.sessions == 1:
            return SIGMAS_95 * self.sd[0]
        return math.hypot(self.estimate.mean_half, self.shared_half)


@dataclass(frozen=True)
class ObjectOverSessions:
    """All that the archive's sessions of one object report together."""

    object: str
    """name of the object"""
    object_sha256: str
    """hash of the object file and its shape"""
    sessions: tuple[ObjectSession, ...]
    """sessions by start time, each recording once"""
    quantities: tuple[QuantityOverSessions, ...]
    """quantities that at least one session measured"""
    joint: tuple[float, int, float] | None
    """homogeneity of the centre of mass, its three components together: chi-square, degrees of freedom and
    p-value; None with one session, or if a session's covariance is not stored"""
    joint_own: bool
    """True if the covariances in it are without what all sessions share"""
    others: tuple[tuple[str, int], ...] = ()
    """other objects of that name: hash, number of rows"""


def object_over_sessions(
    rows: pa.Table, name: str, result_texts: ResultTexts = lambda _: {}
) -> ObjectOverSessions:
    """Estimate of one object over its sessions.

    Sessions belong to one object if their object files have one hash. Rows with one recording id count once,
    the newest content.

    Args:
        rows: table with one row per recording, from `read_recording_rows`.
        name: name of the object, or the first letters of its hash, at least six.
        result_texts: called with the keys of the object's sessions for their results in JSON, by key, which
            hold the covariance where the row does not; by default unknown.

    Raises:
        ArchiveError: no object with a result has that name, or several do.
    """
    good = [row for row in rows.to_pylist() if row["status"] == "ok"]
    chosen = _chosen(good, name)
    own = [row for row in good if row["object_sha256"] == chosen]
    sessions = distinct_sessions(own)
    joint, own_part = _joint_homogeneity(sessions, result_texts)
    others: dict[str, int] = {}
    for row in good:
        if row["object"] == own[0]["object"] and row["object_sha256"] != chosen:
            others[row["object_sha256"]] = others.get(row["object_sha256"], 0) + 1
    return ObjectOverSessions(
        object=own[0]["object"],
        object_sha256=chosen,
        sessions=tuple(
            ObjectSession(row["url"], row["created"], row["rig"], row["strikes_used"] or 0)
            for row in sessions
        ),
        quantities=tuple(_quantities(sessions)),
        joint=joint,
        joint_own=own_part,
        others=tuple(sorted(others.items())),
    )


def _chosen(good: Sequence[Row], name: str) -> str:
    """Hash of the object that `name` names: its name, or the first letters of its hash."""
    by_name = dict.fromkeys(row["object_sha256"] for row in good if row["object"] == name)
    by_hash = dict.fromkeys(
        row["object_sha256"]
        for row in good
        if len(name) >= HASH_LETTERS and row["object_sha256"].startswith(name.lower())
    )
    found = list(by_name or by_hash)
    if len(found) == 1:
        return found[0]
    if not found:
        names = list(dict.fromkeys(str(row["object"]) for row in good))
        more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
        known = f"{', '.join(names[:MAX_NAMES])}{more}" if names else "none: run `analyze batch` first"
        raise ArchiveError(f"{name}: no object of that name has a result; those that have: {known}")
    counts = ", ".join(
        f"{each[:8]} ({counted(sum(row['object_sha256'] == each for row in good), 'session')})"
        for each in found
    )
    raise ArchiveError(f"{name}: {len(found)} object files have that name: name one by its hash: {counts}")


def _quantities(sessions: Sequence[Row]) -> Iterator[QuantityOverSessions]:
    for name, column, sd_column, factor, unit in QUANTITIES:
        known = [i for i, row in enumerate(sessions) if is_measured(row, column) and row[sd_column]]
        if not known:
            continue
        value = factor * np.array([sessions[i][column] for i in known])
        sd = factor * np.array([sessions[i][sd_column] for i in known])
        shared = [sessions[i].get(sd_column.replace("_sd_", "_shared_sd_")) for i in known]
        stored = [factor * each for each in shared if each is not None and sd_column.startswith("com_")]
        split = len(stored) == len(known)
        model_sd = factor * np.array([own_sd(sessions[i], sd_column) for i in known]) if split else sd
        estimate = estimate_over_sessions(value, model_sd)
        freedom = len(known) - 1
        yield QuantityOverSessions(
            name=name,
            unit=unit,
            sessions=tuple(known),
            value=tuple(value.tolist()),
            sd=tuple(sd.tolist()),
            estimate=estimate,
            between_high=_upper_end(estimate, split),
            stated_p_value=float(chdtrc(freedom, weighted_chi_square(value, sd, 0.0)))
            if freedom
            else math.nan,
            # An error that all sessions share is in none of them larger than what it states.
            shared_sd=min([float(sd.min()), *([float(np.median(stored))] if split else [])]),
            shared_known=split,
        )


def _upper_end(estimate: SessionsEstimate, split: bool) -> float:
    """Upper end of the 95 % interval of the sd between sessions.

    Where the sds are not without what all sessions share (`split`), or the sessions agree so well that no sd
    between them explains it, it is that for sessions without errors of their own.
    """
    freedom, high = estimate.sessions - 1, estimate.between_interval[1]
    if not freedom or (split and high > 0):
        return high
    return estimate.scatter * math.sqrt(freedom / float(chdtri(freedom, 0.975)))


def _joint_homogeneity(
    sessions: Sequence[Row], result_texts: ResultTexts
) -> tuple[tuple[float, int, float] | None, bool]:
    """Joint test of the centre of mass, and whether the covariances are without what sessions share."""
    observed = [
        row
        for row in sessions
        if row["com_observed"] and all(row[f"com_{axis}_m"] is not None for axis in "xyz")
    ]
    own = [_matrix(row["com_own_covariance_m2"]) for row in observed]
    split = all(each is not None for each in own)
    if not split:
        texts = result_texts([row["key"] for row in observed])
        own = [_com_covariance(texts.get(row["key"], "")) for row in observed]
    stored = [each for each in own if each is not None]
    if len(observed) < 2 or len(stored) < len(observed):
        return None, False
    value = np.array([[row[f"com_{axis}_m"] for axis in "xyz"] for row in observed])
    try:
        return homogeneity(value, np.array(stored)), split
    except np.linalg.LinAlgError:
        return None, False


def _com_covariance(text: str) -> Array | None:
    """Covariance (3, 3) [m^2] of the centre of mass in a result in JSON; None if it holds none."""
    try:
        return _matrix(json.loads(text or "{}")["centre_of_mass"]["covariance"])
    except (ValueError, KeyError, TypeError):
        return None


def _matrix(numbers: object) -> Array | None:
    """Array (3, 3) of nine numbers, flat or row by row; None if they are something else."""
    try:
        found = np.array(numbers, dtype=np.float64)
    except (ValueError, TypeError):
        return None
    return found.reshape(3, 3) if found.size == 9 and np.all(np.isfinite(found)) else None
