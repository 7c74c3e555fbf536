"""Fixtures of one simulated session: as one recording, as two parts, and the answer of each."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import merge_evidence
from analyze.result.answer import Answer, answer_evidence
from tests.analyze.pipeline.merged_sessions import (
    BODY,
    part,
)
from tests.analyze.simulated_session import session


@pytest.fixture(scope="module")
def whole() -> Evidence:
    return session(BODY, np.random.default_rng(3))


@pytest.fixture(scope="module")
def halves(whole) -> tuple[Evidence, Evidence]:
    return part(whole, 0, 6, "a"), part(whole, 6, 12, "bb")


@pytest.fixture(scope="module")
def joint(halves) -> Answer:
    return answer_evidence(merge_evidence(halves))


@pytest.fixture(scope="module")
def one(whole) -> Answer:
    return answer_evidence(whole)
