"""Text and JSON of a frame rate that `analyze frame-rate` measured."""

from __future__ import annotations

import math
from typing import Any

from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.frame_rate import STATED_RATE_SD
from analyze.verbs.frame_rate.drop import DropAnswer
from schemas.document import SCHEMA_VERSION
from schemas.wording import counted

COMMON_FRAME_RATES_HZ = (
    24.0,
    25.0,
    30.0,
    48.0,
    50.0,
    60.0,
    90.0,
    100.0,
    120.0,
    180.0,
    200.0,
    240.0,
    250.0,
    300.0,
    400.0,
    480.0,
    500.0,
    600.0,
    960.0,
    1000.0,
    1920.0,
)
"""usual frame rates of cameras [Hz]"""
MAX_DRAG_SHARE = 0.05
"""deceleration by air drag at the end of a fall, as a fraction of g, above which the rate is doubted"""
MAX_BIRGE_RATIO = 3.0
"""scatter of the falls' rates over that which their standard deviations predict (Birge ratio), above which
the rate is doubted"""
MAX_SCATTER = 2.0
"""factor on the noise of the tag's corners that a fall's residuals show, above which the rate is doubted"""


def capture_fps(answer: DropAnswer) -> float:
    """Frame rate [Hz] to state when videos of this camera are imported.

    It is the usual rate of cameras (`COMMON_FRAME_RATES_HZ`) nearest to the measured rate if it lies within
    the 95 % interval, else the measured rate, rounded to four significant digits, or to as many more as keep
    it within the interval.
    """
    half = SIGMAS_95 * answer.true_sd_hz
    near = min(COMMON_FRAME_RATES_HZ, key=lambda rate: abs(rate - answer.true_hz))
    rounded = (float(f"{answer.true_hz:.{digits}g}") for digits in range(4, 18))
    return next(rate for rate in (near, *rounded) if abs(rate - answer.true_hz) <= half)


def capture_fps_sd(answer: DropAnswer) -> float:
    """Standard deviation [Hz] of `capture_fps`, the frame rate to state when videos are imported.

    If `capture_fps` is the measured rate, it is the measurement's. If it is a usual rate of cameras, the
    measurement is combined with the usual accuracy of such rates (`STATED_RATE_SD`, relative).
    """
    measured, rate = answer.true_sd_hz, capture_fps(answer)
    return (
        measured
        if rate not in COMMON_FRAME_RATES_HZ
        else float((measured**-2 + (STATED_RATE_SD * rate) ** -2) ** -0.5)
    )


def drop_text(answer: DropAnswer) -> list[str]:
    """Lines for the terminal: measured frame rate [Hz], what each source adds to its uncertainty, doubts."""
    time, setup, falls = answer.time, answer.setup, answer.falls
    to_hz = SIGMAS_95 * answer.true_hz / time.time_ratio
    longest = max(falls, key=lambda fall: fall.dropped)
    many = counted(len(falls), "fall")
    size = f"{1e3 * setup.size:g} ± {SIGMAS_95 * 1e3 * setup.size_sd:.2g} mm"
    seen = f"marker {answer.marker_id} in {answer.seen} of {counted(answer.frames, 'frame')}, {many}"
    shares = (
        f"{to_hz * time.by_noise:.2f} by the falls (noise, air, shutter, rotation)",
        (
            f"{to_hz * time.by_size:.2f} by the tag's size ({size}; an edge larger by 1 % makes the rate "
            "lower by 0.5 %)"
        ),
        f"{to_hz * time.by_gravity:.2f} by g ({setup.gravity:.3f} ± {SIGMAS_95 * setup.gravity_sd:.3f} m/s²)",
    )
    lines = [
        (
            f"{seen}: the longest of {counted(longest.frames, 'frame')} over {longest.dropped:.2f} m, "
            f"{1e3 * longest.residual:.2f} mm off a parabola"
        ),
        (
            f"frame rate: {answer.true_hz:.2f} ± {to_hz * time.sd:.2f} a second (95 % interval); the video "
            f"states {answer.stated_hz:.2f}"
        ),
        f"one second of the video's times lasts {time.time_ratio:.5f} ± {SIGMAS_95 * time.sd:.5f} s",
        f"contributions to that ±: {', '.join(shares)}",
    ]
    if abs(time.time_ratio - 1) <= SIGMAS_95 * time.sd:
        lines.append("the video's times are true within this interval")
    lines.append(
        f"import this camera's videos of that mode with --capture-fps {capture_fps(answer):.12g} "
        f"--capture-fps-sd {capture_fps_sd(answer):.2g}"
    )
    return lines + doubts(answer)


