"""Observations and verdicts of `analyze watch`.

Events from previews, placement advice, verdicts from the images of a window, and the loop on pipes.
"""

import io
import json
import threading
from dataclasses import dataclass

import numpy as np
import pytest

from analyze.errors import RecordingError
from analyze.types import ImageFrame
from analyze.verbs.watch.follow import watch_recording
from analyze.verbs.watch.observer import Observer
from schemas.strike_plan import StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import JudgeRequest, WatchEvent
from tests.analyze.motion.tipping import SIZE, camera, marker, marker_poses, planned, simulate
from tests.analyze.tracking.rendering import render

ANCHOR = 10**18
FRAME_NS = 8_333_333
TAG = marker()
PLAN = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[planned()])


@dataclass(frozen=True)
class Stored:
    log_time_ns: int
    image: np.ndarray


def observer(plan=PLAN, markers=None):
    decoded = []

    def decode(stored):
        decoded.append(stored.log_time_ns)
        return ImageFrame(stored.log_time_ns, 0, stored.image)

    return Observer(camera(), markers or [TAG], plan, decode), decoded


@pytest.fixture(scope="module")
def tip():
    """A rendered strike at 120 fps, from rest to 25 deg past the balance."""
    tip = simulate(1.3, rest=0.1)
    R, p = marker_poses(tip, TAG)
    rng = np.random.default_rng(3)
    stop = int(np.argmax(tip.theta > tip.phi + np.radians(26)))
    times = [ANCHOR + round(t * 1e9) for t in tip.time[:stop]]
    images = [Stored(t, render(camera(), [(3, SIZE, R[i], p[i])], rng)) for i, t in enumerate(times)]
    return tip, images


def still(image, seconds=0.8):
    """Copies of `image` at 120 Hz over `seconds` [s], as of an object at rest."""
    return [Stored(image.log_time_ns + i * FRAME_NS, image.image) for i in range(int(seconds * 120))]


def request_for(tip, images, **changes):
    fields = {
        "plan_strike_id": "s1",
        "strike_id": "s1.1",
        "window_start_ns": images[0].log_time_ns,
        "window_end_ns": images[-1].log_time_ns,
        "contact_time_ns": ANCHOR + int(tip.contact * 1e9),
    }
    return JudgeRequest(**(fields | changes))


def test_resting_object_is_at_rest_with_few_images_decoded(tip):
    watcher, decoded = observer()
    events = [event for image in still(tip[1][0]) if (event := watcher.add(image)) is not None]
    assert len(decoded) == len(events) <= 0.8 * 12 + 1
    assert not events[0].at_rest
    assert events[-1].at_rest
    assert [m.id for m in events[-1].markers] == [3]
    assert events[-1].saturated_fraction == 0.0
    assert events[-1].placement_error_rad is None


def test_a_moving_object_is_not_at_rest(tip):
    watcher, _ = observer()
    events = [event for image in tip[1] if (event := watcher.add(image)) is not None]
    assert len(events) >= 4
    assert not any(event.at_rest for event in events)


def test_scene_without_markers_comes_to_rest():
    rng = np.random.default_rng(0)
    watcher, _ = observer()
    image = render(camera(), [], rng)
    events = [event for stored in still(Stored(ANCHOR, image)) if (event := watcher.add(stored)) is not None]
    assert events[-1].at_rest
    assert not events[-1].markers


def test_careful_placement_is_within_two_degrees(tip):
    watcher, _ = observer()
    watcher.expect("s1")
    event = watcher.add(tip[1][0])
    assert np.degrees(event.placement_error_rad) < 3.0
    assert event.text == ""


def test_a_wrong_face_is_named(tip):
    other = marker(9)
    away = marker(3)
    turn = np.diag([-1.0, -1.0, 1.0])
    away.T_object_marker[:3, :3] = turn @ away.T_object_marker[:3, :3]
    R, p = marker_poses(simulate(1.0, length=0.02), other)
    image = render(camera(), [(9, SIZE, R[0], p[0])], np.random.default_rng(0))
    back = type(other)(9, SIZE, away.T_object_marker)
    watcher, _ = observer(markers=[marker(3), back])
    watcher.expect("s1")
    event = watcher.add(Stored(ANCHOR, image))
    assert np.degrees(event.placement_error_rad) == pytest.approx(180, abs=4)
    assert event.text.endswith("place tag 3 towards the camera")
    assert event.text.startswith(("turned by 1",))


