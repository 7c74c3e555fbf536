"""Observations and verdicts of `analyze watch` on an object without tags."""

from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
import pytest

from analyze.pipeline.sections import MeshSections
from analyze.types import ImageFrame
from analyze.verbs.watch.observer import Observer
from schemas.strike_plan import StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import JudgeRequest
from tests.analyze.motion.printed_box import Tip, box, camera, tip


@dataclass(frozen=True)
class Stored:
    log_time_ns: int
    image: np.ndarray


def observer(plan):
    spec, _ = box()
    return Observer(
        camera(),
        [],
        plan,
        lambda stored: ImageFrame(stored.log_time_ns, 0, stored.image),
        MeshSections(spec, lambda: None),
    )


@pytest.mark.parametrize(("blank", "verdict"), [(False, Verdict.GOOD), (True, Verdict.UNREADABLE)])
def test_an_untagged_object_is_judged_by_its_print(blank, verdict):
    made = tip(0, 0, blank=blank)
    plan = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[made.planned])
    watcher = observer(plan)
    watcher.expect(made.planned.id)
    events = [
        event
        for frame in made.frames
        if (event := watcher.add(Stored(frame.time_ns, frame.image))) is not None
    ]
    resting = [event for event in events if event.time_ns < made.contact_ns]
    assert resting[-1].at_rest
    assert not resting[-1].markers
    judged = watcher.judge(
        JudgeRequest(
            plan_strike_id=made.planned.id,
            strike_id="s1.1",
            window_start_ns=made.frames[0].time_ns,
            window_end_ns=made.frames[-1].time_ns,
            contact_time_ns=made.contact_ns,
        )
    )
    assert judged.code is verdict
    assert ("too little print" in resting[-1].text) is blank
    if blank:
        assert "too little print" in judged.reason


def judged_good(watcher: Observer, made: Tip) -> None:
    """Let the observer see a strike and judge it."""
    for frame in made.frames:
        watcher.keep(Stored(frame.time_ns, frame.image))
    request = JudgeRequest(
        plan_strike_id=made.planned.id,
        strike_id="s3.1",
        window_start_ns=made.frames[0].time_ns,
        window_end_ns=made.frames[-1].time_ns,
        contact_time_ns=made.contact_ns,
    )
    assert watcher.judge(request).code is Verdict.GOOD


def told_at_rest(watcher: Observer, frames: list[ImageFrame], after_ns: int) -> str:
    """Instruction to the user after the observer has seen images of the object at rest."""
    events = [
        event
        for frame in frames
        if (event := watcher.add(Stored(frame.time_ns + after_ns, frame.image))) is not None
    ]
    assert events[-1].at_rest
    return events[-1].text


@pytest.mark.parametrize(
    ("seed", "text"), [(0, ""), (1, "the print on the +y side is not that of strike s3.1")]
)
def test_another_side_than_planned_is_told_before_the_strike(seed, text):
    first, second = tip(2, 0), tip(3, seed)
    plan = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[first.planned, second.planned])
    watcher = observer(plan)
    judged_good(watcher, first)
    watcher.expect(second.planned.id)
    told = told_at_rest(watcher, second.frames[:36], first.frames[-1].time_ns)
    assert told.startswith(text)
    assert bool(told) is bool(text)


def test_a_box_that_stands_in_place_of_lying_is_told_before_the_strike():
    first, second = tip(2, 0), tip(3, 0)
    lying = second.planned.model_copy(
        update={
            "id": "lying",
            "R_world_object": [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]],
            "p_world_object": [-0.065, 0.0, 0.0375],
        }
    )
    plan = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[first.planned, lying])
    watcher = observer(plan)
    judged_good(watcher, first)
    watcher.expect("lying")
    told = told_at_rest(watcher, second.frames[:36], first.frames[-1].time_ns)
    assert told == "the outline is not that on the card: put the object down as drawn there"


def test_a_turned_box_is_looked_at_again():
    """Five images a second, and a box that fills a small part of them."""
    first, wrong, right = tip(2, 0), tip(3, 1), tip(3, 0)
    plan = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[first.planned, right.planned])
    watcher = observer(plan)
    judged_good(watcher, first)
    watcher.expect(right.planned.id)
    told: list[str] = []
    for number, frame in enumerate([*wrong.frames[:6], *right.frames[:6]], start=1):
        event = watcher.add(Stored(first.frames[-1].time_ns + 180_000_000 * number, frame.image))
        assert event is not None
        told.append(event.text if event.at_rest else "moves")
    assert told[5].startswith("the print")
    assert "moves" in told[6:]
    assert not told[-1]


def test_a_shape_that_is_recorded_later_counts_from_then_on():
    first, wrong = tip(2, 0), tip(3, 1)
    plan = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[first.planned, wrong.planned])
    with patch.object(MeshSections, "surface", return_value=None):
        watcher = observer(plan)
        watcher.expect(first.planned.id)
        assert not told_at_rest(watcher, first.frames[:36], 0)
    judged_good(watcher, first)
    watcher.expect(wrong.planned.id)
    assert told_at_rest(watcher, wrong.frames[:36], first.frames[-1].time_ns)
