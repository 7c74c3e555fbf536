"""Sentences of the verdict on centre of mass and tensor: trust, doubt, not determined."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from analyze.pipeline.estimate import estimate_evidence
from analyze.result.assessment import assessment
from analyze.result.document import result_document
from analyze.result.trust import quantity_sentences
from analyze.types import RestTurn
from schemas.result import WarningCode
from tests.analyze.estimation.drawn_sessions import VERTEX_AXES
from tests.analyze.pipeline.merged_sessions import BODY
from tests.analyze.simulated_session import session

pytestmark = pytest.mark.usefixtures("coarse_regions")
REGIONS = "trust the region masses"


@pytest.fixture(scope="module")
def sound():
    return estimate_evidence(session(BODY, np.random.default_rng(3)))


@pytest.fixture(scope="module")
def singular():
    return estimate_evidence(session(BODY, np.random.default_rng(3), axes=VERTEX_AXES))


def said(estimate, **how):
    return quantity_sentences(estimate, REGIONS, **({"sound": True, "moments_sound": True} | how))


def test_sound_session_is_trusted_and_has_a_robustness_table(sound):
    words = said(sound)
    assert [each.split()[0] for each in words] == ["trust", "trust", "trust", "not"]
    table = result_document(sound).robustness
    assert table is not None
    assert {row.what_if for row in table} >= {"edge radius not given", "one strike left out"}
    assert all(row.com_holds and row.moments_hold for row in table)


def test_poses_at_rest_that_differ_are_doubted_by_name():
    """Crumbs of 0.3 degrees under the object: c was trusted, and nothing named the cause."""
    rng = np.random.default_rng(4)
    careful = session(BODY, rng)
    crumbs = rng.normal(0, np.radians(0.3), len(careful.motions)).tolist()
    motions = [
        replace(motion, fit=replace(motion.fit, phi=motion.fit.phi + crumb))
        for motion, crumb in zip(careful.motions, crumbs, strict=True)
        if motion.fit is not None
    ]
    careless = estimate_evidence(replace(careful, motions=tuple(motions)))
    com = next(each for each in assessment(careless) if "the centre of mass" in each)
    assert com.startswith("doubt the centre of mass, stated to")
    assert "the pose at rest differed from strike to strike" in com
    assert any(each.code is WarningCode.STRIKES_SCATTER for each in result_document(careless).warnings)


def test_poses_at_rest_that_markers_show_are_corrected_and_reported():
    rng = np.random.default_rng(4)
    careful = session(BODY, rng)
    motions = []
    for motion in careful.motions:
        if motion.fit is not None:
            crumb = rng.normal(0, np.radians(0.3))
            turn = RestTurn(crumb + rng.normal(0, 3e-4), 3e-4, motion.plan_strike_id, 1e-3, "camera")
            fit = replace(motion.fit, phi=motion.fit.phi - crumb)
            motions.append(replace(motion, fit=fit, rest_turns=(turn,)))
    careless = estimate_evidence(replace(careful, motions=tuple(motions)))
    clean = estimate_evidence(careful)
    assert assessment(careless)[0].startswith("trust the centre of mass")
    assert np.linalg.norm(careless.com.position - clean.com.position) < 2.5e-4
    assert np.trace(careless.com.covariance) < 6 * np.trace(clean.com.covariance)
    measured = {motion.strike_id: motion.fit.phi for motion in motions}
    for each in careless.checks.left_out:
        assert each.phi + each.phi_off == pytest.approx(measured[each.strike_id])
    codes = {each.code for each in result_document(careless).warnings}
    assert WarningCode.REST_TURNED in codes
    assert WarningCode.STRIKES_SCATTER not in codes


def test_singular_set_trusts_nothing_and_names_the_corner(singular):
    words = assessment(singular)
    assert not any(each.startswith("trust") for each in words)
    com = next(each for each in words if "the centre of mass along" in each)
    assert com.startswith("not determined: the centre of mass along (")
    assert "the 3 struck edges meet at one point: strike about an edge that does not lead there" in com
    assert any("region masses" in each for each in words)
    assert result_document(singular).robustness is None


def test_answer_that_rests_on_an_unchecked_radius_is_doubted_by_that(sound):
    one = replace(sound.alternatives[0], com_holds=False, moments_hold=False, com_half=9e-4, unchecked=True)
    words = said(replace(sound, alternatives=(one,)))
    assert not any(each.startswith("trust") for each in words)
    assert "do not check the stated edge radius" in words[0]
    assert "known only to 0.9 mm" in words[0]
    assert "known only with the stated edge radius" in words[1]


def test_trust_that_rests_on_the_stated_radius_says_so(sound):
    one = replace(sound.alternatives[0], com_half=1.4e-3)
    words = said(replace(sound, alternatives=(one,)))
    assert re.match(
        r"trust the centre of mass, to \d\.\d mm if the edge radius is as stated, to 1\.4 mm without it: ",
        words[0],
    )
    words = said(replace(sound, alternatives=(replace(one, com_half=1e-6),)))
    assert "radius" not in words[0]


def test_answer_that_one_alternative_moves_is_doubted_by_its_name(sound):
    one = replace(sound.alternatives[1], com_shift=np.array([2e-3, 0.0, 0.0]), com_holds=False)
    words = said(replace(sound, alternatives=(one,)))
    assert words[0].startswith("trust Ixx")
    assert "tilt of the table twice as uncertain it moves by 2.0 mm" in words[1]
    assert words[2].startswith("doubt the region masses: they depend on")


def test_wide_interval_of_the_centre_of_mass_is_doubted(sound):
    com = replace(sound.com, covariance=sound.com.covariance + np.diag([0.0, 0.0, 9e-6]))
    words = said(replace(sound, inertial=replace(sound.inertial, com=com)))
    assert any(each.startswith("doubt the centre of mass: it is known only to 5.9 mm") for each in words)


def test_gravity_of_one_axis_puts_moments_in_doubt_not_everything(sound):
    gravity = replace(sound.checks.gravity, relative=0.1, sd=0.01, single_axis="z-/x+")
    words = assessment(replace(sound, checks=replace(sound.checks, gravity=gravity)))
    assert words[0].startswith("trust the centre of mass")
    assert not any("everything" in each for each in words)
    assert any(each.startswith("doubt the moments: k of the strikes about z-/x+ alone") for each in words)
    every = replace(sound, checks=replace(sound.checks, gravity=replace(gravity, single_axis=None)))
    assert any(each.startswith("doubt everything: gravity") for each in assessment(every))
    assert not any(each.startswith("trust") for each in assessment(every))