def test_an_unknown_marker_is_named(tip):
    watcher, _ = observer(markers=[marker(5)])
    watcher.expect("s1")
    assert "marker 3 is not on this object" in watcher.add(tip[1][0]).text


def test_a_strike_is_judged(tip):
    motion, images = tip
    watcher, _ = observer()
    for image in images:
        watcher.add(image)
    verdict = watcher.judge(request_for(motion, images))
    assert verdict.code is Verdict.GOOD
    assert abs(np.degrees(verdict.phi - motion.phi)) < 0.05
    assert verdict.energy_ratio == pytest.approx(1.3, abs=0.01)
    assert verdict.phi_sd < np.radians(0.05)


def test_strike_by_hand_is_found_and_timed_in_a_long_window(tip):
    """A strike by hand after five seconds of rest, without a contact time from the striker."""
    watcher, decoded = observer()
    before = [Stored(tip[1][0].log_time_ns - i * FRAME_NS, tip[1][0].image) for i in range(600, 0, -1)]
    images = [*before, *tip[1]]
    for image in images:
        watcher.add(image)
    looks = len(decoded)
    verdict = watcher.judge(request_for(tip[0], images, contact_time_ns=0))
    assert verdict.code is Verdict.GOOD, verdict.reason
    assert abs(verdict.phi - tip[0].phi) < np.radians(0.1)
    off_ns = verdict.contact_time_ns - (ANCHOR + tip[0].contact * 1e9)
    assert abs(off_ns) < 500_000  # the simulated impact has no duration, to which the stated sd refers
    assert 2_000_000 < verdict.contact_time_sd_ns < 3_000_000
    assert len(decoded) - looks < len(tip[1]) + 100


def test_images_that_end_before_the_tip_give_no_verdict(tip):
    """A camera that is seconds behind its strike.

    All it shows is rest, and that is not what "not moved" means.
    """
    motion, images = tip
    watcher, _ = observer()
    contact_ns = ANCHOR + int(motion.contact * 1e9)
    for image in images:
        if image.log_time_ns < contact_ns:
            watcher.add(image)
    verdict = watcher.judge(request_for(motion, images))
    assert verdict.code is Verdict.UNREADABLE
    assert "before the contact" in verdict.reason


def test_unreadable_strike_gets_a_verdict(tip):
    motion, images = tip
    watcher, _ = observer()
    verdict = watcher.judge(request_for(motion, images))
    assert verdict.code is Verdict.UNREADABLE
    assert "no images" in verdict.reason
    assert "no strike 'x'" in watcher.judge(request_for(motion, images, plan_strike_id="x")).reason


class FastClock:
    """Clock whose time passes only in sleeps."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += 1.0


def test_watch_answers_before_the_file_exists_and_ends_with_its_input(tmp_path):
    request = JudgeRequest(plan_strike_id="s1", strike_id="s1.1", window_end_ns=5)
    out = io.StringIO()
    with pytest.raises(RecordingError, match=r"none.mcap.part: no such recording: check the path"):
        watch_recording(
            tmp_path / "none.mcap.part",
            io.StringIO("no json\n" + request.model_dump_json() + "\n"),
            out,
            FastClock(),
        )
    (line,) = out.getvalue().splitlines()
    assert json.loads(line)["code"] == "unreadable"
    assert not [
        thread for thread in threading.enumerate() if thread.name == "watch-stdin" and thread.is_alive()
    ]


def test_a_tag_of_another_family_is_watched_and_judged_by_its_name(tip):
    name, tag = "25h9-3", marker("25h9-3")
    plan = PLAN.model_copy(update={"strikes": [planned().model_copy(update={"visible_markers": [name]})]})
    R, p = marker_poses(tip[0], TAG)
    rng = np.random.default_rng(3)
    images = [
        Stored(old.log_time_ns, render(camera(), [(name, SIZE, R[i], p[i])], rng))
        for i, old in enumerate(tip[1])
    ]
    watcher, _ = observer(StrikePlan.model_validate_json(plan.model_dump_json()), [tag])
    watcher.expect("s1")
    events = [event for image in images if (event := watcher.add(image)) is not None]
    assert json.loads(events[0].model_dump_json())["markers"][0]["id"] == name
    assert WatchEvent.model_validate_json(events[0].model_dump_json()).markers[0].id == name
    assert events[0].text == ""
    verdict = watcher.judge(request_for(tip[0], images))
    assert verdict.code is Verdict.GOOD
    assert verdict.phi == pytest.approx(tip[0].phi, abs=np.radians(0.1))
    assert observer(plan, [tag])[0].add(tip[1][0]).markers == []
