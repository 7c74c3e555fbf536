"""Adviser of one session: reads its strikes as they are recorded, and states the answer so far."""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import ConvexHull

from analyze.errors import EstimationError, TrackingError
from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import systematic_errors
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.frame_rate import stated_scale
from analyze.pipeline.merge import merge_evidence
from analyze.pipeline.next_strike import (
    Check,
    Choice,
    Progress,
    Target,
    choose_strike,
    reached,
    stopping_checks,
)
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.read_evidence import (
    evidence_from_readings,
    read_evidence,
    read_head,
    read_strike,
    struck_object,
)
from analyze.pipeline.solved import SolvedStrikes, body_cells, solve_strikes
from analyze.pipeline.strike_forecast import strike_forecast
from analyze.types import TENSOR_ENTRIES
from schemas.edge_names import edge_names
from schemas.watch_lines import (
    AdviceRequest,
    MarkerSide,
    NextStrike,
    SessionCheck,
    SessionEstimate,
    SessionTarget,
    StrikeForecastRange,
)

if TYPE_CHECKING:
    from analyze.estimation.priors import SystematicErrors
    from analyze.pipeline.evidence import StrikeReading, StruckObject
    from analyze.reading.live_recording import LiveRecording
    from analyze.types import Array, Marker


class Adviser:
    """Adviser of one session.

    Args:
        live: the recording that is being written; it is ready (has manifest and plan).
    """

    def __init__(self, live: LiveRecording) -> None:
        self._live = live
        self._struck: StruckObject = struck_object(live)
        self._markers: list[Marker] = placed_markers(self._struck.spec)
        self._readings: list[StrikeReading] = []
        self._earlier: dict[str, Evidence] = {}
        self._names = edge_names(self._struck.plan.strikes)

    @property
    def newest(self) -> str:
        """Id of the newest strike that was read; "" before the first."""
        return self._readings[-1].record.strike_id if self._readings else ""

    def read_new(self) -> None:
        """Read the strikes that were recorded since the last call, and release their images."""
        self._live.poll()
        for record in self._live.strikes[len(self._readings) :]:
            self._readings.append(read_strike(self._live, self._struck, self._markers, record))
            self._live.forget_until(record.window_end_ns)

    def answer(self, request: AdviceRequest) -> SessionEstimate:
        """Answer so far, from the strikes read, and the next strike.

        Raises:
            RecordingError, MergeError: an earlier recording cannot be read, or is of another object.
        """
        target = Target(request.target_com_m, request.target_inertia)
        evidence = self._evidence(request.earlier)
        try:
            solved = solve_strikes(evidence, EstimateOptions())
        except EstimationError:
            solved = None
        checks: list[Check] = []
        met = False
        if solved is not None:
            checks = stopping_checks(solved)
            met = target != Target() and reached(solved).meets(target) and all(c.passed for c in checks)
        choice = None if met or target == Target() else self._choice(evidence, solved, target, request)
        return SessionEstimate(
            number=request.number,
            strike_id=self.newest,
            checks=[SessionCheck(name=c.name, passed=c.passed, text=c.text) for c in checks],
            target=SessionTarget(
                com_m=target.com,
                inertia=target.inertia,
                met=met,
                reachable=_reachable(choice, met=met),
                reason="" if choice is None else choice.obstacle,
            ),
            forecast=_forecast(
                choice, met=met, failed=sum(request.failures.values()), done=len(self._readings)
            ),
            next=None
            if choice is None or choice.strike is None or choice.obstacle
            else NextStrike(strike_id=choice.strike.id, reason=choice.reason),
            bounds_m=np.array(self._struck.model.bounds).tolist(),
            hull=self._outlines,
            markers=self._sides,
            **_numbers(solved),
        )

    def _choice(
        self, evidence: Evidence, solved: SolvedStrikes | None, target: Target, request: AdviceRequest
    ) -> Choice:
        strikes = self._struck.plan.strikes
        last = next((each for each in strikes if each.id == request.last_plan_strike_id), None)
        progress = Progress(
            request.left,
            0 if solved is None else len(solved.used),
            last,
            request.stands,
            frozenset(request.excluded),
            request.failures,
        )
        forecast = strike_forecast(evidence, strikes, self._problem(evidence), solved)
        return choose_strike(forecast, target, progress, self._names)

    def _problem(self, evidence: Evidence) -> tuple[SystematicErrors, ComPrior, MomentModel]:
        moments = MomentModel(stated_scale(evidence), self._shape_prior)
        return systematic_errors(evidence), ComPrior.from_bounds(*evidence.model.bounds), moments

    @cached_property
    def _sides(self) -> list[MarkerSide]:
        """Centre [m] and direction of each marker whose place is known."""
        placed = [(each.id, each.T_object_marker) for each in self._markers]
        return [
            MarkerSide(id=name, place_m=T[:3, 3].round(5).tolist(), faces=T[:3, 2].round(4).tolist())
            for name, T in placed
            if T is not None
        ]

    @cached_property
    def _shape_prior(self):
        return shape_prior(body_cells(self._struck.spec, self._struck.model))

    def _evidence(self, earlier: list[str]) -> Evidence:
        """Evidence of the strikes read, and of those in earlier recordings."""
        ids = tuple(reading.record.strike_id for reading in self._readings)
        head = RecordingHead(self._live.path, self._live.manifest, "", ids, files=(self._live.path.name,))
        try:
            own = evidence_from_readings(head, self._struck, self._readings)
        except TrackingError:  # no strike shows a marker
            own = evidence_from_readings(head, self._struck, [])
        for name in earlier:
            if name not in self._earlier:
                self._earlier[name] = read_evidence(read_head(Path(name)))
        return merge_evidence([*(self._earlier[name] for name in earlier), own])

    @cached_property
    def _outlines(self) -> list[list[list[float]]]:
        """Outlines of the hull seen along x, y and z [m]."""
        points = self._struck.model.hull_vertices
        found: list[list[list[float]]] = []
        for axes in ((1, 2), (0, 2), (0, 1)):
            flat: Array = points[:, axes]
            found.append(np.round(flat[ConvexHull(flat).vertices], 5).tolist())
        return found


