"""State machine of one session: events in, actions out, no I/O. `runner.py` executes the actions.

    place → check pose → arm → strike → record until at rest → judge → next

A strike without a good verdict is repeated with a tip speed estimated from all strikes so far, up to
`max_attempts` times; every attempt is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from acquire.session.energy import EnergyGoal, EnergyLearner
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeVerdict

State = pb.SessionState.State


@dataclass(frozen=True)
class SessionSettings:
    """Limits on repetitions, and the energy ratios aimed at and accepted."""

    max_attempts: int = 4
    """largest number of attempts per planned strike"""
    max_placements: int = 3
    """number of rejected placements after which a planned strike is skipped"""
    max_faults: int = 3
    """number of device faults after which the next one ends the session"""
    energy_goal: EnergyGoal = field(default_factory=EnergyGoal)
    energy_accepted: tuple[float, float] = (1.0, 2.5)
    """range of energy ratios E in which a good strike is not repeated"""


# --- events


@dataclass(frozen=True)
class Started:
    """The recording is open."""


@dataclass(frozen=True)
class Placed:
    """The operator has placed the object."""


@dataclass(frozen=True)
class PoseChecked:
    """The object's pose has been compared with the plan."""

    good: bool
    """True if the object lies as planned, or could not be checked"""
    text: str = ""
    """reason if the pose is not good, or was not checked"""


@dataclass(frozen=True)
class Ready:
    """The striker is armed, cocked and settled."""


@dataclass(frozen=True)
class Struck:
    """The striker has completed the strike. Times are host monotonic."""

    contact_time_ns: int | None
    """time of first contact as the striker measured it; None if it measured none"""
    contact_time_sd_ns: float
    tip_speed_m_s: float
    contacts: int


@dataclass(frozen=True)
class Recorded:
    """The object is at rest again and the recording window is closed. Times are log times."""

    window_start_ns: int
    window_end_ns: int
    frames: int
    """number of frames recorded in the window"""
    lost: int
    """number of frames lost in the window"""


@dataclass(frozen=True)
class Judged:
    """`analyze watch` has judged the strike, or did not answer in time."""

    verdict: StrikeVerdict | None
    """None if there was no answer in time"""


@dataclass(frozen=True)
class StopRequested:
    """The operator, or an error that cannot be cleared, ends the session."""

    text: str = "stopped by the operator"


@dataclass(frozen=True)
class StrikerFailed:
    """The striker reported a fault or its bus stopped answering while it was armed, cocked or swung."""

    text: str


@dataclass(frozen=True)
class FileCutShort:
    """The file with this strike's images was cut short; the recording continues in the next file."""

    text: str


Event = (
    FileCutShort
    | StrikerFailed
    | Started
    | Placed
    | PoseChecked
    | Ready
    | Struck
    | Recorded
    | Judged
    | StopRequested
)

# --- actions


@dataclass(frozen=True)
class Announce:
    """Write the session's state into the recording and send it to the daemon's subscribers."""

    state: State
    strike_id: str
    attempt: int
    text: str = ""


@dataclass(frozen=True)
class AskToPlace:
    """Ask the operator to place the object."""

    strike: PlannedStrike
    hint: str = ""


@dataclass(frozen=True)
class CheckPose:
    """Compare the object's pose with the plan."""

    strike: PlannedStrike


@dataclass(frozen=True)
class Arm:
    """Arm and cock the striker."""


@dataclass(frozen=True)
class ClearFault:
    """Home the striker again; if that fails too, the session ends."""


@dataclass(frozen=True)
class Strike:
    """Open the recording window and strike."""

    strike: PlannedStrike
    strike_id: str
    tip_speed_m_s: float


@dataclass(frozen=True)
class RecordUntilRest:
    """Wait until the object is at rest, then close the recording window."""


@dataclass(frozen=True)
class Judge:
    """Ask `analyze watch` for the verdict on a strike."""

    strike: PlannedStrike
    strike_id: str
    recorded: Recorded
    struck: Struck


