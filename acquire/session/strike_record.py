"""Record of one strike for the recording, as parameters of the request `recording.strike`."""

from __future__ import annotations

from typing import Any

from acquire.session.actions import WriteRecord


def strike_record(action: WriteRecord, anchor_ns: int) -> dict[str, Any]:
    """Members of the message StrikeRecord.

    Args:
        action: the strike, with what was commanded, measured and judged.
        anchor_ns: log time minus host monotonic time [ns].
    """
    verdict = action.verdict
    contact_ns, contact_sd_ns = _contact(action, anchor_ns)
    record: dict[str, Any] = {
        "strike_id": action.strike_id,
        "plan_strike_id": action.strike.id,
        "attempt": action.attempt,
        "window_start_ns": action.recorded.window_start_ns,
        "window_end_ns": action.recorded.window_end_ns,
        "contact_time_ns": contact_ns,
        "contact_time_sd_ns": contact_sd_ns,
        "tip_speed_command_m_s": action.tip_speed_command_m_s,
        "tip_speed_m_s": action.struck.tip_speed_m_s or 0.0,
        "R_world_object": [value for row in action.strike.R_world_object for value in row],
        "p_world_object": action.strike.p_world_object,
        "impact_height_m": action.strike.aim.impact_height_m,
        "choice_text": action.choice_text,
    }
    if verdict is not None:
        record |= {
            "verdict_code": verdict.code.value,
            "verdict_text": verdict.reason,
            "energy_ratio": verdict.energy_ratio or 0.0,
        }
    return record


def _contact(action: WriteRecord, anchor_ns: int) -> tuple[int, float]:
    """Log time of the contact of arm and object, and its standard deviation [ns]; both 0 if unknown.

    The striker's measurement is taken or, if there is none, the estimate from the images in the verdict.
    """
    measured_ns, verdict = action.struck.contact_time_ns, action.verdict
    if measured_ns:
        return measured_ns + anchor_ns, action.struck.contact_time_sd_ns
    if verdict is not None and verdict.contact_time_ns is not None:
        return verdict.contact_time_ns, verdict.contact_time_sd_ns or 0.0
    return 0, 0.0
