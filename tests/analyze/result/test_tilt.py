"""Table tilt in results: measured, given or assumed; and older results without it."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest

from analyze.pipeline.equiplanes import systematic_errors
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import levelling_indices
from analyze.report.summary import render_summary
from analyze.result.answer import answer_evidence
from schemas.document import canonical_json
from schemas.result import Result, WarningCode
from schemas.session_manifest import LevelReading
from schemas.terminal import Terminal
from tests.analyze.simulated_session import carton, session

pytestmark = pytest.mark.usefixtures("coarse_regions")
BODY = carton()
RISE = np.radians(0.3)


def on_table(evidence: Evidence, **manifest: object) -> Evidence:
    (head,) = evidence.recordings
    return replace(evidence, recordings=(replace(head, manifest=head.manifest.model_copy(update=manifest)),))


def with_turned(evidence: Evidence, which: int = 0) -> Evidence:
    """Evidence with a further strike on one edge, turned by 180 degrees, on a table tilted by RISE."""
    strike = evidence.plan.strikes[which].model_copy(update={"id": "turned", "heading_rad": np.pi})
    plan = evidence.plan.model_copy(update={"strikes": [*evidence.plan.strikes, strike]})
    motion = evidence.motions[which]
    fit = replace(motion.fit, phi=motion.fit.phi - 2 * RISE)
    return replace(
        evidence,
        plan=plan,
        motions=(*evidence.motions, replace(motion, strike_id="turned.1", plan_strike_id="turned", fit=fit)),
    )


@pytest.fixture(scope="module")
def rising() -> Evidence:
    """Twelve strikes on a table tilted by RISE and stated level to 0.2 degrees."""
    return on_table(session(BODY, np.random.default_rng(3), tilt=RISE), gravity_tilt_sd_rad=np.radians(0.2))


def warnings_of(estimate):
    return {warning.code: warning.text for warning in estimate.result.warnings}


def test_assumed_level_gives_a_warning_with_the_remedy(rising):
    few = replace(rising, motions=tuple(rising.motions[i] for i in (0, 2, 8, 10)))
    found = answer_evidence(few)
    assert "analyze plan --gravity" in warnings_of(found)[WarningCode.GRAVITY_ASSUMED]
    (tilt,) = found.result.table_tilt
    assert (tilt.towards_x.source, tilt.towards_x.observed, tilt.towards_y.source) == (
        "prior",
        False,
        "prior",
    )
    console = Terminal(record=True, width=140, file=io.StringIO())
    render_summary(found, console)
    assert "towards +x (95 % interval), not measured" in console.export_text()


def test_turned_strike_measures_the_tilt(rising):
    found = answer_evidence(with_turned(rising))
    (tilt,) = found.result.table_tilt
    assert tilt.towards_x.source == "measured"
    assert tilt.towards_x.value == pytest.approx(RISE, abs=3 * tilt.towards_x.sd)
    assert tilt.towards_x.sd < np.radians(0.04)
    assert tilt.towards_y.source == "prior"
    assert WarningCode.GRAVITY_ASSUMED not in warnings_of(found)
    assert np.linalg.norm(found.estimate.com.position - BODY.com) < 0.5e-3
    assert json.loads(found.json())["table_tilt"][0]["recordings"] == [1]


def test_level_reading_is_marked_as_given(rising):
    level = LevelReading(towards_x_rad=float(RISE), towards_x_sd_rad=2e-4)
    few = replace(on_table(rising, level=level), motions=tuple(rising.motions[i] for i in (0, 2, 8, 10)))
    found = answer_evidence(few)
    (tilt,) = found.result.table_tilt
    assert (tilt.towards_x.source, tilt.towards_y.source) == ("given", "prior")
    assert WarningCode.GRAVITY_ASSUMED not in warnings_of(found)
    stated = systematic_errors(few).tilts()[0]
    assert stated.lean == (pytest.approx(RISE), 0.0)
    assert stated.sd == (2e-4, np.radians(0.2)), "what the reading leaves out is the prior's"


def test_another_level_reading_is_another_levelling(rising):
    level = LevelReading(towards_x_rad=0.001, towards_x_sd_rad=2e-4)
    heads = [
        each.recordings[0] for each in (rising, on_table(rising, level=level), on_table(rising, level=level))
    ]
    assert levelling_indices(heads) == [0, 1, 1]


def test_older_results_keep_their_bytes(rising):
    data = json.loads(answer_evidence(rising).json())
    del data["table_tilt"]
    before = json.dumps(data, sort_keys=True, separators=(",", ":"))
    assert canonical_json(Result.model_validate(data)) == before
