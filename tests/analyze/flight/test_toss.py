"""Free flight of a toss: found, judged, and what several determine together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.flight.estimate import estimate_flights
from analyze.flight.free_stretch import free_stretch
from analyze.flight.toss import TossMotion, analyse_toss
from analyze.flight.views import TagSet, TossViews
from analyze.geometry.second_moments import log_cholesky, scale_free
from analyze.types import MarkerTrack
from schemas.toss_result import TossVerdict
from tests.analyze.flight.thrown_box import CAMERA, held_before, known, lopsided_box, tossed, tracks

BOX = lopsided_box()
BODY, PRIOR = known(BOX)


def analysed(views: TossViews, tags: TagSet, name: str = "t1") -> TossMotion:
    return analyse_toss((name, name), tracks(views, tags), CAMERA, tags, BODY, PRIOR)


def test_the_flight_begins_where_the_hand_lets_go() -> None:
    views, tags = tossed(BOX, np.random.default_rng(5), noise_px=0.05)
    held = held_before(views, frames=20)
    found = analysed(held, tags)
    assert found.verdict is TossVerdict.GOOD, found.reason
    assert found.flight is not None
    late = (found.flight.views.time_ns[0] - held.time_ns[20]) * 1e-9 * 120
    assert -0.1 < late < 4.1, "frames cut off at the start"
    assert found.flight.residual_px < 0.06


@pytest.mark.parametrize(
    ("verdict", "given"),
    [
        (TossVerdict.SLOW, {"turns_per_s": 0.9}),
        (TossVerdict.SHORT, {"flight_s": 0.25}),
        (TossVerdict.PRINCIPAL_AXIS, {"axis": "principal"}),
    ],
)
def test_bad_tosses_are_refused(verdict: TossVerdict, given: dict) -> None:
    if given.get("axis") == "principal":
        given = {"axis": np.linalg.eigh(BOX.inertia)[1][:, 1]}
    found = analysed(*tossed(BOX, np.random.default_rng(6), **given))
    assert found.verdict is verdict, found.reason


def test_a_still_object_does_not_fly() -> None:
    views, tags = tossed(BOX, np.random.default_rng(7))
    still = held_before(views, frames=40).part(0, 40)
    assert free_stretch(still, tags, CAMERA, PRIOR) is None
    assert analysed(still, tags).verdict is TossVerdict.NOT_FREE
    assert analysed(still.part(0, 0), tags).verdict is TossVerdict.MARKER_LOST


def test_a_body_whose_contents_move_is_a_misfit() -> None:
    """Corners that swing by half a pixel about the flight, as of a body that something moves in."""
    views, tags = tossed(BOX, np.random.default_rng(8), noise_px=0.02)
    swing = 0.5 * np.sin(2 * np.pi * 9.0 * views.seconds)[views.frame, None, None]
    found = analysed(replace(views, corners=views.corners + swing), tags)
    assert found.verdict in (TossVerdict.MISFIT, TossVerdict.SHORT), found.reason


def test_three_tosses_determine_centre_and_ratios() -> None:
    """Tags as far off as stated: c to 0.15 mm, the tensor's numbers to 0.005, within their intervals."""
    rng = np.random.default_rng(9)
    moved = rng.normal(size=(6, 6)) * np.repeat([1e-4, np.radians(0.1)], 3)
    found = []
    for number in range(3):
        views, tags = tossed(BOX, rng, moved=moved)
        tags = replace(tags, place_sd=np.full(6, 1e-4), turn_sd=np.full(6, np.radians(0.1)))
        found.append(analysed(views, tags, f"t{number}"))
    fit = estimate_flights(found, BODY, PRIOR, CAMERA, tags)
    truth = np.append(BOX.com, scale_free(log_cholesky(BOX.inertia / BOX.mass))[0])
    off = fit.estimate.mean - truth
    assert np.linalg.norm(off[:3]) < 1.5e-4
    assert np.abs(off / np.sqrt(np.diag(fit.estimate.covariance))).max() < 3.5
    assert np.abs(off[3:]).max() < 5e-3
    assert fit.estimate.tosses == ("t0", "t1", "t2")
    assert fit.drag == pytest.approx([1.1, 1.1], abs=0.3)


def test_a_misplaced_tag_is_named_and_does_little_harm() -> None:
    """One of six tags 3 mm off, with a stated sd of 0.3 mm."""
    rng, moved = np.random.default_rng(11), np.zeros((6, 6))
    moved[2, 0] = 3e-3
    found = []
    for number in range(2):
        views, tags = tossed(BOX, rng, noise_px=0.03, moved=moved)
        found.append(analysed(views, tags, f"t{number}"))
    fit = estimate_flights(found, BODY, PRIOR, CAMERA, tags)
    off = fit.estimate.mean[:3] - BOX.com
    assert fit.misplaced == {2: pytest.approx(3e-3, abs=1.5e-3)}
    assert np.abs(off / np.sqrt(np.diag(fit.estimate.covariance)[:3])).max() < 2.0


def test_tracks_without_a_placed_tag_show_nothing() -> None:
    views, tags = tossed(BOX, np.random.default_rng(10))
    others = [
        MarkerTrack(**{**vars(each), "marker_id": 99})  # type: ignore[arg-type]
        for each in tracks(views, tags)[:1]
    ]
    found = analyse_toss(("t1", "t1"), others, CAMERA, tags, BODY, PRIOR)
    assert found.verdict is TossVerdict.MARKER_LOST
