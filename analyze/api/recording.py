"""`Recording` with its strikes and their fits, the result of `analyze.load`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.api.tables import data_frame, html_table, text_table
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.read_evidence import read_evidence, read_head
from schemas.wording import counted

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from analyze.progress import Progress
    from analyze.types import Array, MotionFit, TipMotion
    from schemas.object_spec import ObjectSpec


@dataclass(frozen=True, eq=False)
class StrikeFit:
    """Fitted motion of one strike: balance angle phi, rate constant k, tipping angle theta(t) since rest.

    It names the estimator and holds standard deviations, times [s] and residuals too. The estimator pivot_fit
    fits theta'' = -k sin(phi - theta), with k in rad/s^2 and small terms for the rolling of a rounded edge;
    rolling_fit and moment_balance add terms for a contact that rolls on a rim, slides or lifts; sign_change
    gives phi only and fits no curve.
    """

    estimator: str
    """name of the estimator: pivot_fit, rolling_fit, moment_balance or sign_change"""
    phi: float
    """balance angle [rad]: theta at which the centre of mass stands above the contact"""
    phi_sd: float
    """standard deviation of phi [rad]"""
    k: float | None
    """m g R / I [rad/s²], with R the distance of the centre of mass from the pivot line and I the moment of
    inertia about the contact; None if the estimator does not report it"""
    k_sd: float | None
    """standard deviation of k [rad/s²]; None if k is"""
    covariance: Array
    """(2, 2) covariance of (phi, k); rad, rad/s²; the row and column of k are 0 if k is None"""
    time: Array
    """(m,) times of the fitted frames [s]; 0 is the strike's first frame with a marker"""
    theta: Array
    """(m,) fitted tipping angle [rad]; the measured one for sign_change, which fits no curve"""
    residual: Array
    """(m,) measured minus fitted angle [rad]; 0 for sign_change"""


@dataclass(frozen=True, eq=False)
class Strike:
    """Motion of one strike: tipping angle theta(t), phases, verdict and fit.

    If no marker could be tracked, the arrays and `phases` are empty and `fit` is None.
    """

    id: str
    """id of the strike, such as s3.1"""
    axis_id: str
    """id of the pivot edge in the plan"""
    verdict: str
    """outcome: good, rocked_back, slid, twisted, marker_lost, ..."""
    reason: str
    """explanation of the verdict, one sentence with the figures behind it"""
    time: Array
    """(n,) times of the frames with a marker [s]; 0 is the first of them"""
    theta: Array
    """(n,) tipping angle since rest [rad]"""
    theta_sd: Array
    """(n,) standard deviation of theta [rad], independent from frame to frame"""
    phases: dict[str, slice]
    """range of frames of each phase that occurred: rest; strike, up to the release; stage_one, free motion up
    to phi; stage_two, free motion beyond phi; landing, or back at rest"""
    fit: StrikeFit | None
    """fit that the estimate uses; None if the motion could not be fitted"""
    energy_ratio: float | None
    """kinetic energy after the strike over the energy needed to reach the balance; None if the motion could
    not be fitted"""

    def __repr__(self) -> str:
        """One line: id, pivot edge, verdict, number of frames and balance angle phi."""
        fit = "no fit" if self.fit is None else f"phi {np.degrees(self.fit.phi):.2f}°"
        return (
            f"Strike({self.id!r}, axis {self.axis_id}, {self.verdict}, "
            f"{counted(len(self.time), 'frame')}, {fit})"
        )

    def to_dict(self) -> dict[str, Any]:
        """Strike as a dict of JSON values in SI units; values of the fit are None if there is no fit.

        Keys: id, axis_id (pivot edge), verdict, reason, time_s, theta_rad (tipping angle), theta_sd_rad,
        phases ([first frame, end) by name), phi_rad (balance angle), phi_sd_rad, k_rad_s2 (rate constant),
        k_sd_rad_s2, and energy_ratio (kinetic energy after the strike over that needed to reach the balance).
        """
        fit = self.fit
        return {
            "id": self.id,
            "axis_id": self.axis_id,
            "verdict": self.verdict,
            "reason": self.reason,
            "time_s": self.time.tolist(),
            "theta_rad": self.theta.tolist(),
            "theta_sd_rad": self.theta_sd.tolist(),
            "phases": {name: [span.start, span.stop] for name, span in self.phases.items()},
            "phi_rad": None if fit is None else fit.phi,
            "phi_sd_rad": None if fit is None else fit.phi_sd,
            "k_rad_s2": None if fit is None else fit.k,
            "k_sd_rad_s2": None if fit is None else fit.k_sd,
            "energy_ratio": self.energy_ratio,
        }

    def to_dataframe(self) -> pd.DataFrame:
        """Tipping angle theta(t) as a pandas table, one frame per row.

        Columns: time_s, theta_rad, theta_sd_rad and phase (its name, "" outside all phases).

        Raises:
            ImportError: pandas is not installed.
        """
        phase = [""] * len(self.time)
        for name, span in self.phases.items():
            phase[span] = [name] * len(phase[span])
        return data_frame(
            {"time_s": self.time, "theta_rad": self.theta, "theta_sd_rad": self.theta_sd, "phase": phase}
        )