@dataclass(frozen=True)
class WriteRecord:
    """Write the strike's record into the recording."""

    strike: PlannedStrike
    strike_id: str
    attempt: int
    tip_speed_command_m_s: float
    struck: Struck
    recorded: Recorded
    verdict: StrikeVerdict | None


@dataclass(frozen=True)
class CloseRecording:
    """Close the recording."""

    aborted: bool = False
    text: str = ""


Step = Announce | AskToPlace | CheckPose | Arm | ClearFault | Strike | RecordUntilRest | Judge | WriteRecord
"""an action after which the session continues"""
Action = Step | CloseRecording


@dataclass
class SessionMachine:
    """State of one session.

    `handle` returns the next actions; executing the last of them yields the next event.
    """

    plan: StrikePlan
    settings: SessionSettings = field(default_factory=SessionSettings)

    def __post_init__(self) -> None:
        self.state = State.IDLE
        self._index = 0
        self._attempt = 1
        self._placements = 0
        self._faults = 0
        self.learner = EnergyLearner(self.plan, self.settings.energy_goal)
        self._command = 0.0
        self._struck: Struck | None = None
        self._recorded: Recorded | None = None
        self._last_judged = (0, 1)
        """index and attempt of the strike judged last"""

    @property
    def strike(self) -> PlannedStrike:
        """The current planned strike."""
        return self.plan.strikes[self._index]

    @property
    def strike_id(self) -> str:
        """Id of the current attempt, unique in the recording: planned strike and number of the attempt."""
        return f"{self.strike.id}.{self._attempt}"

    @property
    def progress(self) -> tuple[int, int]:
        """Number of planned strikes done, and number of all planned strikes."""
        return self._index, len(self.plan.strikes)

    def handle(self, event: Event) -> list[Action]:
        """Advance by one event.

        Raises:
            ValueError: the event does not belong to the state.
        """
        states, reaction = _REACTIONS[type(event)]
        if states and self.state not in states:
            raise ValueError(f"{type(event).__name__} does not belong to state {State.Name(self.state)}")
        return reaction(self, event)

    def on_stop_requested(self, event: StopRequested) -> list[Action]:
        """End the session from any state."""
        self.state = State.ABORTED
        return [self._announce(event.text), CloseRecording(aborted=True, text=event.text)]

    def on_started(self, _event: Started) -> list[Action]:
        """Begin with the first planned strike."""
        return self._place()

    def on_placed(self, _event: Placed) -> list[Action]:
        """Check the placement."""
        self.state = State.CHECKING_POSE
        return [self._announce(), CheckPose(self.strike)]

    def on_pose_checked(self, event: PoseChecked) -> list[Action]:
        """Arm the striker, or ask for a better placement; after `max_placements` skip the strike."""
        if event.good:
            self.state = State.ARMING
            return [self._announce(), Arm()]
        self._placements += 1
        if self._placements >= self.settings.max_placements:
            return self._next()
        return self._place(event.text)

    def on_ready(self, _event: Ready) -> list[Action]:
        """Strike with the tip speed that all strikes so far suggest."""
        self.state = State.STRIKING
        self._command = self.learner.tip_speed(self.strike)
        return [self._announce(), Strike(self.strike, self.strike_id, self._command)]

    def on_striker_failed(self, event: StrikerFailed) -> list[Action]:
        """Clear the fault and place the object again; end the session after `max_faults`."""
        return self._after_fault(event.text, [ClearFault()], "the striker was reset")

    def on_file_cut_short(self, event: FileCutShort) -> list[Action]:
        """Repeat the attempt whose images were lost.

        While placing or finished, that is the attempt judged last: its record could not be written.
        """
        if self.state in {State.PLACING, State.FINISHED}:
            self._index, self._attempt = self._last_judged
        return self._after_fault(event.text, [], "again: its images were lost")

    def on_struck(self, event: Struck) -> list[Action]:
        """Record until the object is at rest."""
        self.state = State.RECORDING
        self._struck = event
        return [self._announce(), RecordUntilRest()]

    def on_recorded(self, event: Recorded) -> list[Action]:
        """Ask for the verdict."""
        self.state = State.JUDGING
        self._recorded = event
        assert self._struck is not None  # noqa: S101 - set on the way into RECORDING
        return [self._announce(), Judge(self.strike, self.strike_id, event, self._struck)]

    def _announce(self, text: str = "") -> Announce:
        inside = self.state not in {State.IDLE, State.FINISHED}
        return Announce(self.state, self.strike.id if inside else "", self._attempt if inside else 0, text)

    def _place(self, hint: str = "") -> list[Action]:
        self.state = State.PLACING
        return [self._announce(hint), AskToPlace(self.strike, hint)]

    def _after_fault(self, text: str, remedy: list[Action], hint: str) -> list[Action]:
        """Repeat the attempt after a device's fault; end the session after `max_faults` of them."""
        self._faults += 1
        if self._faults > self.settings.max_faults:
            return self.on_stop_requested(StopRequested(text))
        return [self._announce(text), *remedy, *self._place(hint)]

    def on_judged(self, event: Judged) -> list[Action]:
        """Write the strike's record, learn from the strike, and repeat it or go on to the next."""
        verdict, struck, recorded = event.verdict, self._struck, self._recorded
        assert struck is not None  # noqa: S101 - set on the way into JUDGING
        assert recorded is not None  # noqa: S101 - set on the way into JUDGING
        self._last_judged = (self._index, self._attempt)
        record = WriteRecord(
            self.strike, self.strike_id, self._attempt, self._command, struck, recorded, verdict
        )
        good = False
        if verdict is not None:
            energy = verdict.energy_ratio
            low, high = self.settings.energy_accepted
            good = verdict.code is Verdict.GOOD and (energy is None or low <= energy <= high)
        missed = struck.tip_speed_m_s <= 0 and (verdict is None or verdict.code is Verdict.NOT_MOVED)
        if not missed:
            self.learner.learn(self.strike, self._command, struck.tip_speed_m_s or None, verdict)
        if good or verdict is None or self._attempt >= self.settings.max_attempts:
            return [record, *self._next()]
        self._attempt += 1
        self._placements = 0
        return [record, *self._place(f"again: {verdict.reason}")]

    def _next(self) -> list[Action]:
        self._attempt, self._placements = 1, 0
        if self._index + 1 < len(self.plan.strikes):
            self._index += 1
            return self._place()
        self.state = State.FINISHED
        return [self._announce(), CloseRecording()]


_REACTIONS: dict[type, tuple[frozenset[State], Callable[[SessionMachine, Any], list[Action]]]] = {
    StopRequested: (frozenset(), SessionMachine.on_stop_requested),
    Started: (frozenset({State.IDLE}), SessionMachine.on_started),
    Placed: (frozenset({State.PLACING}), SessionMachine.on_placed),
    PoseChecked: (frozenset({State.CHECKING_POSE}), SessionMachine.on_pose_checked),
    Ready: (frozenset({State.ARMING}), SessionMachine.on_ready),
    StrikerFailed: (frozenset({State.ARMING, State.STRIKING}), SessionMachine.on_striker_failed),
    FileCutShort: (
        frozenset(
            {State.ARMING, State.STRIKING, State.RECORDING, State.JUDGING, State.PLACING, State.FINISHED},
        ),
        SessionMachine.on_file_cut_short,
    ),
    Struck: (frozenset({State.STRIKING}), SessionMachine.on_struck),
    Recorded: (frozenset({State.RECORDING}), SessionMachine.on_recorded),
    Judged: (frozenset({State.JUDGING}), SessionMachine.on_judged),
}
"""states in which each event may come (none named: any state), and the reaction to it"""
