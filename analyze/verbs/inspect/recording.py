"""Contents and health of a recording: topics, rates, gaps, frames lost, clocks, session, strikes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analyze.errors import RecordingCut, RecordingError
from analyze.progress import Progress
from analyze.reading.file_series import missing_files_text
from analyze.reading.mcap_contents import read_contents
from analyze.reading.planned_strikes import PlannedStrikes, planned_strikes
from analyze.reading.recording import Recording, open_partial, open_recording
from analyze.reading.recording_file import existing_file, is_growing
from analyze.reading.topic_info import TopicInfo
from analyze.verbs.inspect.contents import inspect_contents, out_of_order_lines, time_span, time_table
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME
from schemas.wording import counted

MIN_GAP_PERIODS = 1.5
"""interval between two images of a window, in frame periods, above which a frame is missing"""


def inspect_recording(path: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Inspect a file: contents and health of any MCAP file, and the session if it is a recording.

    A file that is cut short, or still being written, is inspected as far as it goes. NAME.mcap may still be
    NAME.mcap.part.

    Args:
        path: the file.
        progress: called with (text, bytes read, bytes in all).

    Returns:
        JSON values. `kind` is "percuss" for a recording of this project, which has a session, else "mcap".

    Raises:
        RecordingError: the file is missing, not MCAP, or a damaged recording.
    """
    found = existing_file(path)
    try:
        return _inspect(found, progress)
    except (RecordingError, OSError):
        if found.exists():
            raise
        # Its writer finished it meanwhile, and gave it its final name.
        return _inspect(existing_file(path), progress)


def _inspect(path: Path, progress: Progress | None) -> dict[str, Any]:
    """Contents, health and, if it has one, session of the existing file `path`, as JSON values.

    Raises:
        RecordingError: the file is not MCAP, is a damaged recording, or is still empty and growing.
        OSError: the file has vanished.
    """
    before = path.stat() if path.exists() else None
    if before is not None and before.st_size == 0 and is_growing(path, before):
        raise RecordingCut(f"{path}: is still empty, and being written: try again in a few seconds")
    contents = read_contents(path, progress)
    growing = before is not None and not contents.finished and is_growing(path, before)
    general = inspect_contents(contents, growing=growing)
    if MANIFEST_NAME not in contents.metadata:
        return general | {"health": general["health"] + out_of_order_lines(general["topics"])}
    try:
        with open_recording(path) as recording:
            return general | _describe(recording, general, complete=True)
    except RecordingCut:
        with open_partial(path) as recording:
            return general | _describe(recording, general, complete=False)


