"""State machine of one session: events in, actions out, no I/O. `runner.py` executes the actions.

    place → check pose → arm → strike → record until at rest → judge → next

A session by its plan makes the planned strikes in their order. One that stops itself (adaptive.py) asks for
advice after every strike.

A strike without a good verdict is repeated with a tip speed estimated from all strikes so far, until it was
attempted MAX_ATTEMPTS times; every attempt is kept. A verdict is the answer of `analyze watch`, which judges
a strike from its images; a strike without any verdict is not repeated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from acquire.errors import SessionError
from acquire.session.actions import (
    Action,
    Advise,
    Announce,
    Arm,
    AskToPlace,
    CheckPose,
    ClearFault,
    CloseRecording,
    Judge,
    RecordUntilRest,
    Strike,
    WriteRecord,
)
from acquire.session.adaptive import AdaptiveOrder, Target
from acquire.session.earlier import EarlierStrikes, learn_earlier
from acquire.session.energy import EnergyLearner
from acquire.session.events import (
    Advised,
    Event,
    FileCutShort,
    Judged,
    Order,
    Ordered,
    Placed,
    PoseChecked,
    Ready,
    Recorded,
    Started,
    StopRequested,
    StrikerFailed,
    Struck,
)
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import Verdict

State = pb.SessionState.State


MAX_ATTEMPTS = 4
"""largest number of attempts per planned strike"""
MAX_PLACEMENTS = 3
"""number of rejected placements after which a planned strike is skipped"""
MAX_FAULTS = 3
"""number of device faults after which the next one ends the session"""
HARDER_RATIO = 1.15
"""ratio of tip speeds by which the operator's order "harder" raises that of the next attempt"""
ENERGY_ACCEPTED = (1.0, 2.5)
"""range of energy ratios (kinetic energy after the strike over the energy needed to reach balance) in which a
good strike is not repeated"""