class Recording:
    """Recording of one object's strikes; markers are tracked when the strikes are first used.

    Args:
        path: the recording (MCAP), or one file of a recording that was split into a series of files.
        object_file: object file (TOML) that replaces the recording's; None to use the recording's.
        progress: called with (text, strikes done, strikes in all) before each strike is tracked; None for
            silence.

    Raises:
        RecordingError: the file cannot be read.
    """

    def __init__(self, path: Path, object_file: Path | None = None, progress: Progress | None = None) -> None:
        self.path = path
        self._object_file = object_file
        self._progress = progress
        self._head = read_head(path)

    @property
    def object(self) -> ObjectSpec:
        """Object file stored in the recording (name, mass, shape, markers), even if another replaces it."""
        return self._head.manifest.object

    @property
    def created(self) -> str:
        """Start time of the recording in UTC, as ISO 8601 text.

        An imported recording has the start time of its first source or, if that states none, the time of the
        import.
        """
        return self._head.manifest.created

    @property
    def strike_ids(self) -> tuple[str, ...]:
        """Ids of the recording's strikes, in its order. Reading them is quick: it tracks no markers."""
        return self._head.strike_ids

    @cached_property
    def evidence(self) -> Evidence:
        """Tracked markers and fitted motions of all strikes; computed on first use, which takes seconds.

        Raises:
            RecordingError: the file cannot be read, is damaged, or holds no strike plan.
            ShapeError: the object's file or shape cannot be used.
            PlanError: the strike plan is of another object or shape, or lacks a strike.
            TrackingError: no marker of any strike can be tracked.
        """
        return read_evidence(self._head, self._object_file, self._progress)

    @cached_property
    def strikes(self) -> tuple[Strike, ...]:
        """Strikes in the recording's order; tracked and fitted on first use.

        Raises:
            AnalyzeError: the recording, its shape or its plan cannot be used, or no marker can be tracked.
        """
        return tuple(_strike(self.evidence, motion) for motion in self.evidence.motions)

    def __getitem__(self, strike_id: str) -> Strike:
        """Strike with the given id; tracks all strikes on first use.

        Raises:
            KeyError: no strike has this id.
            AnalyzeError: the strikes cannot be tracked, as for `strikes`.
        """
        for strike in self.strikes:
            if strike.id == strike_id:
                return strike
        raise KeyError(
            f"{self.path}: no strike {strike_id!r}: its strikes are {', '.join(self.strike_ids) or 'none'}"
        )

    def __repr__(self) -> str:
        """One line: file, object, mass, number of strikes and up to twelve ids; tracks no marker."""
        ids = ", ".join(self.strike_ids[:12]) + (", ..." if len(self.strike_ids) > 12 else "")
        mass = f"{1e3 * self.object.mass_kg:.1f} g"
        strikes = f"{counted(len(self.strike_ids), 'strike')}: {ids}"
        return f"Recording({str(self.path)!r}: {self.object.name}, {mass}, {strikes})"

    def _repr_html_(self) -> str:
        title = f"{self.object.name}, {1e3 * self.object.mass_kg:.1f} g, {self.path.name}"
        return html_table(title, self._rows())

    def summary(self) -> str:
        """Text table of the strikes: id, pivot edge, verdict, balance angle phi [°] and rate k.

        k [rad/s²] is the rate constant of theta'' = -k sin(phi - theta), theta the tipping angle. The cells
        of phi and k are blank where the fit does not give them. Markers are tracked on first use.
        """
        return text_table(self._rows())

    def _rows(self) -> list[dict[str, str]]:
        return [
            {
                "strike": strike.id,
                "axis": strike.axis_id,
                "verdict": strike.verdict,
                "phi [°]": "" if strike.fit is None else f"{np.degrees(strike.fit.phi):.3f}",
                "k [rad/s²]": "" if strike.fit is None or strike.fit.k is None else f"{strike.fit.k:.2f}",
            }
            for strike in self.strikes
        ]

    def to_dict(self) -> dict[str, Any]:
        """Recording as a dict of JSON values, SI units: path, object, mass_kg, created, strikes.

        "object" is the object's name, "created" the start time (ISO 8601), "strikes" a list with the dict of
        each strike (`Strike.to_dict`). Markers are tracked on first use.
        """
        return {
            "path": str(self.path),
            "object": self.object.name,
            "mass_kg": self.object.mass_kg,
            "created": self.created,
            "strikes": [strike.to_dict() for strike in self.strikes],
        }

    def to_dataframe(self) -> pd.DataFrame:
        """Strikes as a pandas table, one per row, in SI units.

        Columns: id, axis_id (pivot edge), verdict, reason, phi_rad (balance angle), phi_sd_rad, k_rad_s2
        (rate constant), k_sd_rad_s2, and energy_ratio (kinetic energy after the strike over that needed to
        reach the balance).

        Raises:
            ImportError: pandas is not installed.
        """
        arrays = {"time_s", "theta_rad", "theta_sd_rad", "phases"}
        return data_frame(
            [
                {name: value for name, value in strike.to_dict().items() if name not in arrays}
                for strike in self.strikes
            ]
        )


