"""Waits of a session state how long they take at most."""

from __future__ import annotations

import pytest

from acquire.session.machine import State
from acquire.session.waits import longest_in

UNLIMITED = {State.STATE_UNSPECIFIED, State.IDLE, State.PLACING, State.FINISHED, State.ABORTED}
"""states without a wait, and that in which a person places the object"""


@pytest.mark.parametrize("state", State.values())
def test_every_state_that_waits_has_a_longest_time(state: int) -> None:
    shown = longest_in(state)  # pyright: ignore[reportArgumentType]
    assert bool(shown) == (state not in UNLIMITED)


def test_the_longest_time_is_shown_in_seconds() -> None:
    assert longest_in(State.CHECKING_POSE) == " (at most 8 s)"
    assert longest_in(State.ARMING) == " (at most 8 s)"
    assert longest_in(State.STRIKING) == " (at most 10 s)"
