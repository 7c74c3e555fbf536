"""Expected corners of a thrown body against an independent integration, and their derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.flight.flight_model import (
    FIRST_TAG,
    LINE_TIME,
    TAG_TERMS,
    FlightModel,
    TossStart,
    _integrals,
)
from analyze.flight.free_stretch import moved_in_time
from analyze.flight.toss_fit import fit_tosses
from analyze.least_squares.levenberg_marquardt import Ending
from tests.analyze.flight.thrown_box import CAMERA, first_numbers, known, lopsided_box, tossed, true_start

BOX = lopsided_box()


def test_corners_are_those_of_an_independent_integration() -> None:
    """Without air, where both obey the same law: 0.4 s at 2.5 turns a second."""
    box = replace(BOX, drag=0.0)
    views, tags = tossed(box, np.random.default_rng(1), noise_px=0.0)
    body, prior = known(box)
    model = FlightModel(body, CAMERA, tags, [(views, true_start(box, np.random.default_rng(1)))])
    x = first_numbers(box, prior, tags, model)
    x[11:13] = 0.0
    expected, _ = model(x)
    assert np.abs(expected - views.corners.ravel()).max() < 2e-3


def test_derivatives_are_those_of_differences() -> None:
    """All but the change of the air's load with the motion and with c, which the fit does without."""
    views, tags = tossed(BOX, np.random.default_rng(2))
    body, prior = known(BOX)
    model = FlightModel(body, CAMERA, tags, [(views, true_start(BOX, np.random.default_rng(2)))])
    x = first_numbers(BOX, prior, tags, model)
    rng = np.random.default_rng(3)
    x[FIRST_TAG : model.shared] += rng.normal(size=model.shared - FIRST_TAG) * np.tile(
        [*[2e-4] * 3, *[4e-3] * 3], len(tags.names)
    )
    x[model.shared : model.shared + 3] = 0.01, -0.02, 0.03
    _, by = model(x)
    for number in [*range(FIRST_TAG + TAG_TERMS), *range(model.shared, model.count)]:
        step = np.zeros(model.count)
        step[number] = 1e-6
        numeric = (model(x + step)[0] - model(x - step)[0]) / 2e-6
        size = np.abs(numeric).max()
        assert np.abs(by[:, number] - numeric).max() < (0.15 if number < 3 else 0.05) * size, number


def test_the_air_slows_a_body_as_the_integral_of_its_force_says() -> None:
    time = np.sort(np.random.default_rng(5).uniform(0.0, 0.4, 40))
    once, twice = _integrals(time.tobytes())
    force = np.column_stack([np.cos(3 * time), time**2, np.ones_like(time)])
    from_start = time - time[0]
    velocity = (np.sin(3 * time) - np.sin(3 * time[0])) / 3
    assert (once @ force)[:, 0] == pytest.approx(velocity, abs=1e-5)
    assert (once @ force)[:, 2] == pytest.approx(from_start, abs=1e-12)
    assert (twice @ force)[:, 2] == pytest.approx(0.5 * from_start**2, abs=1e-12)


def test_moved_starts_continue_the_flight() -> None:
    views, tags = tossed(BOX, np.random.default_rng(4), noise_px=0.02)
    body, prior = known(BOX)
    fit = fit_tosses(body, prior, CAMERA, tags, [(views, true_start(BOX, np.random.default_rng(4)))])
    path = fit.model.paths(fit.x)[0]
    later = TossStart.at(path, 10)
    part = views.part(10, len(views))
    model = FlightModel(body, CAMERA, tags, [(part, later)])
    predicted, _ = model(np.concatenate([fit.x[: model.shared], later.numbers]))
    assert predicted == pytest.approx(part.corners.ravel(), abs=0.3)


def test_rows_read_later_show_the_flight_later() -> None:
    """All corners 200 rows below the middle, at 7 us a row: as a flight that began 1.4 ms later."""
    views, tags = tossed(BOX, np.random.default_rng(5), noise_px=0.02)
    body, prior = known(BOX)
    fit = fit_tosses(body, prior, CAMERA, tags, [(views, true_start(BOX, np.random.default_rng(5)))])
    low = replace(views, rows=np.full(views.rows.shape, 200.0))
    start, later = fit.starts()[0], moved_in_time(fit, 1.4e-3)
    model, moved = (FlightModel(body, CAMERA, tags, [each]) for each in ((low, start), (views, later)))
    x = np.concatenate([fit.x[: model.shared], start.numbers])
    still, _ = model(x)
    x[LINE_TIME] = 7e-6
    expected, _ = moved(np.concatenate([fit.x[: moved.shared], later.numbers]))
    # The start is moved without the air, which slows the body down.
    early = np.repeat(views.seconds[views.frame] < 0.05, 8)
    assert np.abs(expected - still)[early].max() > 3.0
    assert model(x)[0][early] == pytest.approx(expected[early], abs=0.02)


def test_a_fit_that_leads_to_no_body_knows_nothing() -> None:
    """As a hand's motion that was taken for a flight did: derivatives of 1e73, and a singular matrix."""
    views, tags = tossed(BOX, np.random.default_rng(4))
    body, prior = known(BOX)
    start = true_start(BOX, np.random.default_rng(4))
    shared = prior.mean_and_sd(tags)[0]
    shared[3:8] = 8.0, 43.0, -68.0, -0.7, 24.0
    fit = fit_tosses(body, prior, CAMERA, tags, [(views, start)], shared, Ending(max_steps=1))
    assert np.all(np.diag(fit.covariance) > 1e6)