def _describe(recording: Recording, general: dict[str, Any], *, complete: bool) -> dict[str, Any]:
    """Session and health of a recording as JSON values: files, ids, object, topics, cameras, problems.

    Args:
        recording: the open recording.
        general: result of `inspect_contents` for the file that was named.
        complete: False if the file is cut short.
    """
    manifest = recording.manifest
    encodings = {topic["name"]: topic for topic in general["topics"]}
    found = [encodings.get(topic.name, {}) | _topic(recording, topic) for topic in recording.topics()]
    session = {
        "kind": "percuss",
        "bytes": sum(part.path.stat().st_size for part in recording.parts),
        "files": [
            {"path": str(part.path), "bytes": part.path.stat().st_size, "content_id": part.content_id}
            for part in recording.parts
        ],
        "missing_files": list(recording.missing_parts),
        "complete": complete,
        "damaged_chunks": recording.damaged_chunks,
        "recovery_losses": list(recording.recovery_losses),
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
        "rebased": [entry.model_dump(mode="json") for entry in manifest.rebased or []],
        "compacted": [each.model_dump(mode="json") for each in recording.compactions],
        "messages": sum(topic["count"] for topic in found),
        **time_span(found),
        "topics": found,
        "attachments": {name: len(data) for name, data in recording.attachments.items()},
        "cameras": [_camera(recording, camera.name, camera.frame_rate_hz) for camera in manifest.cameras],
        "clocks": _clocks(recording),
        "time_source": {"kind": manifest.time_source.value, "sd_ns": manifest.time_source_sd_ns},
        "strikes": [_strike(recording, record) for record in recording.strikes],
        "tosses": [_toss(recording, record) for record in recording.tosses],
        "plan": _plan(recording),
        "planned_tosses": _planned_tosses(recording),
        "states": [
            {
                "time_ns": message.log_time_ns,
                "state": pb.SessionState.State.Name(state.state),
                "strike_id": state.strike_id or state.toss_id,
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
    return session | {"health": general["health"] + _health(session, growing=general["growing"])}


def _topic(recording: Recording, topic: TopicInfo) -> dict[str, Any]:
    return {"name": topic.name, "schema": topic.schema, **time_table(recording.times(topic.name))}


def _health(session: dict[str, Any], *, growing: bool) -> list[str]:
    """Problems of a session as lines of text, each with a remedy if there is one; may be empty.

    Args:
        session: what `analyze inspect` reports on the session, as JSON values; has no entry `health` yet.
        growing: True if the file is still being written: strikes to come are not missing.
    """
    path = session["files"][0]["path"]
    found: list[str] = []
    cut = [Path(file["path"]).name for file in session["files"] if file["content_id"] is None]
    if len(session["files"]) > 1 and cut:
        found.append(f"cut short: {', '.join(cut)}: restore each with `acquire recover`")
    if session["missing_files"]:
        found.append(f"not here: {missing_files_text(session['missing_files'])}")
    if session["damaged_chunks"]:
        found.append(f"{counted(session['damaged_chunks'], 'damaged chunk', 'is')} left out")
    found += [f"rebuilt by `acquire recover`: {line}" for line in session["recovery_losses"]]
    for camera in session["cameras"]:
        if camera["lost"]:
            found.append(
                f"camera {camera['name']}: {camera['lost']} of "
                f"{counted(camera['frames'] + camera['lost'], 'frame')} were lost"
            )
        if camera["meta_missing"]:
            found.append(
                f"camera {camera['name']}: {counted(camera['meta_missing'], 'frame')} between its first "
                "and last have no metadata"
            )
    missing = {
        each[key]: each["images_missing"]
        for kind, key in (("strikes", "strike_id"), ("tosses", "toss_id"))
        for each in session[kind]
        if each["images_missing"]
    }
    if missing:
        found.append("images missing: " + ", ".join(f"{count} of {name}" for name, count in missing.items()))
    found += [f"striker fault: {fault['text']}" for fault in session["faults"]]
    plan = session["plan"]
    if plan is not None and plan["missing"] and not growing:
        done = PlannedStrikes(tuple(plan["planned"]), tuple(plan["missing"]))
        found.append(
            f"{done.text()}: `analyze plan OBJECT.toml --given {Path(path).name}` plans the strikes worth "
            "adding"
        )
    tossed = session["planned_tosses"]
    if tossed is not None and tossed["missing"] and not growing:
        found.append(
            f"{counted(len(tossed['missing']), 'planned toss', 'was')} not made: "
            f"{', '.join(tossed['missing'])}"
        )
    return found


def _camera(recording: Recording, name: str, rate_hz: float) -> dict[str, Any]:
    """Frame counts and rates of a camera as JSON values, from its frame metadata.

    Metadata are recorded for every frame, whether or not its image was kept. `lost` counts frames that never
    arrived, `meta_missing` frame numbers without metadata. Where the camera's process restarted between two
    files of the recording, its frame numbers begin anew, and the elapsed time gives the number of frames
    lost.

    Args:
        recording: the open recording.
        name: name of the camera.
        rate_hz: frame rate that the camera was set to [Hz].
    """
    found = list(recording.timed_frame_meta(name))
    metas = [meta for _, meta in found]
    mids = np.array([meta.mid_exposure_host_ns for meta in metas], dtype=np.int64)
    steps = np.diff(np.array([meta.sequence for meta in metas], dtype=np.int64))
    intervals = np.diff(mids) * 1e-9
    lost = np.array([meta.frames_lost_before for meta in metas[1:]], dtype=np.int64)
    begins = set(recording.first_times(topics.frame_meta(name).name))
    anew = np.array([log_time_ns in begins for log_time_ns, _ in found[1:]], dtype=bool) & (steps != 1)
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
        "arrival_delay_s": float(
            np.median([meta.host_time_ns - meta.mid_exposure_host_ns for meta in metas]) * 1e-9
        )
        if metas
        else None,
        "mapping_sd_ns": int(np.median([meta.mapping_sd_ns for meta in metas])) if metas else None,
    }


def _clocks(recording: Recording) -> list[dict[str, Any]]:
    samples: dict[str, list[pb.ClockSample]] = {}
    for _, sample in recording.decoded(topics.CLOCK_SAMPLE.name, pb.ClockSample):
        samples.setdefault(sample.clock, []).append(sample)
    return [{"clock": name, **_clock(found)} for name, found in sorted(samples.items())]


def _clock(samples: list[pb.ClockSample]) -> dict[str, Any]:
    """JSON values of a device clock's samples: number, median round trip [s], drift [ppm].

    A sample is one reading of the device's clock between two readings of the host's; the time between those
    two is its round trip. The drift is that of the device's clock against the host's; None if all samples are
    of one time.
    """
    device = np.array([sample.device_time_ns for sample in samples], dtype=np.int64)
    before = np.array([sample.host_before_ns for sample in samples], dtype=np.int64)
    after = np.array([sample.host_after_ns for sample in samples], dtype=np.int64)
    host = before + (after - before) // 2
    span = float(host[-1] - host[0])
    # From the first and last sample, only to be shown: frame times were mapped when they were recorded.
    drift = ((device[-1] - device[0]) / span - 1.0) * 1e6 if span > 0 else None
    return {
        "samples": len(samples),
        "round_trip_s": float(np.median(after - before) * 1e-9),
        "drift_ppm": float(drift) if drift is not None else None,
    }


def _strike(recording: Recording, record: pb.StrikeRecord) -> dict[str, Any]:
    """JSON values of one strike: ids, attempt, time window, contact, speeds, verdict and image counts.

    `contact_time_ns` and `verdict` are None if they were not recorded.
    """
    return {
        "strike_id": record.strike_id,
        "plan_strike_id": record.plan_strike_id,
        "attempt": record.attempt,
        **_window(recording, record),
        "contact_time_ns": record.contact_time_ns or None,
        "tip_speed_m_s": record.tip_speed_m_s,
        "tip_speed_command_m_s": record.tip_speed_command_m_s,
        "verdict": record.verdict_code or None,
        "verdict_text": record.verdict_text,
    }


def _toss(recording: Recording, record: pb.TossRecord) -> dict[str, Any]:
    """JSON values of one toss: ids, attempt, time window, image counts and verdict (None if not recorded)."""
    return {
        "toss_id": record.toss_id,
        "plan_toss_id": record.plan_toss_id,
        "attempt": record.attempt,
        **_window(recording, record),
        "verdict": record.verdict_code or None,
        "verdict_text": record.verdict_text,
    }


def _window(recording: Recording, record: pb.StrikeRecord | pb.TossRecord) -> dict[str, int]:
    """Time window of a strike or toss [ns], and the numbers of images kept (`images`) and missing in it."""
    camera = recording.manifest.cameras[0]
    times = recording.times(topics.raw_image(camera.name).name)
    inside = times[(times >= record.window_start_ns) & (times <= record.window_end_ns)]
    period_ns = 1e9 / camera.frame_rate_hz
    gaps = np.diff(inside)
    missing = np.rint(gaps[gaps > MIN_GAP_PERIODS * period_ns] / period_ns - 1.0)
    return {
        "window_start_ns": record.window_start_ns,
        "window_end_ns": record.window_end_ns,
        "images": len(inside),
        "images_missing": int(missing.sum()),
    }


def _plan(recording: Recording) -> dict[str, Any] | None:
    """Ids of the plan's strikes (`planned`) and of those not struck (`missing`).

    None if the recording contains no readable plan.
    """
    try:
        done = planned_strikes(recording.plan, (record.plan_strike_id for record in recording.strikes))
    except RecordingError:
        return None
    return {"planned": list(done.planned), "missing": list(done.missing)}


def _planned_tosses(recording: Recording) -> dict[str, Any] | None:
    """Ids of the plan's tosses (`planned`) and of those that nobody made (`missing`).

    None if the recording contains no readable plan, or one without tosses.
    """
    try:
        planned = [toss.id for toss in recording.plan.tosses]
    except RecordingError:
        return None
    if not planned:
        return None
    made = {record.plan_toss_id for record in recording.tosses}
    return {"planned": planned, "missing": [name for name in planned if name not in made]}
