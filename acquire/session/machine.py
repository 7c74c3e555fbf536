"""State machine of one session: events in, actions out, no I/O. `runner.py` executes the actions.

    place → check pose → arm → strike → record until at rest → judge → next

A strike without a good verdict is repeated with a tip speed estimated from all strikes so far, until it was
attempted MAX_ATTEMPTS times; every attempt is kept. A verdict is the answer of `analyze watch`, which judges
a strike from its images; a strike without any verdict is not repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from acquire.session.energy import EnergyLearner
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeVerdict

State = pb.SessionState.State


MAX_ATTEMPTS = 4
"""largest number of attempts per planned strike"""
MAX_PLACEMENTS = 3
"""number of rejected placements after which a planned strike is skipped"""
MAX_FAULTS = 3
"""number of device faults after which the next one ends the session"""
ENERGY_ACCEPTED = (1.0, 2.5)
"""range of energy ratios (kinetic energy after the strike over the energy needed to reach balance) in which a
good strike is not repeated"""

# --- events


class Event:
    """Base of the events that a session reacts to."""


@dataclass(frozen=True)
class Started(Event):
    """Event: the recording is open."""


@dataclass(frozen=True)
class Placed(Event):
    """Event: the operator has placed the object."""


@dataclass(frozen=True)
class PoseChecked(Event):
    """Event: the object's pose has been compared with the planned placement."""

    good: bool
    """True if the object lies as planned, or could not be checked"""
    text: str = ""
    """reason if the pose is not good, or was not checked"""


@dataclass(frozen=True)
class Ready(Event):
    """Event: the striker is armed (may strike once) and cocked, and its arm has come to rest."""


@dataclass(frozen=True)
class Struck(Event):
    """Event: the striker has completed the strike. Times are host monotonic [ns]."""

    contact_time_ns: int | None
    """time of first contact as the striker measured it [ns]; None if it measured none"""
    contact_time_sd_ns: float
    """standard deviation of the contact time [ns]"""
    tip_speed_m_s: float
    """tip speed just before contact [m/s]; 0 if it was not measured"""
    contacts: int
    """number of contacts that may have occurred"""


@dataclass(frozen=True)
class Recorded(Event):
    """Event: the recording window of a strike (time span whose images are kept) is closed.

    Usually the object is at rest again; at a time limit the window is closed although the object moves. Times
    are log times [ns].
    """

    window_start_ns: int
    """log time of the window's first image [ns]"""
    window_end_ns: int
    """log time of the window's last image [ns]"""
    frames: int
    """number of frames recorded in the window"""
    lost: int
    """number of frames lost in the window, or dropped by a slow disk"""


@dataclass(frozen=True)
class Judged(Event):
    """Event: `analyze watch` has judged the strike from its images, or did not answer in time."""

    verdict: StrikeVerdict | None
    """None if there was no answer in time"""


@dataclass(frozen=True)
class StopRequested(Event):
    """Event: the operator, or an error that cannot be cleared, ends the session."""

    text: str = "stopped by the operator"
    """reason for the end"""


@dataclass(frozen=True)
class StrikerFailed(Event):
    """Event: the striker reported a fault, or stopped answering, while arming, cocking or swinging."""

    text: str
    """description of the fault"""


@dataclass(frozen=True)
class FileCutShort(Event):
    """Event: the file with this strike's images was cut short; the recording continues in the next file."""

    text: str
    """description of the loss"""


# --- actions


@dataclass(frozen=True)
class Announce:
    """Action: write the session's state into the recording and send it to the daemon's subscribers."""

    state: State
    strike_id: str
    """id of the planned strike; "" before the first and after the last"""
    attempt: int
    """number of the attempt, from 1; 0 before the first strike and after the last"""
    text: str = ""
    """remark on the state"""


@dataclass(frozen=True)
class AskToPlace:
    """Action: ask the operator to place the object for a planned strike."""

    strike: PlannedStrike
    hint: str = ""
    """reason why the object is to be placed again; "" the first time"""


