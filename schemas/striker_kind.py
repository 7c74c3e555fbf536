"""Kinds of striker that a rig file can name, and what follows from the kind for checks and plans."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

KindName = Literal["dynamixel", "serial", "manual"]


@dataclass(frozen=True)
class StrikerKind:
    """Properties that all strikers of one kind have in common."""

    description: str
    """noun phrase for messages"""
    has_port: bool
    """True if it is on a serial port"""
    has_servo: bool
    """True if a servo moves its arm and measures the arm's angle, so that `strike --calibrate` can measure
    the effective mass"""
    has_limits: bool
    """True if it has a fixed range of speeds and heights, outside which a plan is refused"""
    states_speeds: bool
    """True if the rig file must state its range of tip speeds, which does not follow from arm and servo"""


STRIKER_KINDS: dict[KindName, StrikerKind] = {
    "dynamixel": StrikerKind(
        "an arm on a Dynamixel servo", has_port=True, has_servo=True, has_limits=True, states_speeds=False
    ),
    "serial": StrikerKind(
        "a microcontroller on a serial port that fires the striker",
        has_port=True,
        has_servo=False,
        has_limits=True,
        states_speeds=True,
    ),
    "manual": StrikerKind(
        "a person who strikes by hand",
        has_port=False,
        has_servo=False,
        has_limits=False,
        states_speeds=False,
    ),
}
