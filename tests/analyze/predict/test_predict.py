"""Left-out strikes simulated in MuJoCo: the estimated body moves as the strike did."""

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.export.body import ExportBody, Inertial
from analyze.export.contact import MjcfContact
from analyze.geometry.object_model import load_object_model
from analyze.motion.pendulum_motion import trajectory
from analyze.pipeline.solved import EstimateOptions
from analyze.predict.assets import ESTIMATED, UNIFORM, shell_inertial
from analyze.predict.document import predictions_document, render_predictions
from analyze.predict.predict import fitted_start, predict_left_out
from analyze.predict.scene import Start, Surroundings, simulated_angle, touching_centres
from analyze.predict.tosses import START_S
from schemas.terminal import Terminal
from tests.analyze.estimation.bodies import GRAVITY, SIX_AXES, planned_strike, tip
from tests.analyze.pipeline.test_tosses import evidence as with_tosses
from tests.analyze.simulated_session import carton, object_spec, session, tipping

RATE = 120


@pytest.fixture(scope="module")
def evidence():
    return session(carton(), np.random.default_rng(1), repeats=1)


def test_mujoco_moves_the_true_body_as_the_pendulum_does():
    body = carton()
    strike = planned_strike(body, *SIX_AXES[0], 0)
    phi, k = tip(body, strike)
    truth, omega = tipping(phi, k, energy=1.2)
    model = load_object_model(object_spec(body), None, "box")
    moved = np.array(truth[30:])
    time = np.arange(1, len(moved) + 1) / RATE
    asset = ExportBody("box", model, Inertial(body.mass, body.com, body.inertia), {})
    around = Surroundings(GRAVITY, (0.0, 0.0), MjcfContact(0.9, None))
    start = Start(0.0, omega)
    found = simulated_angle(asset, model, strike, start, around, np.concatenate([[0.0], time]))[1:]
    assert np.abs(found - moved).max() < math.radians(1.0)


def test_corners_that_touch_lie_one_radius_inside():
    body = carton()
    strike = planned_strike(body, *SIX_AXES[0], 0)
    model = load_object_model(object_spec(body), None, "box")
    centres = touching_centres(model, strike)
    assert len(centres) >= 4
    np.testing.assert_allclose(model.depth(centres), strike.pivot.radius_m, atol=1e-6)


def test_a_shell_has_the_moments_of_its_plates():
    body = carton()
    model = load_object_model(object_spec(body), None, "box")
    a, b, c = body.size
    shell = shell_inertial(model, 1.0)
    np.testing.assert_allclose(shell.com, np.mean(model.bounds, axis=0), atol=1e-9)
    area = 2 * (a * b + b * c + c * a)
    # Two plates on each axis: own extent / 12, and half the size away from the middle.
    xx = 2 * (a * b * a**2 / 12 + c * a * a**2 / 12 + b * c * a**2 / 4) / area
    yy = 2 * (a * b * b**2 / 12 + b * c * b**2 / 12 + c * a * b**2 / 4) / area
    assert shell.inertia[2, 2] == pytest.approx(xx + yy, rel=1e-9)


def test_the_start_is_that_of_the_motion():
    time = np.arange(12) / RATE
    theta, _, _ = trajectory(time, 0.3, 60.0, 0.02, 1.9)
    found = fitted_start(time, theta, 0.3, 60.0)
    assert (found.theta, found.omega) == (pytest.approx(0.02, abs=1e-6), pytest.approx(1.9, abs=1e-5))


def test_a_left_out_strike_is_predicted_better_than_by_a_uniform_body(evidence, capsys):
    wanted = evidence.motions[0].strike_id
    seen: list[str] = []
    found = predict_left_out(evidence, EstimateOptions(), [wanted], lambda text, *_: seen.append(text))
    (strike,) = found.strikes
    assert strike.strike_id == wanted
    assert seen == [f"predicting {wanted}"]
    assert strike.error(ESTIMATED).rms < math.radians(5)
    assert strike.error(ESTIMATED).rms < 0.2 * strike.error(UNIFORM).rms
    document = predictions_document(found)
    assert document.median is not None
    assert document.median.estimated.rms_rad == pytest.approx(strike.error(ESTIMATED).rms, rel=1e-6)
    assert document.strikes[0].friction is None
    render_predictions(document, Terminal(width=100))
    out = capsys.readouterr().out
    assert "without knowing it" in out
    assert wanted in out


def test_an_unknown_strike_is_named_with_those_that_can_be_predicted(evidence):
    with pytest.raises(EstimationError, match=r"s99\.1 cannot be predicted.*choose one of these"):
        predict_left_out(evidence, EstimateOptions(), ["s99.1"])


def test_strikes_without_which_the_centre_of_mass_is_open_are_skipped(evidence):
    few = replace(evidence, motions=evidence.motions[:3])
    with pytest.raises(EstimationError, match="nothing can be predicted"):
        predict_left_out(few, EstimateOptions())


def test_a_left_out_toss_is_predicted_better_than_by_a_uniform_body(capsys):
    whole = with_tosses(tosses=1)
    wanted = whole.tosses[0].toss_id
    found = predict_left_out(whole, EstimateOptions(), [wanted])
    (toss,) = found.tosses
    assert not found.strikes
    assert toss.time[0] >= START_S
    assert toss.error(ESTIMATED).rms < math.radians(3)
    assert toss.error(ESTIMATED).rms < 0.5 * toss.error(UNIFORM).rms
    document = predictions_document(found)
    assert document.median is None
    assert document.toss_median is not None
    assert document.tosses[0].measured_sd_rad < math.radians(1)
    render_predictions(document, Terminal(width=100))
    assert "attitude is off by" in capsys.readouterr().out