def _reachable(choice: Choice | None, *, met: bool) -> bool | None:
    """Whether the target can be reached; None if that is not known."""
    if met:
        return True
    if choice is None or (choice.needed is None and not choice.obstacle):
        return None
    return not choice.obstacle


def _forecast(choice: Choice | None, *, met: bool, failed: int, done: int) -> StrikeForecastRange | None:
    """Expected number of further strikes: if all are usable, and if as many fail as did so far."""
    if met:
        return StrikeForecastRange(least=0, most=0)
    if choice is None or choice.needed is None:
        return None
    share = (done + 1.0) / (done + 1.0 - min(failed, done))
    return StrikeForecastRange(
        least=choice.needed, most=max(choice.needed + 1, math.ceil(choice.needed * share))
    )


def _numbers(solved: SolvedStrikes | None) -> dict[str, Any]:
    """Numbers of the answer so far; none if the strikes are too few."""
    if solved is None:
        return {}
    inertial, widths = solved.inertial, reached(solved)
    com = inertial.com
    open_direction = com.unobserved_direction
    return {
        "strikes": len(solved.used),
        "com_m": com.position.tolist(),
        "com_covariance_m2": com.covariance.tolist(),
        "com_open": [] if open_direction is None else [open_direction.tolist()],
        "com_half_width_m": widths.com if math.isfinite(widths.com) else None,
        "inertia_kg_m2": [float(inertial.inertia[entry]) for entry in TENSOR_ENTRIES],
        "inertia_sd_kg_m2": [float(inertial.inertia_sd[entry]) for entry in TENSOR_ENTRIES],
        "inertia_half_width": widths.inertia if math.isfinite(widths.inertia) else None,
    }