def _strike(evidence: Evidence, motion: TipMotion) -> Strike:
    angle, phases = motion.angle, motion.phases
    empty = np.empty(0)
    time = empty if angle is None else (angle.time_ns - angle.time_ns[0]) * 1e-9
    spans = {} if phases is None else phases.spans()
    return Strike(
        id=motion.strike_id,
        axis_id=evidence.planned(motion).axis_id,
        verdict=motion.verdict.value,
        reason=motion.reason,
        time=time,
        theta=empty if angle is None else angle.theta,
        theta_sd=empty if angle is None else angle.sd,
        phases={name: slice(*span) for name, span in spans.items()},
        fit=None if motion.fit is None or angle is None else _fit(motion.fit, time, angle.theta),
        energy_ratio=motion.energy_ratio,
    )


def _fit(fit: MotionFit, time: Array, theta: Array) -> StrikeFit:
    window = slice(*fit.window)
    sd = np.sqrt(np.diag(fit.covariance))
    return StrikeFit(
        estimator=fit.estimator,
        phi=fit.phi,
        phi_sd=float(sd[0]),
        k=fit.k,
        k_sd=None if fit.k is None else float(sd[1]),
        covariance=fit.covariance,
        time=time[window],
        theta=theta[window] - fit.residual,
        residual=fit.residual,
    )
