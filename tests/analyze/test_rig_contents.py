"""Whole sessions of an object of the virtual rig, with and without contents that move, and their answers."""

from __future__ import annotations

import numpy as np
import pytest

from acquire.virtual.objects import load_object
from analyze.pipeline.estimate import estimate_evidence
from analyze.result.document import result_document
from tests.benchmarks.contents.on_rig import OBJECTS, rig_evidence
from tests.benchmarks.honesty.verdicts import statuses

SEED = 4


@pytest.mark.slow
@pytest.mark.parametrize("contents", ["liquid:0.2:0.5", "lump:0.2:0.2"])
def test_contents_that_move_are_named_and_nothing_is_trusted(contents):
    result = result_document(estimate_evidence(rig_evidence(contents, SEED)))
    assert result.verdict is not None
    assert result.verdict[0].startswith("doubt everything: not rigid")
    assert statuses(result)["c"] != "trust"


@pytest.mark.slow
def test_the_same_object_without_contents_has_its_centre_within_the_intervals():
    thing = load_object(OBJECTS[SEED % len(OBJECTS)], SEED)
    result = result_document(estimate_evidence(rig_evidence("nothing", SEED)))
    ends = np.array(result.centre_of_mass.interval95)
    assert statuses(result)["c"] == "trust"
    assert np.all((thing.body.com_object >= ends[:, 0]) & (thing.body.com_object <= ends[:, 1]))
