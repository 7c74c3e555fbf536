"""Foxglove's layout: built again with Foxglove's own package, and its paths found in the recording."""

from __future__ import annotations

import json

import foxglove.layouts as fl
import pytest
from click.testing import CliRunner

from analyze.cli import main
from analyze.export.foxglove import foxglove_layout
from analyze.reading.recording import open_recording
from schemas import topics
from tests.places import FIRST_SAMPLE

PANELS = {
    "Image": lambda config: fl.ImageConfig(
        image_mode=fl.ImageModeConfig(
            image_topic=config["imageMode"]["imageTopic"],
            calibration_topic=config["imageMode"].get("calibrationTopic"),
        )
    ),
    "Log": lambda config: fl.LogConfig(topic_to_render=config["topicToRender"]),
    "RawMessages": lambda config: fl.RawMessagesConfig(topic_path=config["topicPath"]),
    "StateTransitions": lambda config: fl.StateTransitionsConfig(
        is_synced=config["isSynced"], paths=[fl.StateTransitionsSeries(**each) for each in config["paths"]]
    ),
    "Plot": lambda config: fl.PlotConfig(
        is_synced=config["isSynced"], paths=[fl.PlotSeries(**each) for each in config["paths"]]
    ),
}


def rebuilt(content: dict) -> object:
    """Layout `content`, as read from JSON, built again of Foxglove's own classes."""
    if content["type"] == "split":
        items = [
            fl.SplitItem(proportion=each["proportion"], content=rebuilt(each["content"]))
            for each in content["items"]
        ]
        return fl.SplitContainer(direction=content["direction"], items=items)
    kind = content["panelType"]
    return getattr(fl, f"{kind}Panel")(title=content["title"], config=PANELS[kind](content["config"]))


def texts(value: object) -> list[str]:
    """All texts in JSON values that begin like a topic."""
    if isinstance(value, dict | list):
        return [
            text for each in (value.values() if isinstance(value, dict) else value) for text in texts(each)
        ]
    return [value] if isinstance(value, str) and value.startswith("/") else []


@pytest.fixture(scope="module")
def layout(tmp_path_factory):
    path = tmp_path_factory.mktemp("layout") / "layout.json"
    done = CliRunner().invoke(
        main, ["export", str(FIRST_SAMPLE), "--format", "foxglove", "-o", str(path)], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    return json.loads(path.read_text())


def test_foxgloves_own_package_writes_the_same_layout(layout):
    assert json.loads(fl.Layout(content=rebuilt(layout["content"])).to_json()) == layout


def test_every_path_is_in_the_recording_and_panels_fit_its_topics(layout):
    with open_recording(FIRST_SAMPLE) as recording:
        known = {topic.name for topic in recording.topics()}
    messages = {
        each.name: each.message.DESCRIPTOR
        for each in (
            topics.SESSION_STATE,
            topics.STRIKER_EVENT,
            topics.STRIKER_SAMPLE,
            topics.frame_meta("main"),
        )
    }
    found = texts(layout)
    assert len(found) >= 7
    for path in found:
        topic, _, field = path.partition(".")
        assert topic in known
        assert not field or field in messages[topic].fields_by_name, path


def test_video_from_a_phone_has_a_layout_without_striker_and_session():
    shown = texts(foxglove_layout("main", {"/camera/main/image", "/session/strike"}))
    assert shown == ["/camera/main/image", "/session/strike"]
    assert texts(foxglove_layout("main", {"/camera/main/image"})) == ["/camera/main/image"]


@pytest.mark.parametrize(
    ("files", "output", "message"),
    [
        ([FIRST_SAMPLE, FIRST_SAMPLE], "a.json", "a layout is made for one recording"),
        ([FIRST_SAMPLE], "a.yaml", "Foxglove's layouts are .json files: name it a.json"),
    ],
)
def test_wrong_files_give_a_one_line_error(files, output, message, tmp_path):
    done = CliRunner().invoke(
        main, ["export", *map(str, files), "--format", "foxglove", "-o", str(tmp_path / output)]
    )
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert message in line
