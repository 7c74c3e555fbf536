"""The state machine of one session, pure: events in, actions out. Who carries the actions out is session_runner.py.

    place → check pose → arm → strike → record until at rest → judge → next

A strike that does not give what it should is repeated, with a speed learned from it, up to `max_attempts` times; every attempt is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from acquire.session.energy import EnergyGoal, EnergyLearner
from schemas.proto import percuss_pb2 as pb
from schemas.result import Verdict
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.watch_lines import StrikeVerdict

State = pb.SessionState.State


@dataclass(frozen=True)
class SessionSettings:
    """How patient a session is."""

    max_attempts: int = 4
    max_placements: int = 3
    max_faults: int = 3
    energy_goal: EnergyGoal = field(default_factory=EnergyGoal)
    energy_accepted: tuple[float, float] = (1.0, 2.5)


# --- events -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Started:
    """The recording is open."""


@dataclass(frozen=True)
class Placed:
    """The operator has placed the object."""


@dataclass(frozen=True)
class PoseChecked:
    """What the images say of the placement."""

    good: bool
    text: str = ""


@dataclass(frozen=True)
class Ready:
    """The striker is armed, cocked and settled."""


@dataclass(frozen=True)
class Struck:
    """The striker is done. Times are host monotonic."""

    contact_time_ns: int | None
    contact_time_sd_ns: float
    tip_speed_m_s: float
    contacts: int


@dataclass(frozen=True)
class Recorded:
    """The object is at rest again and the window is closed; log times."""

    window_start_ns: int
    window_end_ns: int
    frames: int
    lost: int


@dataclass(frozen=True)
class Judged:
    """The verdict; None when none came."""

    verdict: StrikeVerdict | None


@dataclass(frozen=True)
class StopRequested:
    """The operator wants to end here."""

    text: str = "stopped by the operator"


@dataclass(frozen=True)
class StrikerFailed:
    """The striker ended in a fault, or its bus fell silent, while it was cocked or swung."""

    text: str


@dataclass(frozen=True)
class BrokenOff:
    """The file that held this strike's images broke off; the recording goes on in the next."""

    text: str


Event = BrokenOff | StrikerFailed | Started | Placed | PoseChecked | Ready | Struck | Recorded | Judged | StopRequested

# --- actions ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Announce:
    """Write the state into the recording and tell the subscribers."""

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
    """Compare the images with the plan."""

    strike: PlannedStrike


@dataclass(frozen=True)
class Arm:
    """Arm and cock the striker."""


@dataclass(frozen=True)
class ClearFault:
    """Home the striker again; if that fails too, the session cannot go on."""


@dataclass(frozen=True)
class Strike:
    """Open the window and strike."""

    strike: PlannedStrike
    strike_id: str
    tip_speed_m_s: float


@dataclass(frozen=True)
class RecordUntilRest:
    """Wait until the object is at rest, then close the window."""


@dataclass(frozen=True)
class Judge:
    """Ask for the verdict."""

    strike: PlannedStrike
    strike_id: str
    recorded: Recorded
    struck: Struck


@dataclass(frozen=True)
class Keep:
    """Write the strike's record into the recording."""

    strike: PlannedStrike
    strike_id: str
    attempt: int
    tip_speed_command_m_s: float
    struck: Struck
    recorded: Recorded
    verdict: StrikeVerdict | None


@dataclass(frozen=True)
class Finish:
    """Close the recording."""

    aborted: bool = False
    text: str = ""


Action = Announce | AskToPlace | CheckPose | Arm | ClearFault | Strike | RecordUntilRest | Judge | Keep | Finish


