"""Parts of the snapshot, from what the daemon reports."""

from __future__ import annotations

import math
import time
from typing import Any, Final

from acquire.console.web.preview import ImageAids
from acquire.console.web.rig_link import RigReport
from acquire.console.web.snapshot import (
    ArmedView,
    CameraView,
    CheckLine,
    DiskView,
    PromptView,
    SessionView,
    StrikerView,
    StrikeView,
)
from acquire.session.countdown import HANDS_FRACTION
from schemas.rig import RigConfig
from schemas.strike_result import USABLE_VERDICTS

PLACED_MM: Final = 3.0
"""offset up to which the object counts as in place [mm]: a careful hand's; the pages show it in green"""
PLACED_DEG: Final = 2.0
"""turn up to which the object counts as in place [deg]"""
STILL_S: Final = 0.5
"""time without such changes after which the hands count as off [s]"""
MARKS: Final = {"pass": "pass", "fail": "fail", "not checked": "skip"}
"""marks of the outcomes that `acquire check` reports"""
USABLE: Final = frozenset(each.value for each in USABLE_VERDICTS)
ARMED: Final = frozenset({"armed", "cocking", "settled"})
POWERED: Final = ARMED | {"homed", "released", "contact", "miss", "catch", "verify"}


def camera_view(report: RigReport, rig: RigConfig, aids: ImageAids | None) -> CameraView | None:
    """Camera and its aids; None while no daemon runs."""
    status, watch = report.status, report.watch
    if status is None:
        return None
    saturated = None if aids is None else aids.saturated_fraction
    tag_px = None if aids is None else aids.tag_px
    if watch is not None:
        saturated = watch["saturated_fraction"]
        sides = [_mean_side(marker["corners_px"]) for marker in watch["markers"]]
        tag_px = min(sides, default=tag_px)
    return CameraView(
        model=f"{status['camera']['vendor']} {status['camera']['model']}".strip(),
        serial=str(status["camera"]["serial"]),
        fps=round(float(status["fps"]), 2),
        exposure_us=rig.camera.exposure_us,
        width=rig.camera.width,
        height=rig.camera.height,
        saturated_fraction=saturated,
        sharpness=None if aids is None else round(aids.sharpness, 1),
        tag_px=None if tag_px is None else round(tag_px, 1),
        frames=int(status["frames"]),
        lost=int(status["lost"]) + int(status["dropped"]),
    )


def check_line(line: dict[str, Any]) -> CheckLine:
    """Line of the preflight check, from its JSON object."""
    return CheckLine(
        name=str(line["name"]),
        outcome=MARKS.get(str(line["outcome"]), "warn"),  # pyright: ignore[reportArgumentType]
        text=str(line["found"]),
        remedy=str(line["remedy"]),
    )


def striker_view(report: RigReport) -> StrikerView | None:
    """Striker; None while no daemon runs. Whether a disarmed motor has torque is not known."""
    if report.status is None:
        return None
    state = str(report.status["striker"])
    torque = True if state in POWERED else False if state == "fault" else None
    return StrikerView(state=state, text=str(report.status["striker_trouble"]), torque=torque)


def armed_view(report: RigReport) -> ArmedView | None:
    """Countdown to the arming, or armed striker, which strikes as soon as it is cocked; None otherwise."""
    state = "" if report.status is None else str(report.status["striker"])
    if state in ARMED:
        return ArmedView(countdown_s=None)
    ends_ns = (report.session or {}).get("arms_at_ns")
    if report.status is None or ends_ns is None:
        return None
    return ArmedView(countdown_s=max(0.0, round(1e-9 * (ends_ns - time.time_ns()), 1)))


def disk_view(free_bytes: int, rig: RigConfig) -> DiskView:
    """Free space, and the time of recorded images for which it suffices."""
    camera = rig.camera
    bytes_per_minute = 60 * camera.width * camera.height * camera.frame_rate_hz
    usable = max(0, free_bytes - rig.recorder.disk_reserve_bytes)
    return DiskView(free_bytes=free_bytes, minutes_left=round(usable / bytes_per_minute, 1))


def session_view(report: RigReport, ended_by: str) -> SessionView | None:
    """Session that runs, or the last one; None before the first.

    Args:
        report: what the daemon reports.
        ended_by: reason why the session's program ended without a last report; empty if it did not.
    """
    session = report.session
    if session is None:
        return None
    hold, state, text = report.hold, session["state"], session["text"]
    over = state in {"finished", "aborted"}
    paused = None if over else (hold.get("text") or hold.get("later") or None)
    if not over and ended_by:
        state, text, paused = "aborted", ended_by, None
    return SessionView(
        id=str(session["began_ns"]),
        object=session["object"],
        plan=session["plan"],
        state=state,
        text=text,
        strike_id=session["strike_id"],
        attempt=session["attempt"],
        done=session["done"],
        total=session["total"],
        earlier=session["earlier"],
        max_strikes=session["max_strikes"],
        until=session["until"],
        paused=paused,
        file=session["file"],
        began_ns=session["began_ns"],
        strikes=[_strike_view(strike, report) for strike in session["strikes"]],
    )


def prompt_view(report: RigReport, still_s: float) -> PromptView | None:
    """Open question to place the object; None if there is none.

    Args:
        report: what the daemon reports.
        still_s: time for which nothing moved in and around the object [s].
    """
    prompt, watch = report.prompt, report.watch
    if prompt is None:
        return None
    outline, axes, offset, angle = None, None, None, None
    if watch is not None:
        outline, axes = watch.get("outline_px"), watch.get("axes_px")
        if watch.get("offset_m") is not None:
            offset = [round(1e3 * each, 1) for each in watch["offset_m"]]
            angle = math.degrees(watch["yaw_error_rad"])
        elif watch.get("placement_error_rad") is not None:
            angle = math.degrees(watch["placement_error_rad"])
    in_place = None
    if offset is not None and angle is not None:
        in_place = math.hypot(*offset) <= PLACED_MM and abs(angle) <= PLACED_DEG
    hint = prompt.get("hint") or (watch or {}).get("text", "")
    return PromptView(
        id=prompt["prompt_id"],
        kind=prompt["kind"],
        text=prompt["text"],
        hint=hint,
        strike_id=str(prompt.get("strike_id", "")),
        edge=str(prompt.get("edge", "")),
        card=f"/api/cards/{prompt['strike_id']}" if prompt.get("strike_id") else "",
        outline_px=outline,
        axes_px=axes,
        offset_mm=offset,
        angle_deg=None if angle is None else round(angle, 1),
        in_place=in_place,
        hands_off=watch is not None and still_s >= STILL_S,
    )


def is_still(watch: dict[str, Any] | None) -> bool:
    """True if nothing moves in and around the object in the newest image, and its tags rest."""
    if watch is None or not watch["at_rest"]:
        return False
    moving = watch.get("moving_fraction")
    return moving is None or moving <= HANDS_FRACTION


def _strike_view(strike: dict[str, Any], report: RigReport) -> StrikeView:
    phi, sd = strike["phi_rad"], strike["phi_sd_rad"]
    return StrikeView(
        id=strike["id"],
        edge=strike["edge"],
        verdict=strike["verdict"],
        reason=strike["reason"],
        phi_deg=None if phi is None else round(math.degrees(phi), 3),
        phi_sd_deg=None if sd is None else round(math.degrees(sd), 4),
        energy_ratio=strike["energy_ratio"],
        used=strike["verdict"] in USABLE,
        curve=strike["id"] in report.curves,
    )


def _mean_side(corners: list[list[float]]) -> float:
    return sum(math.dist(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)) / 4
