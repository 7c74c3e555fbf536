"""Frame times from a file's time stamps: entries of the Result document, and sentences about them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.least_squares.intervals import SIGMAS_95
from schemas.quantity import Quantity
from schemas.result import FrameTimes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.pipeline.frame_rate import FrameRate

DROP_TEST = "film a drop: analyze frame-rate"


def frame_times_documents(rates: Sequence[FrameRate]) -> list[FrameTimes]:
    """Entries of the Result document on recordings' frame times, one per checked frame rate, in order."""
    return [_document(each) for each in rates]


def _document(rate: FrameRate) -> FrameTimes:
    """Frame times of one recording in the Result's form: source, sd [s], stated frame rate and its check.

    The strikes check the rate. Bounds and estimate of the true over the stated rate are None where the
    strikes do not give them.
    """
    check = rate.check
    return FrameTimes(
        recording=rate.recording,
        source=rate.time_source.value,
        sd_s=rate.time_sd_s,
        frame_rate_hz=rate.stated_hz,
        frame_rate_sd_hz=rate.stated_sd_hz,
        contact_sd_s=rate.contact_sd_s,
        rate_limits=None if check is None else [check.low, check.high],
        rate_ratio=(
            None
            if check is None or check.estimate is None
            else _ratio(check.estimate.ratio, check.estimate.sd)
        ),
        possible=rate.possible,
        likely_rate_hz=rate.likely_hz,
    )


def _ratio(value: float, sd: float) -> Quantity:
    """Unitless ratio with its standard deviation `sd` and its 95 % interval, value ± 1.96 sd."""
    return Quantity(value=value, sd=sd, unit="1", interval95=[value - SIGMAS_95 * sd, value + SIGMAS_95 * sd])


def wrong_text(times: FrameTimes) -> str:
    """Sentence on why the stated frame rate is impossible, with the likely rate if known, and the remedy.

    `times` must be the entry of a recording whose rate the strikes contradict (`possible` is False).
    """
    rate, limits, ratio = times.frame_rate_hz, times.rate_limits or [0.0, 0.0], times.rate_ratio
    if limits[0] <= 1 <= limits[1] and ratio is not None:
        why = (
            f"edges at different distances from the centre of mass give {_ratio_text(ratio)} times the stated"
            f" {rate:g} frames a second"
        )
    else:
        low, high = limits
        why = (
            f"no body of this shape tips like this at the stated {rate:g} frames a second, only at"
            f" {_factor_text(low)} to {_factor_text(high)} times that"
        )
        if ratio is not None:
            why += f", whatever its filling; edges at different distances give {_ratio_text(ratio)}"
    if times.likely_rate_hz is None:
        return f"{why}: import again with the true rate (--capture-fps); if it is unknown, {DROP_TEST}"
    likely = times.likely_rate_hz / rate
    multiple = f"{likely:g} times" if likely >= 1 else f"1/{1 / likely:g} of it"
    return (
        f"{why}: probably {times.likely_rate_hz:g} ({multiple}): import again with --capture-fps"
        f" {times.likely_rate_hz:g}"
    )


def unchecked_text(times: FrameTimes) -> str:
    """Sentence that the strikes do not determine the frame rate closely, or not at all, with the remedy."""
    if times.rate_limits is None:
        return f"these strikes cannot check the frame rate: {DROP_TEST}"
    low, high = times.rate_limits
    return (
        f"these strikes only show that the frame rate lies between {_factor_text(low)} and"
        f" {_factor_text(high)} times the stated {times.frame_rate_hz:g} a second; k is proportional to its"
        f" square: {DROP_TEST}"
    )


def frame_time_lines(times: Sequence[FrameTimes] | None, several: bool) -> list[str]:
    """Lines of text on where frame times come from and how the frame rate was checked.

    Args:
        times: frame times of recordings, from the Result document; None if no recording's times come from a
            file's time stamps.
        several: True to add the recording's number to each line.

    Returns:
        One or two lines per recording in `times`; empty for None or no recordings.
    """
    found: list[str] = []
    for each in times or []:
        recording = f" of recording {each.recording}" if several else ""
        contact = (
            ""
            if each.contact_sd_s is None
            else f"; contact from the motion's onset, ± {1e3 * SIGMAS_95 * each.contact_sd_s:.1f} ms"
        )
        sd = each.frame_rate_sd_hz
        known = "as stated" if sd is None else f"± {SIGMAS_95 * sd:.2g} as measured"
        found.append(
            f"time source{recording}: container time stamps (± {1e3 * SIGMAS_95 * each.sd_s:.2g} ms),"
            f" {each.frame_rate_hz:g} frames a second {known}{contact}"
        )
        if not each.possible:
            found.append(f"frame rate{recording}: not as stated")
        elif each.rate_ratio is not None:
            found.append(
                f"frame rate{recording}: {_ratio_text(each.rate_ratio)} times as stated, by edges at"
                " different distances from the centre of mass"
            )
        elif sd is None:
            found.append(f"frame rate{recording}: not checked closely by these strikes: {DROP_TEST}")
    return found


def _ratio_text(ratio: Quantity) -> str:
    """Text of a ratio and the half width of its 95 % interval, to three decimals, as "1.002 ± 0.004"."""
    value, sd = (each if isinstance(each, float) else 0.0 for each in (ratio.value, ratio.sd))
    return f"{value:.3f} ± {SIGMAS_95 * sd:.3f}"


def _factor_text(ratio: float) -> str:
    """Text of a factor with two decimals if it is below 10, otherwise with none."""
    return f"{ratio:.2f}" if ratio < 10 else f"{ratio:.0f}"
