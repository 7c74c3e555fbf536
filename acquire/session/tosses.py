"""State machine of a session's tosses by hand: events in, actions out, as in `machine.py`.

    ask → record until the object lies still → judge → write → next, or again

Tosses follow the strikes. A toss that cannot be used (too slow, too short, not seen, ...) is repeated until
it was attempted MAX_ATTEMPTS times; one without a verdict is not. The operator may leave a toss out, or
repeat the one before.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from acquire.errors import SessionError
from acquire.session.actions import (
    Action,
    Announce,
    AskToToss,
    CloseRecording,
    JudgeToss,
    ParkStriker,
    RecordToss,
    WriteToss,
)
from acquire.session.adaptive import Target
from acquire.session.earlier import EarlierStrikes
from acquire.session.events import (
    Event,
    FileCutShort,
    Order,
    Ordered,
    Placed,
    Recorded,
    Started,
    StopRequested,
    StrikerFailed,
    Tossed,
    TossJudged,
)
from acquire.session.machine import MAX_ATTEMPTS, MAX_FAULTS, SessionMachine, State
from acquire.session.options import SessionOptions
from schemas.strike_plan import PlannedToss, StrikePlan
from schemas.toss_result import TossVerdict
from schemas.watch_lines import TossJudgement


class TossMachine:
    """State machine of the tosses of one session.

    Args:
        tosses: planned tosses, at least one.
        missed: True if the strikes before ended without the session's target.
        attempts: numbers of the last attempts in earlier recordings, by id of the planned toss.
    """

    def __init__(
        self,
        tosses: Sequence[PlannedToss],
        *,
        missed: bool = False,
        attempts: Mapping[str, int] | None = None,
    ) -> None:
        self.state = State.PLACING
        self._tosses = tuple(tosses)
        self._missed = missed
        self._index = 0
        self._attempts = Counter(attempts or {})
        self._tries = Counter[str]()
        """attempts in this session, by id of the planned toss"""
        self._recorded: Recorded | None = None
        self._last_made: int | None = None
        self._faults = 0
        self.skipped: list[str] = []
        """ids of the tosses that were left out"""

    @property
    def toss(self) -> PlannedToss:
        """Planned toss that the session is at; after the end, the last one."""
        return self._tosses[min(self._index, len(self._tosses) - 1)]

    @property
    def done(self) -> int:
        """Number of tosses made or left out."""
        return self._index

    @property
    def untouched(self) -> bool:
        """True until a toss was recorded or left out."""
        return self._index == 0 and self._last_made is None and self.state is State.PLACING

    @property
    def attempt(self) -> int:
        """Number of the current attempt at the planned toss, from 1."""
        return self._attempts[self.toss.id] + 1

    def begin(self) -> list[Action]:
        """Actions with which the tosses begin: the striker's arm is moved out of the way."""
        return [ParkStriker(), *self._ask()]

    def handle(self, event: Event) -> list[Action]:
        """Advance by one event and return the actions to execute, in order.

        Raises:
            ValueError: the event does not belong to the present state.
        """
        match event:
            case StopRequested(text=text):
                self.state = State.ABORTED
                return [self._announce(text), CloseRecording(aborted=True, text=text)]
            case FileCutShort(text=text) | StrikerFailed(text=text):
                return self._after_fault(text)
            case Placed() if self.state is State.PLACING:
                self.state = State.TOSSING
                return [self._announce(), RecordToss(self.toss)]
            case Ordered(order=order) if self.state is State.PLACING:
                return self._ordered(order)
            case Tossed(recorded=recorded) if self.state is State.TOSSING:
                self.state, self._recorded = State.JUDGING, recorded
                return [self._announce(), JudgeToss(self.toss, self.attempt, recorded)]
            case TossJudged(verdict=verdict) if self.state is State.JUDGING:
                return self._judged(verdict)
            case _:
                raise ValueError(
                    f"{type(event).__name__} does not belong to state {State.Name(self.state)} of a toss"
                )

    def _judged(self, verdict: TossJudgement | None) -> list[Action]:
        """Write a toss's record, and ask for it again or go on to the next one."""
        assert self._recorded is not None  # noqa: S101 - set on the way into JUDGING
        record = WriteToss(self.toss, self.attempt, self._recorded, verdict)
        self._attempts[self.toss.id] += 1
        self._tries[self.toss.id] += 1
        self._last_made = self._index
        good = verdict is None or verdict.code is TossVerdict.GOOD
        if good or self._tries[self.toss.id] >= MAX_ATTEMPTS:
            return [record, *self._next()]
        assert verdict is not None  # noqa: S101 - without one a toss counts as good
        return [record, *self._ask(f"again: {verdict.reason}")]

    def _ordered(self, order: Order) -> list[Action]:
        match order:
            case Order.SKIP:
                self.skipped.append(self.toss.id)
                return self._next()
            case Order.AGAIN:
                if self._last_made is not None:
                    self._index = self._last_made
                return self._ask("again, as ordered")
            case Order.HARDER:
                return self._ask("a toss is by hand: throw it as high as its card states")

    def _next(self) -> list[Action]:
        self._index += 1
        if self._index < len(self._tosses):
            return self._ask()
        self.state = State.FINISHED
        return [self._announce(), CloseRecording(missed=self._missed)]

    def _ask(self, hint: str = "") -> list[Action]:
        self.state = State.PLACING
        return [self._announce(hint), AskToToss(self.toss, hint)]

    def _after_fault(self, text: str) -> list[Action]:
        """Repeat a toss whose images were lost; more than MAX_FAULTS losses end the session."""
        self._faults += 1
        if self._faults > MAX_FAULTS:
            return self.handle(StopRequested(text))
        if self.state is State.PLACING and self._last_made is not None:
            self._index = self._last_made  # its record could not be written
        return [self._announce(text), *self._ask("again: its images were lost")]

    def _announce(self, text: str = "") -> Announce:
        inside = self.state is not State.FINISHED
        toss_id = self.toss.id if inside else ""
        return Announce(self.state, "", self.attempt if inside else 0, text, toss_id)