@dataclass
class SessionMachine:
    """Where the session stands. `handle` returns what to do next; the last action of a list is the one that answers with an event."""

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
        self._judged_at = (0, 1)
        """index and attempt of the strike judged last"""

    @property
    def strike(self) -> PlannedStrike:
        """The planned strike in work."""
        return self.plan.strikes[self._index]

    @property
    def strike_id(self) -> str:
        """Unique in the recording: planned strike and attempt."""
        return f"{self.strike.id}.{self._attempt}"

    @property
    def progress(self) -> tuple[int, int]:
        """(planned strikes done, planned strikes)."""
        return self._index, len(self.plan.strikes)

    def handle(self, event: Event) -> list[Action]:
        """Advance by one event.

        Raises:
            ValueError: the event does not belong to the state.
        """
        match event, self.state:
            case StopRequested(text=text), _:
                self.state = State.ABORTED
                return [self._announce(text), Finish(aborted=True, text=text)]
            case Started(), State.IDLE:
                return self._place()
            case Placed(), State.PLACING:
                self.state = State.CHECKING_POSE
                return [self._announce(), CheckPose(self.strike)]
            case PoseChecked(good=True), State.CHECKING_POSE:
                self.state = State.ARMING
                return [self._announce(), Arm()]
            case PoseChecked(text=text), State.CHECKING_POSE:
                return self._place_again(text)
            case Ready(), State.ARMING:
                self.state = State.STRIKING
                self._command = self.learner.tip_speed(self.strike)
                return [self._announce(), Strike(self.strike, self.strike_id, self._command)]
            case StrikerFailed(text=text), State.ARMING | State.STRIKING:
                self._faults += 1
                if self._faults > self.settings.max_faults:
                    return self.handle(StopRequested(text))
                return [self._announce(text), ClearFault(), *self._place("the striker was reset")]
            case BrokenOff(text=text), State.ARMING | State.STRIKING | State.RECORDING | State.JUDGING:
                return self._strike_again(text)
            case BrokenOff(text=text), State.PLACING | State.FINISHED:  # it had been judged, and could not be kept
                self._index, self._attempt = self._judged_at
                return self._strike_again(text)
            case Struck(), State.STRIKING:
                self.state = State.RECORDING
                self._struck = event
                return [self._announce(), RecordUntilRest()]
            case Recorded(), State.RECORDING:
                self.state = State.JUDGING
                self._recorded = event
                assert self._struck is not None  # noqa: S101 - set on the way into RECORDING
                return [self._announce(), Judge(self.strike, self.strike_id, event, self._struck)]
            case Judged(verdict=verdict), State.JUDGING:
                return self._judged(verdict)
            case _:
                raise ValueError(f"{type(event).__name__} does not belong to state {State.Name(self.state)}")

    def _announce(self, text: str = "") -> Announce:
        inside = self.state not in {State.IDLE, State.FINISHED}
        return Announce(self.state, self.strike.id if inside else "", self._attempt if inside else 0, text)

    def _place(self, hint: str = "") -> list[Action]:
        self.state = State.PLACING
        return [self._announce(hint), AskToPlace(self.strike, hint)]

    def _strike_again(self, text: str) -> list[Action]:
        """The same strike once more: what came of it is lost, through no fault of its own."""
        self._faults += 1
        if self._faults > self.settings.max_faults:
            return self.handle(StopRequested(text))
        return [self._announce(text), *self._place("again: its images were lost")]

    def _place_again(self, text: str) -> list[Action]:
        self._placements += 1
        if self._placements >= self.settings.max_placements:
            return self._next()
        return self._place(text)

    def _judged(self, verdict: StrikeVerdict | None) -> list[Action]:
        struck, recorded = self._struck, self._recorded
        assert struck is not None  # noqa: S101 - set on the way into JUDGING
        assert recorded is not None  # noqa: S101 - set on the way into JUDGING
        self._judged_at = (self._index, self._attempt)
        keep = Keep(self.strike, self.strike_id, self._attempt, self._command, struck, recorded, verdict)
        good = False
        if verdict is not None:
            energy = verdict.energy_ratio
            low, high = self.settings.energy_accepted
            good = verdict.code is Verdict.GOOD and (energy is None or low <= energy <= high)
        missed = struck.tip_speed_m_s <= 0 and (verdict is None or verdict.code is Verdict.NOT_MOVED)
        if not missed:
            self.learner.learn(self.strike, self._command, struck.tip_speed_m_s or None, verdict)
        if good or verdict is None or self._attempt >= self.settings.max_attempts:
            return [keep, *self._next()]
        self._attempt += 1
        self._placements = 0
        return [keep, *self._place(f"again: {verdict.reason}")]

    def _next(self) -> list[Action]:
        self._attempt, self._placements = 1, 0
        if self._index + 1 < len(self.plan.strikes):
            self._index += 1
            return self._place()
        self.state = State.FINISHED
        return [self._announce(), Finish()]