@dataclass(frozen=True)
class CheckPose:
    """Action: compare the object's pose with the placement of a planned strike."""

    strike: PlannedStrike


@dataclass(frozen=True)
class Arm:
    """Action: arm the striker (permit one strike) and cock it (draw the arm back)."""


@dataclass(frozen=True)
class ClearFault:
    """Action: home the striker after a fault (clear it, raise the arm); if that fails, the session ends."""


@dataclass(frozen=True)
class Strike:
    """Action: open the recording window (time span whose images are kept) and strike."""

    strike: PlannedStrike
    strike_id: str
    """id of the attempt, unique in the recording"""
    tip_speed_m_s: float
    """tip speed to command [m/s]"""


@dataclass(frozen=True)
class RecordUntilRest:
    """Action: wait until the object is at rest or a time limit, then close the strike's recording window."""


@dataclass(frozen=True)
class Judge:
    """Action: ask `analyze watch` to judge a strike, given its recording window and contact time."""

    strike: PlannedStrike
    strike_id: str
    """id of the attempt, unique in the recording"""
    recorded: Recorded
    struck: Struck


@dataclass(frozen=True)
class WriteRecord:
    """Action: write a message on one strike (window, speeds, contact, verdict) into the recording."""

    strike: PlannedStrike
    strike_id: str
    """id of the attempt, unique in the recording"""
    attempt: int
    """number of the attempt, from 1"""
    tip_speed_command_m_s: float
    """commanded tip speed [m/s]"""
    struck: Struck
    recorded: Recorded
    verdict: StrikeVerdict | None
    """None if `analyze watch` did not answer in time"""


@dataclass(frozen=True)
class CloseRecording:
    """Action: close the recording; the session ends."""

    aborted: bool = False
    """True if the session ends before its last planned strike"""
    text: str = ""
    """reason if the session was aborted"""


Step = Announce | AskToPlace | CheckPose | Arm | ClearFault | Strike | RecordUntilRest | Judge | WriteRecord
"""an action after which the session continues"""
Action = Step | CloseRecording


