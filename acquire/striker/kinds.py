"""Choice of the striker's class by the rig file's `striker.kind`: the only place where the kind decides."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.striker.dynamixel import DynamixelStriker
from acquire.striker.manual import ManualStriker
from acquire.striker.serial_striker import SerialStriker

if TYPE_CHECKING:
    from acquire.striker.base import ClockSink, EventSink, SampleSink, Striker
    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig
    from schemas.striker_kind import KindName

CLASSES: dict[KindName, type[DynamixelStriker | SerialStriker | ManualStriker]] = {
    "dynamixel": DynamixelStriker,
    "serial": SerialStriker,
    "manual": ManualStriker,
}
"""class of each kind of striker"""


def make_striker(
    config: StrikerConfig,
    sample_sink: SampleSink,
    event_sink: EventSink,
    clock_sink: ClockSink,
    clock: MonotonicClock,
) -> Striker:
    """Striker of the kind that the rig file names; it is not opened.

    Args:
        config: section `striker` of the rig file.
        sample_sink: called with every sample of a striker that has an encoder.
        event_sink: called with the events of strikes.
        clock_sink: called with readings of the striker's clock, where it has one.
        clock: host monotonic time.
    """
    return CLASSES[config.kind](config, sample_sink, event_sink, clock_sink, clock)
