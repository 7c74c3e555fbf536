"""Page of a toss in a replay: flight, angular velocity, residuals; without a flight the verdict alone."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr

from analyze.flight.toss import TossMotion, analyse_toss
from analyze.pipeline.tosses import thrown_body
from analyze.replay.body import SceneInputs
from analyze.replay.layout import StrikePage, TossPage, layout
from analyze.replay.timelines import Timelines
from analyze.replay.toss_curves import toss_curves
from analyze.replay.toss_scene import flight_span, send_toss
from analyze.replay.words import toss_text
from schemas.toss_result import TossVerdict
from tests.analyze.flight.thrown_box import CAMERA, ThrownBox, tossed, tracks
from tests.analyze.replay.rrd_contents import RrdContents
from tests.analyze.simulated_session import carton, session

BODY = carton()
BOX = ThrownBox(BODY.size, BODY.mass, BODY.com, BODY.inertia, tag_size=0.03)
NOISE_PX = 0.05


@pytest.fixture(scope="module")
def flown() -> TossMotion:
    """A toss of the carton, analysed."""
    plain = session(BODY, np.random.default_rng(5))
    body, prior = thrown_body(plain.spec, plain.model, plain.recordings[0].manifest)
    views, tags = tossed(BOX, np.random.default_rng(7), noise_px=NOISE_PX)
    return analyse_toss(("t1.1", "t1"), tracks(views, tags), CAMERA, tags, body, prior)


@pytest.fixture(scope="module")
def scene():
    """Object, manifest and scene of the tossed carton."""
    plain = session(BODY, np.random.default_rng(5))
    inputs = SceneInputs(plain.model, plain.plan, CAMERA, tuple(BOX.markers()))
    return SimpleNamespace(
        struck=SimpleNamespace(spec=plain.spec, model=plain.model),
        manifest=plain.recordings[0].manifest,
        body=inputs,
    )


def send(toss: TossMotion, scene, path) -> tuple[TossPage, RrdContents]:
    stream = rr.RecordingStream("percuss", recording_id="r1")
    stream.save(path)
    page = send_toss(Timelines(stream, 0), toss, scene.body, scene.struck, scene.manifest)
    stream.disconnect()
    return page, RrdContents(path)


def test_curves_are_those_of_the_fitted_flight(flown, scene):
    assert flown.verdict is TossVerdict.GOOD
    assert flown.flight is not None
    thrown, _ = thrown_body(scene.struck.spec, scene.struck.model, scene.manifest)
    curves = toss_curves(flown.flight, thrown, CAMERA)
    assert np.linalg.norm(curves.rate, axis=1).mean() == pytest.approx(
        2 * np.pi * flown.turns_per_s, rel=0.01
    )
    # Single tags show the same turning, with the noise of their corners.
    between = 0.5 * (curves.rate[:-1] + curves.rate[1:])
    assert np.median(np.abs(curves.seen_rate - between)) < 0.5
    assert np.median(curves.residual_px) == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.3)
    assert curves.corners_px.shape == (len(curves.view_ns), 4, 2)
    height, time = curves.p_world_com[:, 2], 1e-9 * (curves.time_ns - curves.time_ns[0])
    assert 2 * np.polyfit(time, height, 2)[0] == pytest.approx(-9.81, abs=0.2)


def test_the_page_has_track_rates_residuals_and_pose(flown, scene, tmp_path):
    page, shown = send(flown, scene, tmp_path / "toss.rrd")
    frames = len(flown.flight.views)
    assert (page.toss_id, page.verdict) == ("t1.1", "good")
    for axis in "xyz":
        assert shown.rows(f"/toss/t1.1/rate/{axis}") == frames
        assert shown.rows(f"/toss/t1.1/rate/{axis}_seen") == frames - 1
    assert shown.rows("/toss/t1.1/camera/tags") == frames
    assert shown.rows("/toss/t1.1/camera/ghost") == frames + 1
    assert shown.rows("/toss/t1.1/world/object") == frames
    assert shown.chunks["/toss/t1.1/camera/track"]
    residuals = sum(shown.rows(name) for name in shown.chunks if name.startswith("/toss/t1.1/residual/"))
    assert residuals == len(flown.flight.views.frame)
    assert "t1\\.1: good" in shown.text("/toss/t1.1/text") or "t1.1: good" in shown.text("/toss/t1.1/text")
    assert flight_span(flown) == (
        int(flown.flight.views.time_ns[0]),
        int(flown.flight.views.time_ns[-1]),
    )


def test_a_toss_without_a_flight_has_its_verdict_only(scene, tmp_path):
    lost = TossMotion("t2.1", "t2", TossVerdict.MARKER_LOST, "no marker was seen")
    page, shown = send(lost, scene, tmp_path / "lost.rrd")
    assert page == TossPage("t2.1", "marker lost")
    assert flight_span(lost) is None
    assert "no marker was seen" in shown.text("/toss/t2.1/text")
    assert not shown.chunks.get("/toss/t2.1/rate/x")


def test_a_bad_toss_states_its_flight_beside_the_reason(flown):
    text = toss_text(TossMotion("t1.1", "t1", TossVerdict.SLOW, "too slow", flown.flight, 1.2, 0.5))
    assert "1.2 turns a second" in text
    assert "29° off the nearest principal axis" in text


def test_pages_of_tosses_follow_those_of_strikes():
    tabs = layout([StrikePage("s1.1")], "t1.1", None, [TossPage("t1.1", "good")]).root_container
    assert [each.name for each in tabs.contents] == ["Answer", "s1.1", "t1.1 good", "Session"]
    assert tabs.active_tab == 2
