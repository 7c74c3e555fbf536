"""k and phi of strikes whose edge hops or creeps, against MuJoCo: stated errors are those that are made."""

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.motion.creep_error import creep_size
from analyze.motion.edge_offset import displacement_per_offset, fit_creeping
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from schemas.strike_result import Verdict
from tests.analyze.motion.hopping import Prism, filmed, struck

NOISE = math.radians(0.012)


def drawn(rng):
    """Random section of a bottle or box, 180 to 220 mm high and 48 to 65 mm wide."""
    width, height = rng.uniform(0.048, 0.065), rng.uniform(0.18, 0.22)
    corners = np.array([[0, 0], [-width, 0], [-width, height], [0, height]])
    com = np.array([-0.5 * width * rng.uniform(0.85, 1.15), 0.46 * height * rng.uniform(0.85, 1.15)])
    rho = float(rng.choice([3e-4, 1e-3, 2e-3]))
    inertia = (width**2 + height**2) / 12 * rng.uniform(0.9, 1.2)
    return Prism(corners, rho, com, inertia, rng.uniform(0.4, 0.8))


@pytest.fixture(scope="module")
def errors():
    """Errors of phi and k over their sd, relative sd of k, and size of the creep [m].

    There are 7 strikes per contact.
    """
    found = {}
    for contact, hop in (("hard", 0.0), ("springy", 0.06), ("soft", 0.0), ("soft", 0.06)):
        rows = []
        for seed in range(7):
            rng = np.random.default_rng((seed, 5))
            strike = struck(
                drawn(rng), rng.uniform(1.03, 1.3), contact, hop * rng.uniform(0.8, 1.2), phase=rng.uniform()
            )
            motion, task = filmed(strike, rng, NOISE, offset_sd=3e-4)
            result = analyse_motion(motion, task, MotionSettings())
            if result.verdict is not Verdict.GOOD:
                continue
            fit, true = result.fit, strike.prism.about(strike.prism.corners[0])
            sd = np.sqrt(np.diag(fit.covariance))
            size = creep_size(motion, fit.window)
            rows.append([(fit.phi - true.phi) / sd[0], (fit.k - true.k) / sd[1], sd[1] / true.k, size])
        found[contact, hop > 0] = np.array(rows)
    return found


def test_k_errs_by_its_stated_sd_on_hopping_and_creeping_edges(errors):
    # Before the creep was an error that frames share: 2.1 and 1.6 on soft contacts, 62 % inside.
    for rows in errors.values():
        assert len(rows) >= 5
    together = np.concatenate(list(errors.values()))
    rms = np.sqrt(np.mean(together[:, :2] ** 2, axis=0))
    assert np.all((rms > 0.5) & (rms < 1.2))
    assert np.mean(np.abs(together[:, 1]) < 1.96) > 0.9


def test_a_hard_edge_is_hardly_less_certain_for_it(errors):
    # 0.18 % where no creep is thought of.
    assert np.median(errors["hard", False][:, 2]) < 0.0023
    assert np.median(errors["hard", False][:, 3]) < 3e-5 < np.median(errors["soft", False][:, 3])


def test_an_offset_is_not_determined_by_a_creeping_edge():
    """The sinking of a soft edge is as smooth in theta as the displacement of a point beside the edge."""
    rng = np.random.default_rng(1)
    theta = np.linspace(0.05, 0.8, 60)
    rows = displacement_per_offset(theta)[None, :, 1]
    sd = np.full(60, 2e-5)
    still = rng.normal(0, 2e-5, 60)
    sinking = still + 1.2e-4 * np.sin(2.5 * theta + 0.4)
    held = fit_creeping(theta, rows, still[None], sd, np.full(2, 5e-4))
    crept = fit_creeping(theta, rows, sinking[None], sd, np.full(2, 5e-4))
    for found in (held, crept):
        away = found.parameters @ np.linalg.solve(found.covariance, found.parameters)
        assert away < 12.0  # 95 % are below 6
    assert np.all(np.diag(crept.covariance) > 1.5 * np.diag(held.covariance))
    assert crept.size > 1.5 * held.size


def test_a_misstated_radius_does_not_pass_for_sliding():
    """Edges of 0.3 and 2 mm are stated as 1.15 mm: no fit takes the error for sliding.

    Two seemed to slide by 0.7 mm before, which put k off by 3.7 sd.
    """
    scores = []
    for seed in range(2, 6):
        rng = np.random.default_rng((seed, 9))
        prism = replace(drawn(rng), rho=(3e-4, 2e-3)[seed % 2])
        strike = struck(prism, rng.uniform(1.03, 1.2), "hard", 0.0, phase=rng.uniform())
        motion, task = filmed(strike, rng, 0.5 * NOISE, offset_sd=1e-4)
        error = 1.15e-3 - prism.rho
        theta, angle, pivot = strike.course.theta, motion.angle, task.planned.pivot
        along = error * (np.sin(theta) - np.cos(theta) + 1.0 - theta)
        motion = replace(
            motion,
            angle=replace(angle, slip=angle.slip + along),
            lift=motion.lift + error * (np.sin(theta) + np.cos(theta) - 1.0),
        )
        pivot = pivot.model_copy(update={"radius_m": 1.15e-3})
        task = replace(task, planned=task.planned.model_copy(update={"pivot": pivot}))
        fit = analyse_motion(motion, task, MotionSettings()).fit
        true = strike.prism.about(strike.prism.corners[0])
        scores.append((fit.k - true.k) / np.sqrt(fit.covariance[1, 1]))
        assert "slid" not in fit.note
    assert np.sqrt(np.mean(np.square(scores))) < 1.3
