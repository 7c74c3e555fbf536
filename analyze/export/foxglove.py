"""Layout for the viewer Foxglove: camera, log, states and curves of a recording, by the topics that it has.

The format is version 1 of the layouts that Foxglove's own package (`foxglove.layouts`) writes.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from analyze.errors import ExportError
from analyze.reading.recording import open_recording
from schemas import topics
from schemas.output_file import write_text

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence
    from pathlib import Path

Entry = dict[str, object]


def write_layout(files: Sequence[Path], output: Path) -> None:
    """Write a layout that fits one recording; it needs no estimate, and fits others of the same rig too.

    Args:
        files: the recording.
        output: the file (.json).

    Raises:
        ExportError: several files are given, or one that is not a recording; or `output` is not .json.
        RecordingError: the recording cannot be read.
        OutputError: the file cannot be written.
    """
    if len(files) > 1 or files[0].suffix.lower() == ".json":
        raise ExportError(f"{files[0]}: a layout is made for one recording (.mcap): name that one alone")
    if output.suffix.lower() != ".json":
        raise ExportError(f"{output}: Foxglove's layouts are .json files: name it {output.stem}.json")
    with open_recording(files[0]) as recording:
        layout = foxglove_layout(recording.camera, {topic.name for topic in recording.topics()})
    write_text(output, json.dumps(layout, indent=2) + "\n")


def foxglove_layout(camera: str, recorded: Collection[str]) -> Entry:
    """Layout as JSON values: camera and log on the left; states, strikes and curves on the right.

    Args:
        camera: name of the camera.
        recorded: names of the recording's topics; panels of others are left out.
    """
    image, calibration = topics.raw_image(camera).name, topics.camera_calibration(camera).name
    mode = {"imageTopic": image} | ({"calibrationTopic": calibration} if calibration in recorded else {})
    left = [(3, _panel("Image", "Camera", {"imageMode": mode}))]
    if topics.LOG.name in recorded:
        left.append((1, _panel("Log", "Log", {"topicToRender": topics.LOG.name})))
    right = _right_panels(camera, recorded)
    columns = [(3, _split("column", left))] + ([(2, _split("column", right))] if right else [])
    return {"version": 1, "content": _split("row", columns)}


def _right_panels(camera: str, recorded: Collection[str]) -> list[tuple[int, Entry]]:
    sample, meta = topics.STRIKER_SAMPLE.name, topics.frame_meta(camera).name
    states = [(topics.SESSION_STATE.name, "state", "session"), (topics.STRIKER_EVENT.name, "kind", "striker")]
    arm = [
        (sample, "position_rad", "arm angle [rad], contact at 0"),
        (sample, "velocity_rad_s", "arm speed [rad/s]"),
    ]
    frames = [(meta, "frames_lost_before", "frames lost"), (meta, "exposure_us", "exposure [us]")]
    strike = topics.SESSION_STRIKE.name
    panels = [
        (2, _curves("StateTransitions", "Session and striker", recorded, states)),
        (3, _curves("Plot", "Striker", recorded, arm)),
        (2, _curves("Plot", "Camera", recorded, frames)),
        (3, _panel("RawMessages", "Strike", {"topicPath": strike}) if strike in recorded else None),
    ]
    return [(weight, panel) for weight, panel in panels if panel is not None]


def _curves(
    kind: str, title: str, recorded: Collection[str], fields: Sequence[tuple[str, str, str]]
) -> Entry | None:
    """Panel with curves on the common time axis; None if the recording has none of their topics.

    Args:
        kind: type of the panel, "Plot" or "StateTransitions".
        title: title of the panel.
        recorded: names of the recording's topics.
        fields: topic, field of its messages and label of each curve.
    """
    paths = [
        {"value": f"{topic}.{field}", "label": label} for topic, field, label in fields if topic in recorded
    ]
    return _panel(kind, title, {"paths": paths, "isSynced": True}) if paths else None


def _panel(kind: str, title: str, config: Entry) -> Entry:
    return {"type": "panel", "panelType": kind, "config": config, "title": title, "version": 1}


def _split(direction: str, items: Sequence[tuple[int, Entry]]) -> Entry:
    content = [{"proportion": weight, "content": item} for weight, item in items]
    return {"type": "split", "direction": direction, "items": content}
