"""What is in a recording, and how healthy it is: topics, rates, gaps, frames lost, clocks, session, strikes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from analyze.errors import RecordingCut, RecordingError
from analyze.file_row import missing_text
from analyze.planned_strikes import PlannedStrikes, planned_strikes
from analyze.recording import Recording, TopicInfo, open_partial, open_recording
from schemas import topics
from schemas.proto import percuss_pb2 as pb

GAP_PERIODS = 1.5
"""a frame is missing where two images in a window are farther apart than this many frame periods"""


def inspect_recording(path: Path) -> dict[str, Any]:
    """Everything about a recording, ready for JSON. A recording that is cut short is inspected as far as it goes.

    Raises:
        RecordingError: it is missing, no recording, or damaged.
    """
    try:
        with open_recording(path) as recording:
            return _describe(recording, complete=True)
    except RecordingCut:
        with open_partial(path) as recording:
            return _describe(recording, complete=False)


def _describe(recording: Recording, *, complete: bool) -> dict[str, Any]:
    manifest = recording.manifest
    found = recording.topics()
    times = [time for topic in found for time in (topic.first_ns, topic.last_ns) if time is not None and topic.count > 0]
    return {
        "path": str(recording.path),
        "bytes": sum(part.path.stat().st_size for part in recording.parts),
        "files": [{"path": str(part.path), "bytes": part.path.stat().st_size, "content_id": part.content_id} for part in recording.parts],
        "missing_files": list(recording.missing_parts),
        "complete": complete,
        "damaged_chunks": recording.damaged_chunks,
        "schema_version": manifest.schema_version,
        "recording_id": manifest.recording_id,
        "content_id": recording.content_id,
        "created": manifest.created,
        "software": manifest.software,
        "object": {
            "name": manifest.object.name,
            "mass_kg": manifest.object.mass_kg,
            "markers": [marker.name for marker in manifest.object.marker],
        },
        "start_ns": min(times, default=None),
        "duration_s": (max(times) - min(times)) * 1e-9 if times else 0.0,
        "topics": [_topic(recording, topic) for topic in found],
        "attachments": {name: len(data) for name, data in recording.attachments.items()},
        "cameras": [_camera(recording, camera.name, camera.frame_rate_hz) for camera in manifest.cameras],
        "clocks": _clocks(recording),
        "time_source": {"kind": manifest.time_source.value, "sd_ns": manifest.time_source_sd_ns},
        "strikes": [_strike(recording, record) for record in recording.strikes],
        "plan": _plan(recording),
        "states": [
            {
                "time_ns": message.log_time_ns,
                "state": pb.SessionState.State.Name(state.state),
                "strike_id": state.strike_id,
                "text": state.text,
            }
            for message, state in recording.decoded(topics.SESSION_STATE.name, pb.SessionState)
        ],
        "faults": [
            {"time_ns": message.log_time_ns, "text": event.text}
            for message, event in recording.decoded(topics.STRIKER_EVENT.name, pb.StrikerEvent)
            if event.kind == pb.StrikerEvent.FAULT
        ],
    }


def _topic(recording: Recording, topic: TopicInfo) -> dict[str, Any]:
    times = recording.times(topic.name)
    gaps = np.diff(times) * 1e-9
    return {
        "name": topic.name,
        "schema": topic.schema,
        "count": topic.count,
        "first_ns": topic.first_ns,
        "last_ns": topic.last_ns,
        "rate_hz": float(len(gaps) / gaps.sum()) if len(gaps) and gaps.sum() > 0 else None,
        "median_interval_s": float(np.median(gaps)) if len(gaps) else None,
        "longest_gap_s": float(gaps.max()) if len(gaps) else None,
    }


def _camera(recording: Recording, name: str, rate_hz: float) -> dict[str, Any]:
    """Frames by their meta: the camera's own account, whether or not images were kept.

    Where the camera's process ended between two files, the numbers of the frames begin anew, and the time between counts what was lost.
    """
    found = list(recording.decoded(topics.frame_meta(name).name, pb.FrameMeta))
    metas = [meta for _, meta in found]
    mids = np.array([meta.mid_exposure_host_ns for meta in metas], dtype=np.int64)
    steps = np.diff(np.array([meta.sequence for meta in metas], dtype=np.int64))
    intervals = np.diff(mids) * 1e-9
    lost = np.array([meta.frames_lost_before for meta in metas[1:]], dtype=np.int64)
    begins = set(recording.first_times(topics.frame_meta(name).name))
    anew = np.array([message.log_time_ns in begins for message, _ in found[1:]], dtype=bool) & (steps != 1)
    lost[anew] = np.rint(intervals[anew] * rate_hz - 1.0).clip(min=0)
    steps[anew] = 1
    return {
        "name": name,
        "frames": len(metas),
        "lost": int(lost.sum()),
        "images": len(recording.times(topics.raw_image(name).name)),
        "meta_missing": int((steps - 1).clip(min=0).sum()),
        "nominal_rate_hz": rate_hz,
        "rate_hz": float(1.0 / np.median(intervals)) if len(intervals) else None,
        "longest_interval_s": float(intervals.max()) if len(intervals) else None,
        "arrival_delay_s": float(np.median([meta.host_time_ns - meta.mid_exposure_host_ns for meta in metas]) * 1e-9) if metas else None,
        "mapping_sd_ns": int(np.median([meta.mapping_sd_ns for meta in metas])) if metas else None,
    }


def _clocks(recording: Recording) -> list[dict[str, Any]]:
    samples: dict[str, list[pb.ClockSample]] = {}
    for _, sample in recording.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample):
        samples.setdefault(sample.clock, []).append(sample)
    return [{"clock": name, **_clock(found)} for name, found in sorted(samples.items())]


def _clock(samples: list[pb.ClockSample]) -> dict[str, Any]:
    device = np.array([sample.device_time_ns for sample in samples], dtype=np.int64)
    before = np.array([sample.host_before_ns for sample in samples], dtype=np.int64)
    after = np.array([sample.host_after_ns for sample in samples], dtype=np.int64)
    host = before + (after - before) // 2
    span = float(host[-1] - host[0])
    # Between first and last: a figure for people; frame times were mapped when they were recorded.
    drift = ((device[-1] - device[0]) / span - 1.0) * 1e6 if span > 0 else None
    return {
        "samples": len(samples),
        "round_trip_s": float(np.median(after - before) * 1e-9),
        "drift_ppm": float(drift) if drift is not None else None,
    }


def _strike(recording: Recording, record: pb.StrikeRecord) -> dict[str, Any]:
    camera = recording.manifest.cameras[0]
    times = recording.times(topics.raw_image(camera.name).name)
    inside = times[(times >= record.window_start_ns) & (times <= record.window_end_ns)]
    period_ns = 1e9 / camera.frame_rate_hz
    gaps = np.diff(inside)
    missing = np.rint(gaps[gaps > GAP_PERIODS * period_ns] / period_ns - 1.0)
    return {
        "strike_id": record.strike_id,
        "plan_strike_id": record.plan_strike_id,
        "attempt": record.attempt,
        "window_start_ns": record.window_start_ns,
        "window_end_ns": record.window_end_ns,
        "images": len(inside),
        "images_missing": int(missing.sum()),
        "contact_time_ns": record.contact_time_ns or None,
        "tip_speed_m_s": record.tip_speed_m_s,
        "tip_speed_command_m_s": record.tip_speed_command_m_s,
        "verdict": record.verdict_code or None,
        "verdict_text": record.verdict_text,
    }


def _plan(recording: Recording) -> dict[str, Any] | None:
    """Which planned strikes were struck; None where the recording holds no plan that can be read."""
    try:
        done = planned_strikes(recording.plan, (record.plan_strike_id for record in recording.strikes))
    except RecordingError:
        return None
    return {"planned": list(done.planned), "missing": list(done.missing)}


def render_inspection(found: dict[str, Any], console: Console | None = None) -> None:
    """Print what `inspect_recording` found, for people."""
    console = console or Console()
    plan = found["plan"]
    done = None if plan is None else PlannedStrikes(tuple(plan["planned"]), tuple(plan["missing"]))
    whole = "complete" if done is None or not done.missing else "the file is whole"
    state = whole if found["complete"] else "[bold red]cut short[/]: `acquire recover` makes it whole again"
    console.print(f"[bold]{found['path']}[/]  {found['bytes'] / 1e6:.1f} MB, {found['duration_s']:.1f} s, {state}", highlight=False)
    if len(found["files"]) > 1:
        console.print(f"in {len(found['files'])} files: {', '.join(Path(file['path']).name for file in found['files'])}", highlight=False)
    if found["missing_files"]:
        console.print(f"[bold red]not here[/]: {missing_text(found['missing_files'])}", highlight=False)
    console.print(
        f"object {found['object']['name']} ({found['object']['mass_kg'] * 1000:.1f} g), recorded {found['created']} "
        f"by {found['software']}, schema {found['schema_version']}",
        highlight=False,
    )
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    # The name is what a reader copies: it stays whole where the terminal is narrow, the type gives way.
    table.add_column("topic", no_wrap=True)
    table.add_column("type", overflow="fold")
    for heading in ("messages", "per second", "gap [s]"):
        table.add_column(heading, justify="right")
    for topic in found["topics"]:
        kind = topic["schema"].rpartition(".")[2]
        table.add_row(topic["name"], kind, str(topic["count"]), _number(topic["rate_hz"], ".2f"), _number(topic["longest_gap_s"], ".3f"))
    console.print(table)
    for camera in found["cameras"]:
        delay_ms = None if camera["arrival_delay_s"] is None else camera["arrival_delay_s"] * 1e3
        console.print(
            f"camera {camera['name']}: {camera['frames']} frames at {_number(camera['rate_hz'], '.2f')} Hz "
            f"(set {camera['nominal_rate_hz']:g}), {camera['lost']} lost, {camera['images']} images kept, "
            f"arriving {_number(delay_ms, '.1f')} ms after mid-exposure",
            highlight=False,
        )
    for clock in found["clocks"]:
        console.print(
            f"clock {clock['clock']}: {clock['samples']} samples, drift {_number(clock['drift_ppm'], '+.1f')} ppm, "
            f"round trip {clock['round_trip_s'] * 1e6:.0f} us",
            highlight=False,
        )
    if found["strikes"]:
        strikes = Table("strike", "images", "missing", "speed [m/s]", "verdict", "reason", box=SIMPLE_HEAD, pad_edge=False)
        for strike in found["strikes"]:
            strikes.add_row(
                strike["strike_id"],
                str(strike["images"]),
                str(strike["images_missing"]),
                f"{strike['tip_speed_m_s']:.3f}",
                strike["verdict"] or "-",
                strike["verdict_text"],
            )
        console.print(strikes)
    if done is not None:
        remedy = f"`analyze plan OBJECT.toml --given {Path(found['path']).name}` plans what is worth adding"
        console.print(f"[bold red]{done.text()}[/]: {remedy}" if done.missing else done.text(), highlight=False)
    for fault in found["faults"]:
        console.print(f"[bold red]striker fault[/]: {fault['text']}", highlight=False)


def _number(value: float | None, layout: str) -> str:
    return "-" if value is None else format(value, layout)
