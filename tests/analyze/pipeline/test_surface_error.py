"""A shape whose error the object file does not state is not exact: it is assumed, estimated and reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.geometry.surface_error import ASSUMED_FILE_SD, ASSUMED_SIZE_SD, surface_sd
from analyze.pipeline.evidence import Evidence
from analyze.planning.corrected import corrected_plan
from analyze.result.answer import Answer, answer_evidence
from schemas.object_spec import LengthUnit, Shape, object_sha256
from schemas.result import WarningCode
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")


def with_stated(evidence: Evidence, sd: float | None) -> Evidence:
    shape = evidence.spec.shape.model_copy(update={"surface_sd_m": sd})
    return replace(evidence, spec=evidence.spec.model_copy(update={"shape": shape}))


def evidence_with_edges(evidence: Evidence, sd: float | None) -> Evidence:
    """Evidence whose object file has another error of the shape, and whose plan was made with it."""
    stated = with_stated(evidence, sd)
    return replace(stated, plan=corrected_plan(evidence.plan, evidence.spec, stated.spec, evidence.model))


@pytest.fixture(scope="module")
def exact() -> Evidence:
    return session(carton(), np.random.default_rng(3))


@pytest.fixture(scope="module")
def unstated(exact) -> Answer:
    return answer_evidence(evidence_with_edges(exact, None))


def test_error_that_is_not_stated_is_assumed_and_reported(unstated):
    found = unstated.estimate.surface_error
    assert found is not None
    assert found.assumed == ASSUMED_SIZE_SD
    assert 0 < found.estimated < 2 * ASSUMED_SIZE_SD
    (text,) = [each.text for each in unstated.result.warnings if each.code is WarningCode.SHAPE_ERROR_ASSUMED]
    assert "surface_sd_m" in text


def test_answer_is_that_with_the_estimated_error_stated_and_wider_than_that_of_an_exact_shape(
    exact, unstated
):
    error = unstated.estimate.surface_error
    assert error is not None
    edges = evidence_with_edges(exact, error.estimated)
    stated, sure = answer_evidence(edges), answer_evidence(exact)
    assert np.allclose(stated.estimate.com.position, unstated.estimate.com.position, atol=1e-9)
    assert np.linalg.eigvalsh(unstated.estimate.com.covariance - sure.estimate.com.covariance).min() > 0
    for each in (stated, sure):
        assert each.estimate.surface_error is None
        assert all(one.code is not WarningCode.SHAPE_ERROR_ASSUMED for one in each.result.warnings)


def test_only_an_error_that_is_left_out_is_assumed(exact):
    file = Shape(file="b.stl", unit=LengthUnit.MILLIMETRE)
    assert surface_sd(file, None) == ASSUMED_FILE_SD
    assert surface_sd(file.model_copy(update={"surface_sd_m": 0.0}), None) == 0.0
    assert surface_sd(file, 5e-4) == 5e-4, "a noisy cloud is that of a poor scanner"
    assert surface_sd(exact.spec.shape.model_copy(update={"surface_sd_m": None}), None) == ASSUMED_SIZE_SD
    # Identities of objects are those of before, when an error that was left out counted as 0.
    assert object_sha256(with_stated(exact, None).spec, None) == object_sha256(exact.spec, None)
