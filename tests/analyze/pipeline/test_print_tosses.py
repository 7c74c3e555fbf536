"""Tosses of an untagged object: followed by its print, or refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.flight.estimate import estimate_flights
from analyze.flight.toss import TossMotion
from analyze.flight.tracked_attitude import tracked_attitudes
from analyze.geometry.rotations import angle_between
from analyze.geometry.second_moments import log_cholesky, scale_free
from analyze.pipeline.toss_marks import TossMarks
from analyze.pipeline.tosses import thrown_body, toss_in_frames
from analyze.predict.tosses import MAX_ATTITUDE_SD
from schemas.strike_result import FollowedBy
from schemas.toss_result import TossVerdict
from tests.analyze.simulated_session import manifest
from tests.benchmarks.tosses import prepared
from tests.printed import PrintedObject

OBJECT = PrintedObject("carton", 2)


def read(marks: TossMarks) -> TossMotion:
    """The first planned toss, as read."""
    thrown = OBJECT.tossed()
    frames = thrown.frames(first_ns=thrown.release_ns - 40_000_000, last_ns=thrown.landing_ns + 20_000_000)
    spec, (model, _) = OBJECT.thing.spec, prepared(OBJECT.name)
    return toss_in_frames(
        ("t1.1", "t1"), frames, OBJECT.camera, marks, *thrown_body(spec, model, manifest(spec))
    )


@pytest.fixture(scope="module")
def found() -> TossMotion:
    """A good toss, followed by the views of all strikes."""
    return read(TossMarks([], OBJECT.views))


def test_one_toss_by_print_determines_centre_and_ratios(found: TossMotion) -> None:
    """Views as far off as the poses at rest are: c to 1 mm, all numbers within 3.5 of their sd."""
    assert found.verdict is TossVerdict.GOOD, found.reason
    assert found.followed_by is FollowedBy.PRINT
    assert found.flight is not None
    spec, (model, _), body = OBJECT.thing.spec, prepared(OBJECT.name), OBJECT.thing.body
    thrown, prior = thrown_body(spec, model, manifest(spec))
    fit = estimate_flights([found], thrown, prior, OBJECT.camera, found.flight.tags)
    true = np.array(body.inertia_com) / body.mass_kg
    off = fit.estimate.mean - np.append(np.array(body.com_object), scale_free(log_cholesky(true))[0])
    sd = np.sqrt(np.diag(fit.estimate.covariance))
    assert np.linalg.norm(off[:3]) < 1e-3
    assert np.abs(off / sd).max() < 3.5


def test_a_left_out_toss_shows_its_attitude_in_single_frames(found: TossMotion) -> None:
    """As `analyze predict` compares it: each frame by itself, beside the fit of the whole flight."""
    assert found.flight is not None
    flight = found.flight
    track = tracked_attitudes(flight.views, flight.path, flight.tags_at([]), OBJECT.camera, MAX_ATTITUDE_SD)
    assert len(track) > 0.8 * len(flight.path)
    at = np.searchsorted(flight.path.time, track.time - 1e-6)
    off = angle_between(track.R_world_object, flight.path.R_world_object[at])
    assert np.degrees(np.sqrt(np.mean(off**2))) < 0.5


def test_without_a_strike_the_print_is_not_known() -> None:
    found = read(TossMarks([]))
    assert found.verdict is TossVerdict.UNREADABLE
    assert "strike it in the same session, or glue tags on" in found.reason