class SessionMachine:
    """State machine of one session: the current planned strike, its attempt, and the learned tip speeds.

    `handle` takes an event and returns the next actions. Executing the last of them yields the next event.

    Args:
        plan: strikes to carry out.
    """

    def __init__(self, plan: StrikePlan) -> None:
        self.plan = plan
        self.state = State.IDLE
        self._index = 0
        self._attempt = 1
        self._placements = 0
        self._faults = 0
        self.learner = EnergyLearner(plan)
        self._command = 0.0
        self._struck: Struck | None = None
        self._recorded: Recorded | None = None
        self._last_judged = (0, 1)
        """index and attempt of the strike judged last"""

    @property
    def strike(self) -> PlannedStrike:
        """Planned strike that the session is at; after the end, the last one."""
        return self.plan.strikes[self._index]

    @property
    def strike_id(self) -> str:
        """Id of the current attempt, unique in the recording: planned strike's id, dot, attempt number."""
        return f"{self.strike.id}.{self._attempt}"

    @property
    def progress(self) -> tuple[int, int]:
        """Number of planned strikes done or skipped, and number of all planned strikes."""
        return self._index + (self.state is State.FINISHED), len(self.plan.strikes)

    def handle(self, event: Event) -> list[Action]:
        """Advance the session by one event and return the actions to execute, in order.

        Raises:
            ValueError: the event does not belong to the present state.
        """
        states, reaction = _REACTIONS[type(event)]
        if states and self.state not in states:
            raise ValueError(f"{type(event).__name__} does not belong to state {State.Name(self.state)}")
        return reaction(self, event)

    def on_stop_requested(self, event: StopRequested) -> list[Action]:
        """End the session from any state: announce the reason and close the recording.

        Returns:
            Actions to execute, in order.
        """
        self.state = State.ABORTED
        return [self._announce(event.text), CloseRecording(aborted=True, text=event.text)]

    def on_started(self, _event: Started) -> list[Action]:
        """Begin with the first planned strike: ask the operator to place the object.

        Returns:
            Actions to execute, in order.
        """
        return self._place()

    def on_placed(self, _event: Placed) -> list[Action]:
        """React to the placed object: check its pose.

        Returns:
            Actions to execute, in order.
        """
        self.state = State.CHECKING_POSE
        return [self._announce(), CheckPose(self.strike)]

    def on_pose_checked(self, event: PoseChecked) -> list[Action]:
        """React to the checked pose: arm the striker, or ask for a better placement.

        After MAX_PLACEMENTS rejected placements the planned strike is skipped.

        Returns:
            Actions to execute, in order.
        """
        if event.good:
            self.state = State.ARMING
            return [self._announce(), Arm()]
        self._placements += 1
        if self._placements >= MAX_PLACEMENTS:
            return self._next()
        return self._place(event.text)

    def on_ready(self, _event: Ready) -> list[Action]:
        """React to the armed striker: strike with the tip speed that all strikes so far suggest.

        Returns:
            Actions to execute, in order.
        """
        self.state = State.STRIKING
        self._command = self.learner.tip_speed(self.strike)
        return [self._announce(), Strike(self.strike, self.strike_id, self._command)]

    def on_striker_failed(self, event: StrikerFailed) -> list[Action]:
        """React to a striker fault: clear it and place the object again, or end the session.

        More than MAX_FAULTS device faults end the session.

        Returns:
            Actions to execute, in order.
        """
        return self._after_fault(event.text, [ClearFault()], "the striker was reset")

    def on_file_cut_short(self, event: FileCutShort) -> list[Action]:
        """React to lost images of an attempt: repeat the attempt, or end the session.

        More than MAX_FAULTS device faults, lost images included, end the session. In the states PLACING and
        FINISHED the attempt judged last is repeated, because its record could not be written.

        Returns:
            Actions to execute, in order.
        """
        if self.state in {State.PLACING, State.FINISHED}:
            self._index, self._attempt = self._last_judged
        return self._after_fault(event.text, [], "again: its images were lost")

    def on_struck(self, event: Struck) -> list[Action]:
        """React to the completed strike: record until the object is at rest.

        Returns:
            Actions to execute, in order.
        """
        self.state = State.RECORDING
        self._struck = event
        return [self._announce(), RecordUntilRest()]

    def on_recorded(self, event: Recorded) -> list[Action]:
        """React to the closed recording window: ask for the verdict on the strike.

        Returns:
            Actions to execute, in order.
        """
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
        """Actions after a device fault: repeat the attempt, or end the session.

        More than MAX_FAULTS faults end the session.

        Args:
            text: description of the fault.
            remedy: actions that clear it, before the object is placed again.
            hint: reason for placing again, for the operator.
        """
        self._faults += 1
        if self._faults > MAX_FAULTS:
            return self.on_stop_requested(StopRequested(text))
        return [self._announce(text), *remedy, *self._place(hint)]

    def on_judged(self, event: Judged) -> list[Action]:
        """React to the verdict: write the strike's record, learn from it, and repeat it or go on to the next.

        A strike is repeated if its verdict is not good or its energy ratio is outside ENERGY_ACCEPTED, until
        it was attempted MAX_ATTEMPTS times. Without a verdict it is not repeated. A swing that met nothing is
        not learned from.

        Returns:
            Actions to execute, in order.
        """
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
            low, high = ENERGY_ACCEPTED
            good = verdict.code is Verdict.GOOD and (energy is None or low <= energy <= high)
        missed = struck.tip_speed_m_s <= 0 and (verdict is None or verdict.code is Verdict.NOT_MOVED)
        if not missed:
            self.learner.learn(self.strike, self._command, struck.tip_speed_m_s or None, verdict)
        if good or verdict is None or self._attempt >= MAX_ATTEMPTS:
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
