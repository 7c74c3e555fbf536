from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.agreement import centre_difference, estimator_disagreements, sigmas_of_any
from analyze.estimation.paper import PaperCentre
from analyze.estimation.priors import ComPrior
from analyze.result.answer import answer_evidence
from schemas.result import WarningCode
from schemas.strike_result import Verdict
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")
BODY = carton()


@pytest.fixture(scope="module")
def evidence():
    return session(BODY, np.random.default_rng(5))


def changed(evidence, number, change):
    motions = list(evidence.motions)
    motions[number] = change(motions[number])
    return replace(evidence, motions=tuple(motions))


def shifted(motion, degrees):
    (other,) = motion.alternatives
    return replace(motion, alternatives=(replace(other, phi=motion.fit.phi + np.radians(degrees)),))


def test_estimator_with_another_phi_is_reported_with_its_difference(evidence):
    # Its sd is 0.02 rad, 1.15 degrees.
    found = answer_evidence(changed(evidence, 4, lambda motion: shifted(motion, 4.6)))
    name = evidence.motions[4].strike_id
    (warning,) = [each for each in found.result.warnings if each.code is WarningCode.ESTIMATORS_DISAGREE]
    assert warning.text.startswith(
        f"strike {name}: φ by sign_change differs from pivot_fit's by +4.60°, 4.0 combined sd"
    )
    assert any(each.startswith(f"doubt strike {name}: φ by sign_change") for each in found.result.verdict)


def test_differences_within_the_sd_are_not_reported(evidence):
    assert not estimator_disagreements([shifted(motion, 3.0) for motion in evidence.motions])


def test_limit_of_a_difference_holds_for_the_whole_session(evidence):
    """With 3 sd for each strike, one session in 40 of nine strikes had a false alarm."""
    rng, alarms = np.random.default_rng(1), 0
    alone = evidence.motions[0]
    sd = np.degrees(np.sqrt(alone.fit.covariance[0, 0] + alone.alternatives[0].covariance[0, 0]))
    for _ in range(1000):
        off = sd * rng.normal(size=9)
        alarms += bool(estimator_disagreements([shifted(alone, degrees) for degrees in off]))
    assert alarms <= 8
    assert sigmas_of_any(1) == pytest.approx(3.0)
    assert sigmas_of_any(9) == pytest.approx(3.62, abs=0.01)


def test_k_is_compared_unless_assumptions_are_violated(evidence):
    motion = evidence.motions[0]
    other = replace(motion.fit, estimator="moment_balance", k=1.1 * motion.fit.k)
    (apart,) = estimator_disagreements([replace(motion, alternatives=(other,))])
    assert apart.k_off == pytest.approx(0.1)
    assert not estimator_disagreements(
        [replace(motion, alternatives=(replace(other, violated=("it slid",)),))]
    )


def test_sign_change_is_not_compared_if_the_strike_rocked_back(evidence):
    motion = shifted(evidence.motions[0], 20.0)
    assert estimator_disagreements([motion])
    assert not estimator_disagreements([replace(motion, verdict=Verdict.ROCKED_BACK)])


def test_papers_centre_is_compared_within_its_angle_errors(evidence):
    estimate = answer_evidence(evidence)
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    for off, agree in ((1e-3, True), (0.015, False)):
        paper = PaperCentre(
            estimate.estimate.com.position + np.array([off, 0.0, 0.0]), np.radians(1.85), 1e-7
        )
        planes = [replace(plane, sd_phi=0.01) for plane in estimate.estimate.planes]
        assert centre_difference(paper, planes, estimate.estimate.com, prior).agree is agree
