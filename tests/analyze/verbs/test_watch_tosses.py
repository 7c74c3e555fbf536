"""Verdicts of `analyze watch` on tosses of the virtual rig, from rendered frames and on its pipes."""

from __future__ import annotations

import io
import json
from functools import cache

import pytest

from acquire.virtual.objects import load_object
from acquire.virtual.toss import TossKind
from analyze.errors import RecordingError
from analyze.pipeline.object_markers import placed_markers
from analyze.verbs.watch.follow import watch_recording
from analyze.verbs.watch.tosses import TossJudge
from schemas.object_spec import Shape
from schemas.toss_result import TossVerdict
from schemas.watch_lines import TossJudgement, TossRequest
from tests.analyze.simulated_session import manifest
from tests.tossed import TossedObject, planned_tosses, toss

REQUEST = TossRequest(plan_toss_id="t1", toss_id="t1.2", window_start_ns=1, window_end_ns=2)


@cache
def tossed(kind: TossKind) -> TossedObject:
    thing = load_object("carton", 1)
    return toss(thing, planned_tosses(thing, 1)[0], 3, kind)


def judged(thrown: TossedObject) -> TossJudgement:
    spec = thrown.thing.spec
    judge = TossJudge(manifest(spec), thrown.camera, placed_markers(spec), lambda: None)
    return judge.judge(REQUEST, thrown.frames(first_ns=thrown.release_ns - 60_000_000))


@pytest.mark.slow
def test_a_good_toss_is_judged_by_its_images():
    thrown = tossed(TossKind.GOOD)
    found = judged(thrown)
    assert (found.toss_id, found.code) == ("t1.2", TossVerdict.GOOD)
    assert found.flight_s == pytest.approx(1e-9 * (thrown.landing_ns - thrown.release_ns), abs=0.03)


@pytest.mark.slow
def test_a_short_toss_has_its_reason():
    found = judged(tossed(TossKind.SHORT))
    assert found.code in {TossVerdict.SHORT, TossVerdict.NOT_FREE}
    assert "throw" in found.reason


def test_a_shape_that_is_not_recorded_gives_a_reason():
    thrown = tossed(TossKind.SHORT)
    spec = thrown.thing.spec.model_copy(update={"shape": Shape(file="x.stl", unit="mm")})
    found = TossJudge(manifest(spec), thrown.camera, [], lambda: None).judge(REQUEST, [])
    assert found.code is TossVerdict.UNREADABLE
    assert "x.stl" in found.reason


def test_a_toss_without_images_is_unreadable_on_the_pipes(tmp_path):
    out = io.StringIO()
    with pytest.raises(RecordingError):
        watch_recording(tmp_path / "none.mcap", io.StringIO(REQUEST.model_dump_json() + "\n"), out)
    found = TossJudgement.model_validate(json.loads(out.getvalue().splitlines()[0]))
    assert (found.toss_id, found.code) == ("t1.2", TossVerdict.UNREADABLE)
    assert "no images yet" in found.reason