class SessionMachine:
    """State machine of one session: the current planned strike, its attempt, and the learned tip speeds.

    `handle` takes an event and returns the next actions. Executing the last of them yields the next event.

    Args:
        plan: strikes to carry out; none where only tosses follow.
        target: precision at which the session stops itself; None to make every planned strike.
        earlier: strikes made before, in earlier recordings of the plan.

    Raises:
        SessionError: without a target, if earlier recordings hold a good strike of every planned one.
    """

    def __init__(
        self, plan: StrikePlan, target: Target | None = None, earlier: EarlierStrikes | None = None
    ) -> None:
        earlier = earlier or EarlierStrikes()
        self.plan = plan
        self.state = State.IDLE
        self.order = None if target is None else AdaptiveOrder(plan, replace(target, earlier=earlier.paths))
        self._done = earlier.good
        if plan.strikes and target is None and all(each.id in self._done for each in plan.strikes):
            raise SessionError(
                f"{', '.join(earlier.paths)}: every planned strike was made: estimate it, or give --until to "
                "go on"
            )
        self._index = self._first_open(0) if target is None else 0
        self._attempts = Counter(earlier.attempts)
        self._placements = 0
        self._skipped: list[str] = []
        self._faults = 0
        self.learner = EnergyLearner(plan)
        learn_earlier(self.learner, plan, earlier)
        self._command = 0.0
        self._raised: dict[str, float] = {}
        """ratio by which the operator raised the next tip speed, by planned strike"""
        self._struck: Struck | None = None
        self._recorded: Recorded | None = None
        self._attempt = 1 + (self._attempts[self.strike.id] if plan.strikes else 0)
        self._last_judged = (self._index, self._attempt)
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
    def attempt(self) -> int:
        """Number of the current attempt at the planned strike, from 1."""
        return self._attempt

    @property
    def progress(self) -> tuple[int, int]:
        """Number of planned strikes done or skipped, and number of all planned strikes.

        In a session that stops itself: number of strikes made, and largest number.
        """
        if self.order is not None:
            return self.order.made, self.order.target.max_strikes
        return self._index + (self.state is State.FINISHED), len(self.plan.strikes)

    @property
    def skipped(self) -> tuple[str, ...]:
        """Ids of the planned strikes that were given up after MAX_PLACEMENTS rejected placements."""
        return tuple(self._skipped)

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
        """Begin with the first planned strike, or ask for advice on the first one.

        Returns:
            Actions to execute, in order.
        """
        return self._place() if self.order is None else [Advise(self.order.request())]

    def on_advised(self, event: Advised) -> list[Action]:
        """React to the answer so far: place the object for the strike that tells most, or end the session.

        Returns:
            Actions to execute, in order.
        """
        assert self.order is not None  # noqa: S101 - only then advice is asked for
        strike = self.order.next_strike(event.estimate)
        if strike is None:
            return self._finish(self.order.ending, missed=self.order.missed)
        self._index = next(i for i, each in enumerate(self.plan.strikes) if each.id == strike.id)
        self._attempt, self._placements = 1 + self._attempts[strike.id], 0
        return self._place(f"chosen: {self.order.reason}")

    def on_placed(self, _event: Placed) -> list[Action]:
        """React to the placed object: check its pose.

        Returns:
            Actions to execute, in order.
        """
        self.state = State.CHECKING_POSE
        return [self._announce(), CheckPose(self.strike)]

    def on_ordered(self, event: Ordered) -> list[Action]:
        """React to an order of the operator who was asked to place the object.

        Returns:
            Actions to execute, in order.
        """
        match event.order:
            case Order.SKIP:
                return self._skip()
            case Order.HARDER:
                self._raised[self.strike.id] = self._raised.get(self.strike.id, 1.0) * HARDER_RATIO
                return self._place(
                    f"the next strike is {100 * (self._raised[self.strike.id] - 1):.0f} % faster"
                )
            case Order.AGAIN:
                index, attempt = self._last_judged
                if self._struck is not None and index != self._index:
                    self._index, self._attempt, self._placements = index, attempt + 1, 0
                return self._place("again, as ordered")

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
            return self._skip()
        return self._place(event.text)

    def on_ready(self, _event: Ready) -> list[Action]:
        """React to the armed striker: strike with the tip speed that all strikes so far suggest.

        Returns:
            Actions to execute, in order.
        """
        self.state = State.STRIKING
        speed = self.learner.tip_speed(self.strike) * self._raised.pop(self.strike.id, 1.0)
        self._command = min(speed, self.strike.aim.tip_speed_m_s.max)
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
        """React to the end of the recorded time span of a strike: ask for the verdict on the strike.

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

        A session that stops itself asks for advice. Otherwise a strike is repeated if its verdict is not good
        or its energy ratio (kinetic energy after the strike over that needed to reach balance) is known and
        outside ENERGY_ACCEPTED, until it was attempted MAX_ATTEMPTS times. Without a verdict it is not
        repeated. A swing that met nothing is not learned from.

        Returns:
            Actions to execute, in order.
        """
        verdict, struck, recorded = event.verdict, self._struck, self._recorded
        assert struck is not None  # noqa: S101 - set on the way into JUDGING
        assert recorded is not None  # noqa: S101 - set on the way into JUDGING
        self._last_judged = (self._index, self._attempt)
        reason = "" if self.order is None else self.order.reason
        record = WriteRecord(
            self.strike, self.strike_id, self._attempt, self._command, struck, recorded, verdict, reason
        )
        self._attempts[self.strike.id] = self._attempt
        good = False
        if verdict is not None:
            energy = verdict.energy_ratio
            low, high = ENERGY_ACCEPTED
            good = verdict.code is Verdict.GOOD and (energy is None or low <= energy <= high)
        missed = struck.tip_speed_m_s == 0 and (verdict is None or verdict.code is Verdict.NOT_MOVED)
        if not missed:
            self.learner.learn(self.strike, self._command, struck.tip_speed_m_s or None, verdict)
        if self.order is not None:
            self.order.note_strike(self.strike, self.strike_id, verdict)
            return [record, Advise(self.order.request())]
        if good or verdict is None or self._attempt >= MAX_ATTEMPTS:
            return [record, *self._next()]
        self._attempt += 1
        self._placements = 0
        return [record, *self._place(f"again: {verdict.reason}")]

    def _skip(self) -> list[Action]:
        """Actions that follow when a planned strike is given up."""
        self._skipped.append(self.strike.id)
        if self.order is not None:
            self.order.exclude(self.strike)
        return self._next()

    def _next(self) -> list[Action]:
        """Actions that follow when the session is done with a planned strike."""
        if self.order is not None:
            return [Advise(self.order.request())]
        if (index := self._first_open(self._index + 1)) < len(self.plan.strikes):
            self._index = index
            self._attempt, self._placements = 1 + self._attempts[self.strike.id], 0
            return self._place()
        return self._finish()

    def _first_open(self, start: int) -> int:
        """Index, from `start` on, of the first planned strike that has no good one before the session."""
        strikes = self.plan.strikes
        return next((i for i in range(start, len(strikes)) if strikes[i].id not in self._done), len(strikes))

    def _finish(self, text: str = "", *, missed: bool = False) -> list[Action]:
        self.state = State.FINISHED
        return [self._announce(text), CloseRecording(text=text, missed=missed)]


_REACTIONS: dict[type, tuple[frozenset[State], Callable[[SessionMachine, Any], list[Action]]]] = {
    StopRequested: (frozenset(), SessionMachine.on_stop_requested),
    Started: (frozenset({State.IDLE}), SessionMachine.on_started),
    Placed: (frozenset({State.PLACING}), SessionMachine.on_placed),
    Ordered: (frozenset({State.PLACING}), SessionMachine.on_ordered),
    # While arming, after a pause: the object may have been moved.
    PoseChecked: (frozenset({State.CHECKING_POSE, State.ARMING}), SessionMachine.on_pose_checked),
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
    Advised: (
        frozenset({State.IDLE, State.JUDGING, State.CHECKING_POSE, State.PLACING}),
        SessionMachine.on_advised,
    ),
}
"""states in which each event may come (none named: any state), and the reaction to it"""