class StrikesAndTosses(SessionMachine):
    """State machine of a session whose plan has tosses: first the strikes, then the tosses.

    Where the strikes would close the recording, the tosses begin; a session that was stopped closes it.

    Args:
        plan: strikes and tosses to carry out.
        target: precision at which the strikes end; None to make every planned strike.
        earlier: strikes and tosses made before, in earlier recordings of the plan.
        only_tosses: True to make no strike; so it is if every planned strike was made before.

    Raises:
        SessionError: the plan has no tosses, or earlier recordings hold a good one of each, and no strike is
            left to be made.
    """

    def __init__(
        self,
        plan: StrikePlan,
        target: Target | None = None,
        earlier: EarlierStrikes | None = None,
        *,
        only_tosses: bool = False,
    ) -> None:
        if not plan.tosses:
            raise SessionError("the plan has no tosses: plan them with `analyze plan --tosses 3`")
        made = frozenset[str]() if earlier is None or target is not None else earlier.good
        only_tosses = only_tosses or all(strike.id in made for strike in plan.strikes)
        tossed = frozenset[str]() if earlier is None else earlier.good_tosses
        self._open = tuple(toss for toss in plan.tosses if toss.id not in tossed)
        self._tossed_before = None if earlier is None else earlier.attempts
        if earlier is not None and only_tosses and not self._open:
            raise SessionError(
                f"{', '.join(earlier.paths)}: every planned toss was made, and no strike is left: "
                "estimate the recordings together, or plan more"
            )
        super().__init__(plan, None if only_tosses else target, None if only_tosses else earlier)
        self._only_tosses = only_tosses
        self.tosses: TossMachine | None = None
        """state machine of the tosses; None during the strikes"""

    @property
    def only_tosses(self) -> bool:
        """True if no strike is to be made."""
        return self._only_tosses

    @property
    def progress(self) -> tuple[int, int]:
        """Number of strikes and tosses done or skipped, and number of all that are planned."""
        count = len(self.plan.tosses)
        tossed = count - len(self._open) + (0 if self.tosses is None else self.tosses.done)
        if self._only_tosses:
            return tossed, count
        done, total = super().progress
        if self.tosses is None and self.state is not State.FINISHED:
            return done, total + count
        return total + tossed, total + count

    @property
    def skipped(self) -> tuple[str, ...]:
        """Ids of the strikes and tosses that were left out."""
        return (*super().skipped, *(() if self.tosses is None else self.tosses.skipped))

    def handle(self, event: Event) -> list[Action]:
        """Advance by one event and return the actions to execute, in order.

        Raises:
            ValueError: the event does not belong to the present state.
        """
        if self.tosses is not None and not (isinstance(event, FileCutShort) and self.tosses.untouched):
            return self.tosses.handle(event)
        self.tosses = None  # again the last strike, whose record could not be written
        if self._only_tosses and isinstance(event, Started):
            return self._begin_tosses(missed=False)
        found = super().handle(event)
        *before, last = found
        if isinstance(last, CloseRecording) and not last.aborted and self._open:
            # Neither is the end announced, which the action before the last would do.
            return [*before[:-1], *self._begin_tosses(missed=last.missed)]
        return found

    def _begin_tosses(self, *, missed: bool) -> list[Action]:
        self.tosses = TossMachine(self._open, missed=missed, attempts=self._tossed_before)
        return self.tosses.begin()


def session_machine(plan: StrikePlan, options: SessionOptions, *, untagged: bool = False) -> SessionMachine:
    """State machine of a session by its plan: with tosses if the plan has any, or if only they are wanted.

    Raises:
        SessionError: nothing is left to be done: the plan has no tosses and only those are wanted, or every
            planned strike was made before.
    """
    if plan.tosses or options.only_tosses:
        machine = StrikesAndTosses(plan, options.target, options.earlier, only_tosses=options.only_tosses)
        if untagged and machine.only_tosses:
            raise SessionError(
                "without a tag a tossed object is followed by its print, which strikes of the same recording"
                " show, and no strike is to be made: make strikes and tosses in one session, or glue tags on"
            )
        return machine
    return SessionMachine(plan, options.target, options.earlier)
