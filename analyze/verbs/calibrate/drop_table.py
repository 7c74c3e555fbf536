"""What a filmed drop tells, for people and for scripts."""

from __future__ import annotations

import math
from typing import Any

from analyze.pipeline.frame_rate import RATE_SD
from analyze.verbs.calibrate.drop import DropAnswer
from schemas.document import SCHEMA_VERSION

SIGMAS95 = 1.96
USUAL = (
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
"""frames a second that cameras say they have"""
MUCH_AIR = 0.05
"""of g, at the end of the fall"""
APART = 3.0
ROUGH = 2.0
"""times the corners' noise"""


def capture_fps(answer: DropAnswer) -> float:
    """What to import with: the usual rate that lies within the interval, else the one measured."""
    half = SIGMAS95 * answer.true_sd_hz
    near = min(USUAL, key=lambda rate: abs(rate - answer.true_hz))
    return near if abs(near - answer.true_hz) <= half else float(f"{answer.true_hz:.4g}")


def capture_fps_sd(answer: DropAnswer) -> float:
    """1 sigma of it: as measured; of a usual rate what that is known to beforehand counts as well."""
    measured, rate = answer.true_sd_hz, capture_fps(answer)
    return measured if rate not in USUAL else float((measured**-2 + (RATE_SD * rate) ** -2) ** -0.5)


def drop_text(answer: DropAnswer) -> list[str]:
    """A line each."""
    time, film, falls = answer.time, answer.film, answer.falls
    to_hz = SIGMAS95 * answer.true_hz / time.slower
    longest = max(falls, key=lambda fall: fall.dropped)
    many = "1 fall" if len(falls) == 1 else f"{len(falls)} falls"
    size = f"{1e3 * film.size:g} ± {SIGMAS95 * 1e3 * film.size_sd:.2g} mm"
    seen = f"marker {answer.marker_id} in {answer.seen} of {answer.frames} frames, {many}"
    shares = (
        f"{to_hz * time.by_noise:.2f} by the falls (noise, air, shutter, turning)",
        f"{to_hz * time.by_size:.2f} by the tag's size ({size}; one that is larger by 1 % makes the rate lower by 0.5 %)",
        f"{to_hz * time.by_gravity:.2f} by g ({film.gravity:.3f} ± {SIGMAS95 * film.gravity_sd:.3f} m/s²)",
    )
    lines = [
        f"{seen}: the longest of {longest.frames} frames over {longest.dropped:.2f} m, {1e3 * longest.residual:.2f} mm off a parabola",
        f"frame rate: {answer.true_hz:.2f} ± {to_hz * time.sd:.2f} a second (95 % interval); the film's times state {answer.stated_hz:.2f}",
        f"one second of the film's times is {time.slower:.5f} ± {SIGMAS95 * time.sd:.5f} s",
        f"of that ±: {', '.join(shares)}",
    ]
    if abs(time.slower - 1) <= SIGMAS95 * time.sd:
        lines.append("the film's times are true as far as this shows")
    lines.append(
        f"import what this camera films so with --capture-fps {capture_fps(answer):g} --capture-fps-sd {capture_fps_sd(answer):.2g}"
    )
    return lines + doubts(answer)


def doubts(answer: DropAnswer) -> list[str]:
    """What speaks against it, a line each."""
    found: list[str] = []
    worst = max(answer.falls, key=lambda fall: abs(fall.drag_share))
    if worst.drag_share > MUCH_AIR:
        found.append(
            f"doubt: air takes {worst.drag_share:.0%} of g at the end of the fall: glue the tag to something heavy and small, and state "
            "its mass (--mass-g)"
        )
    beta, beta_sd = answer.film.drag
    if worst.drag_share < -0.01 and beta < 3 * beta_sd:
        found.append("doubt: the fall bends as no air bends it: a rolling shutter? State line_time_s in the camera file")
    if answer.time.apart > APART:
        found.append(
            f"doubt: the falls differ by {answer.time.apart:.1f} times what they are known to: drop it without a push, and turn nothing"
        )
    rough = max(fall.scatter for fall in answer.falls)
    if rough > ROUGH:
        found.append(
            f"doubt: the fall scatters by {rough:.1f} times the corners' noise: blur (more light, a shorter exposure), or a soft card"
        )
    if answer.film.line_time is None:
        found.append(
            "note: how long the shutter takes is not known, anything up to a frame is allowed for: --global-shutter, or line_time_s in the "
            "camera file, narrows it"
        )
    return found


def drop_json(answer: DropAnswer) -> dict[str, Any]:
    """Everything, ready for JSON."""
    time, film = answer.time, answer.film
    return {
        "schema_version": SCHEMA_VERSION,
        "marker": answer.marker_id,
        "frames": answer.frames,
        "frames_with_marker": answer.seen,
        "stated_frame_rate_hz": answer.stated_hz,
        "frame_rate_hz": answer.true_hz,
        "frame_rate_sd_hz": answer.true_sd_hz,
        "seconds_per_stated_second": time.slower,
        "seconds_per_stated_second_sd": time.sd,
        "sd_by": {"falls": time.by_noise, "marker_size": time.by_size, "gravity": time.by_gravity},
        "falls_apart": time.apart,
        "capture_fps": capture_fps(answer),
        "capture_fps_sd": capture_fps_sd(answer),
        "marker_size_m": film.size,
        "marker_size_sd_m": film.size_sd,
        "gravity_m_s2": film.gravity,
        "mass_kg": film.mass,
        "line_time_s": film.line_time,
        "doubts": doubts(answer),
        "falls": [
            {
                "start_ns": fall.start_ns,
                "end_ns": fall.end_ns,
                "frames": fall.frames,
                "fall_m": fall.dropped,
                "seconds_per_stated_second": fall.slower,
                "sd": math.hypot(fall.noise_sd, fall.shared_sd),
                "residual_m": fall.residual,
                "scatter": fall.scatter,
                "drag_share": fall.drag_share,
                "px_per_frame": fall.blur_px,
            }
            for fall in answer.falls
        ],
    }
