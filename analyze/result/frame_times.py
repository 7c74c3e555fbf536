"""Frame times that a file states and no clock of ours gave, in words: what they are, and whether the strikes bear them out."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from schemas.result import FrameTimes, Quantity

SIGMAS95 = 1.96
DROP_TEST = "film a drop: analyze calibrate --drop"


def wrong_text(times: FrameTimes) -> str:
    """Why the stated rate cannot be, and what to do."""
    rate, limits, told = times.frame_rate_hz, times.rate_limits or [0.0, 0.0], times.rate_ratio
    if limits[0] <= 1 <= limits[1] and told is not None:
        why = f"edges at different distances from the centre of mass mean {_told(told)} times the {rate:g} frames a second stated"
    else:
        low, high = limits
        why = f"nothing of this shape tips so at the {rate:g} frames a second stated, but at {_times(low)} to {_times(high)} times that"
        if told is not None:
            why += f", whatever fills it; by edges at different distances {_told(told)}"
    if times.likely_rate_hz is None:
        return f"{why}: import again with the true rate (--capture-fps); where nobody knows it, {DROP_TEST}"
    ratio = times.likely_rate_hz / rate
    say = f"{ratio:g} times" if ratio >= 1 else f"1/{1 / ratio:g} of it"
    return f"{why}: probably {times.likely_rate_hz:g} ({say}): import again with --capture-fps {times.likely_rate_hz:g}"


def unchecked_text(times: FrameTimes) -> str:
    """That nothing tells the rate closely, and what would."""
    if times.rate_limits is None:
        return f"the frame rate is not checkable from these strikes: {DROP_TEST}"
    low, high = times.rate_limits
    return (
        f"the frame rate is not checkable from these strikes, but that it lies between {_times(low)} and {_times(high)} times the "
        f"{times.frame_rate_hz:g} a second stated; k goes with its square: {DROP_TEST}"
    )


def frame_time_lines(times: Sequence[FrameTimes] | None, several: bool) -> list[str]:
    """What the times are, a line or two per recording."""
    found: list[str] = []
    for each in times or []:
        whose = f" of recording {each.recording}" if several else ""
        contact = "" if each.contact_sd_s is None else f"; contact from the motion's onset, ± {1e3 * SIGMAS95 * each.contact_sd_s:.1f} ms"
        sd = each.frame_rate_sd_hz
        known = "as stated" if sd is None else f"± {SIGMAS95 * sd:.2g} as measured"
        found.append(
            f"time source{whose}: container time stamps (± {1e3 * SIGMAS95 * each.sd_s:.2g} ms), {each.frame_rate_hz:g} frames a second "
            f"{known}{contact}"
        )
        if not each.possible:
            found.append(f"frame rate{whose}: not as stated")
        elif each.rate_ratio is not None:
            found.append(
                f"frame rate{whose}: {_told(each.rate_ratio)} times as stated, by edges at different distances from the centre of mass"
            )
        elif sd is None:
            found.append(f"frame rate{whose}: not checked closely by these strikes: {DROP_TEST}")
    return found


def _told(ratio: Quantity) -> str:
    value, sd = (each if isinstance(each, float) else 0.0 for each in (ratio.value, ratio.sd))
    return f"{value:.3f} ± {SIGMAS95 * sd:.3f}"


def _times(ratio: float) -> str:
    return f"{ratio:.2f}" if ratio < 10 else f"{ratio:.0f}"
