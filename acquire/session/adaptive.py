"""Order of the strikes of a session that stops itself, by the answers of `analyze advise`.

The session ends when the answer so far is as certain as was asked and its checks pass, or when no number of
strikes is expected to make it so. Without an answer the next strike is the first of the plan without a good
verdict.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

from acquire.errors import SessionError
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import USABLE_VERDICTS, Verdict
from schemas.watch_lines import AdviceRequest, SessionEstimate, StrikeVerdict
from schemas.wording import counted

DEFAULT_MAX_STRIKES = 20
"""largest number of strikes of a session that stops itself, if none is given"""
MAX_FAILURES = 4
"""attempts of one planned strike without a usable verdict after which it is given up"""
MAX_DOUBTED = 6
"""answers in a row that are certain enough but fail a check, after which the session ends"""
_SYNTAX = "write it as com=0.5mm, inertia=2%, or both with a comma between them"


@dataclass(frozen=True)
class Target:
    """Precision at which a session stops itself; None for a quantity that does not matter."""

    com_m: float | None = None
    """half width of the 95 % interval of the centre of mass in its least certain direction [m]"""
    inertia: float | None = None
    """relative half width of the 95 % intervals of the diagonal moments of inertia"""
    max_strikes: int = DEFAULT_MAX_STRIKES
    """largest number of strikes"""
    earlier: tuple[str, ...] = ()
    """paths of earlier recordings of the object, whose strikes count as well"""

    @classmethod
    def parse(cls, text: str, max_strikes: int = DEFAULT_MAX_STRIKES) -> Target:
        """Target from a text such as "com=0.5mm,inertia=2%".

        Raises:
            SessionError: the text is no target.
        """
        found: dict[str, float] = {}
        for part in text.split(","):
            match = re.fullmatch(r"\s*(com|inertia)\s*=\s*(\d+\.?\d*|\.\d+)\s*(mm|%)\s*", part)
            if match is None or (match[1] == "com") != (match[3] == "mm") or float(match[2]) <= 0:
                raise SessionError(f"--until {text}: {part.strip()!r} is no target: {_SYNTAX}")
            if match[1] in found:
                raise SessionError(f"--until {text}: {match[1]} is there twice: {_SYNTAX}")
            found[match[1]] = float(match[2]) * (1e-3 if match[1] == "com" else 1e-2)
        return cls(found.get("com"), found.get("inertia"), max_strikes)

    def __str__(self) -> str:
        """Text of the target, as `parse` reads it."""
        parts = [] if self.com_m is None else [f"com={1e3 * self.com_m:g}mm"]
        return ",".join([*parts, *([] if self.inertia is None else [f"inertia={100 * self.inertia:g}%"])])


class AdaptiveOrder:
    """Order of the strikes of a session that stops itself.

    Args:
        plan: strikes that can be made, each as often as needed.
        target: precision at which the session stops.
    """

    def __init__(self, plan: StrikePlan, target: Target) -> None:
        self.target = target
        self.made = 0
        """number of strikes made"""
        self.ending = ""
        """reason why the session stopped itself; "" while it goes on"""
        self.missed = False
        """True if it ends without its target"""
        self.reason = ""
        """reason for the present choice"""
        self._plan = plan
        self._requests = 0
        self._good: set[str] = set()
        self._failures: Counter[str] = Counter()
        self._excluded: set[str] = set()
        self._doubted = 0
        """answers in a row that are certain enough but fail a check"""
        self._last = ""
        self._newest = ""
        self._stands = False

    def note_strike(self, strike: PlannedStrike, strike_id: str, verdict: StrikeVerdict | None) -> None:
        """Take note of a strike that was made, with its verdict; None if it has none."""
        self.made += 1
        self._last, self._newest = strike.id, strike_id
        self._stands = verdict is not None and verdict.code is Verdict.ROCKED_BACK
        if verdict is not None and verdict.code in USABLE_VERDICTS:
            self._good.add(strike.id)
            return
        self._failures[strike.id] += 1
        if self._failures[strike.id] >= MAX_FAILURES:
            self._excluded.add(strike.id)

    def exclude(self, strike: PlannedStrike) -> None:
        """Leave out a planned strike from now on: its placement was refused too often, or it was skipped."""
        self._excluded.add(strike.id)

    def request(self) -> AdviceRequest:
        """Request for advice on the next strike."""
        self._requests += 1
        return AdviceRequest(
            number=self._requests,
            strike_id=self._newest,
            target_com_m=self.target.com_m,
            target_inertia=self.target.inertia,
            left=max(self.target.max_strikes - self.made, 0),
            last_plan_strike_id=self._last,
            stands=self._stands,
            excluded=sorted(self._excluded),
            failures=dict(self._failures),
            earlier=list(self.target.earlier),
        )

    def next_strike(self, estimate: SessionEstimate | None) -> PlannedStrike | None:
        """Next strike by an answer; None if the session is to end, for the reason in `ending`.

        Args:
            estimate: answer of `analyze advise`; None if there was none.
        """
        if estimate is not None and estimate.target.met:
            more = " and the earlier ones" if self.target.earlier else ""
            self.ending = f"{self.target} is reached after {counted(self.made, 'strike')}{more}"
            return None
        failed = "" if estimate is None else self._failed_checks(estimate)
        self._doubted = self._doubted + 1 if failed else 0
        if self._doubted > MAX_DOUBTED:
            return self._give_up(f"the answer is certain enough, but its checks fail: {failed}")
        if self.made >= self.target.max_strikes:
            most = f"{counted(self.made, 'strike')} were made, as many as --max-strikes allows"
            return self._give_up(f"{most}; {failed}" if failed else most)
        if estimate is None:
            return self._by_plan()
        chosen = None if estimate.next is None else estimate.next
        known = {strike.id: strike for strike in self._plan.strikes}
        if chosen is None or chosen.strike_id not in known:
            return self._give_up(estimate.target.reason or "no strike is left to choose")
        self.reason = chosen.reason
        return known[chosen.strike_id]

    def _failed_checks(self, estimate: SessionEstimate) -> str:
        """Failed checks of an answer that is certain enough, in words; "" if it is not, or none failed."""
        for limit, half_width in (
            (self.target.com_m, estimate.com_half_width_m),
            (self.target.inertia, estimate.inertia_half_width),
        ):
            if limit is not None and (half_width is None or half_width > limit):
                return ""
        return "; ".join(f"{check.name}: {check.text}" for check in estimate.checks if not check.passed)

    def _by_plan(self) -> PlannedStrike | None:
        """First strike of the plan without a good verdict, where `analyze advise` does not answer."""
        for strike in self._plan.strikes:
            if strike.id not in self._good and strike.id not in self._excluded:
                self.reason = "next of the plan: the answer so far was not ready in time"
                return strike
        return self._give_up("every planned strike was made, and no answer so far was ready in time")

    def _give_up(self, text: str) -> None:
        self.ending, self.missed = text, True


def estimate_text(estimate: SessionEstimate | None) -> str:
    """Line for the operator on an answer so far; "" if it states no centre of mass."""
    if estimate is None or estimate.com_half_width_m is None:
        return ""
    failed = [check.name for check in estimate.checks if not check.passed]
    doubts = f", not yet: {', '.join(failed)}" if failed else ""
    return (
        f"so far: centre of mass to {1e3 * estimate.com_half_width_m:.2f} mm from "
        f"{counted(estimate.strikes, 'strike')}{doubts}"
    )