def doubts(answer: DropAnswer) -> list[str]:
    """Reasons to doubt the measured frame rate, as lines for the terminal; empty if there are none.

    Each names a remedy. An unknown line time of the shutter adds a note.
    """
    found: list[str] = []
    worst = max(answer.falls, key=lambda fall: abs(fall.drag_share))
    if worst.drag_share > MAX_DRAG_SHARE:
        found.append(
            f"doubt: the air's drag reaches {worst.drag_share:.0%} of g: glue the tag to a small heavy body "
            "and give its mass (--mass-g)"
        )
    beta, beta_sd = answer.setup.drag
    if worst.drag_share < -0.01 and beta < 3 * beta_sd:
        found.append(
            "doubt: the fall deviates from a parabola as drag cannot explain: if the shutter rolls, add "
            "line_time_s to the camera file"
        )
    if answer.time.birge_ratio > MAX_BIRGE_RATIO:
        found.append(
            f"doubt: the falls differ by {answer.time.birge_ratio:.1f} times their uncertainty: drop it "
            "without a push or spin"
        )
    rough = max(fall.scatter for fall in answer.falls)
    if rough > MAX_SCATTER:
        found.append(
            f"doubt: the fall scatters by {rough:.1f} times the corners' noise: reduce blur (more light, "
            "shorter exposure), or use a stiff card"
        )
    if answer.setup.line_time is None:
        found.append(
            "note: the shutter's line time is unknown, and anything up to a frame is allowed for: "
            "--global-shutter, or line_time_s in the camera file, narrows the interval"
        )
    return found


def drop_json(answer: DropAnswer) -> dict[str, Any]:
    """Measured frame rate, its standard deviation, doubts and all falls, as JSON values.

    Units are in the keys (`_hz`, `_m`, `_kg`, `_ns`).
    """
    time, setup = answer.time, answer.setup
    return {
        "schema_version": SCHEMA_VERSION,
        "marker": answer.marker_id,
        "frames": answer.frames,
        "frames_with_marker": answer.seen,
        "stated_frame_rate_hz": answer.stated_hz,
        "frame_rate_hz": answer.true_hz,
        "frame_rate_sd_hz": answer.true_sd_hz,
        "seconds_per_stated_second": time.time_ratio,
        "seconds_per_stated_second_sd": time.sd,
        "sd_by": {"falls": time.by_noise, "marker_size": time.by_size, "gravity": time.by_gravity},
        "falls_apart": time.birge_ratio,
        "capture_fps": capture_fps(answer),
        "capture_fps_sd": capture_fps_sd(answer),
        "marker_size_m": setup.size,
        "marker_size_sd_m": setup.size_sd,
        "gravity_m_s2": setup.gravity,
        "mass_kg": setup.mass,
        "line_time_s": setup.line_time,
        "doubts": doubts(answer),
        "falls": [
            {
                "start_ns": fall.start_ns,
                "end_ns": fall.end_ns,
                "frames": fall.frames,
                "fall_m": fall.dropped,
                "seconds_per_stated_second": fall.time_ratio,
                "sd": math.hypot(fall.noise_sd, fall.shared_sd),
                "residual_m": fall.residual,
                "scatter": fall.scatter,
                "drag_share": fall.drag_share,
                "px_per_frame": fall.blur_px,
            }
            for fall in answer.falls
        ],
    }
