"""Lines and documents from outside give an answer or a named error, never another exception."""

from __future__ import annotations

import contextlib
import io
import json
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analyze.errors import RecordingError
from analyze.reading.decode_message import decode_message
from analyze.reading.indexed_file import RecordedMessage
from analyze.verbs.watch.follow import watch_recording
from analyze.verbs.watch.observer import Observer
from schemas.document import DocumentError, validate
from schemas.object_spec import MarkerSpec, ObjectSpec, parse_object_spec
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import StrikePlan, parse_strike_plan
from schemas.watch_lines import JudgeRequest, StrikeVerdict
from tests.analyze.motion.tipping import camera, marker, planned

QUICK = settings(max_examples=80, derandomize=True, deadline=None)
PLAN = StrikePlan(object_name="box", object_sha256="0" * 64, strikes=[planned()])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
TIMES = st.integers(-(1 << 70), 1 << 70) | st.integers(0, 1 << 62) | JSON
REQUESTS = st.fixed_dictionaries(
    {"plan_strike_id": st.just("s1") | JSON},
    optional={
        "kind": st.sampled_from(["judge", "expect"]) | JSON,
        "strike_id": st.text(max_size=4) | JSON,
        "window_start_ns": TIMES,
        "window_end_ns": TIMES,
        "contact_time_ns": TIMES,
    },
)
LINES = (
    REQUESTS.map(json.dumps)
    | JSON.map(json.dumps)
    | st.text(max_size=20).filter(lambda text: not text.splitlines()[1:])
    | st.just("[" * 50_000)
)


class FastClock:
    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@QUICK
@given(lines=st.lists(LINES, max_size=4))
def test_watch_answers_every_request_and_ignores_other_lines(lines: list[str]) -> None:
    expected = 0
    text = "".join(line + "\n" for line in lines)
    for line in text.splitlines():
        with contextlib.suppress(DocumentError, ValueError, RecursionError):
            expected += validate(JudgeRequest, json.loads(line), "line").kind == "judge"
    out = io.StringIO()
    with pytest.raises(RecordingError, match="no such recording"):
        watch_recording(Path("/nowhere/none.mcap.part"), io.StringIO(text), out, FastClock())
    assert len(out.getvalue().splitlines()) == expected


@QUICK
@given(request=REQUESTS)
def test_a_verdict_is_given_on_any_request(request: dict) -> None:
    try:
        asked = validate(JudgeRequest, request, "line")
    except DocumentError:
        return
    observer = Observer(camera(), [marker()], PLAN, lambda image: image)
    observer.expect(asked.plan_strike_id)
    assert isinstance(observer.judge(asked), StrikeVerdict)


@QUICK
@given(text=st.text(max_size=60) | JSON.map(json.dumps) | st.just("[" * 50_000) | st.just("9" * 5000))
def test_any_text_is_a_plan_or_a_named_error(text: str) -> None:
    with pytest.raises(DocumentError, match=r"^plan\.json: "):
        parse_strike_plan(text, "plan.json")


SPEC = """name = "box"
mass_kg = 0.05
mass_sd_kg = 0.001
[shape]
box = { size_m = [0.1, 0.1, 0.1] }
[[marker]]
id = 1
size_m = 0.03
T_object_marker = [[0, 0, 1, 0.05], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
"""


@QUICK
@given(
    at=st.integers(0, len(SPEC) - 1),
    size=st.integers(0, 12),
    more=st.text(max_size=6) | st.sampled_from(["nan", "-1", "[[", "1e999", "=", "0x7"]),
)
def test_edited_object_file_is_read_or_a_named_error(at: int, size: int, more: str) -> None:
    with contextlib.suppress(DocumentError):
        parse_object_spec(SPEC[:at] + more + SPEC[at + size :], "object.toml")


@QUICK
@given(key=st.sampled_from(sorted(set(tomllib.loads(SPEC)) - {"shape", "marker"})), value=JSON)
def test_object_with_any_value_is_read_or_a_named_error(key: str, value: object) -> None:
    with contextlib.suppress(DocumentError):
        validate(ObjectSpec, tomllib.loads(SPEC) | {key: value}, "object.toml")


@QUICK
@given(
    value=JSON
    | st.lists(st.lists(st.floats(allow_nan=False), min_size=4, max_size=4), min_size=4, max_size=4)
)
def test_pose_with_any_value_is_read_or_a_named_error(value: object) -> None:
    with contextlib.suppress(DocumentError):
        validate(MarkerSpec, {"id": 1, "size_m": 0.03, "T_object_marker": value}, "object.toml")


def test_a_frame_number_beyond_what_a_camera_counts_is_damage():
    data = memoryview(pb.FrameMeta(sequence=(1 << 64) - 77).SerializeToString())
    message = RecordedMessage("/camera/main/meta", 5, 0, data)
    with pytest.raises(RecordingError, match="at 5 is damaged: its sequence is 18446744073709551539"):
        decode_message(Path("a.mcap"), message, pb.FrameMeta)
