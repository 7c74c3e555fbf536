"""Merging of recordings of one object.

No strike counts twice, no shared error is averaged away, and the order of the files does not matter.
"""

from __future__ import annotations

import dataclasses
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import EstimationError, MergeError
from analyze.estimation.agreement import Agreement, agreement
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import by_start_time, levelling_indices, merge_evidence, resolve_exclusions
from analyze.report.report import render_report
from analyze.result.answer import Answer, answer_evidence
from analyze.types import CentreOfMass, TipMotion
from schemas.document import canonical_json, sha256_text
from schemas.result import Result, WarningCode
from schemas.strike_result import Verdict
from tests.analyze.estimation.bodies import SIX_AXES, box_body, fit_of, planned_strike, tip
from tests.analyze.simulated_session import carton, session

BODY = carton()
SD_PHI, SD_K = 4e-4, 2e-3
CHI2_RUNS = 40
CHI2_3 = (1.85, 4.35)
"""limits of the mean of 40 values of chi squared with 3 degrees of freedom: 3 - 3 and 3 + 3.5 standard
deviations (2.45 / sqrt 40 each), because its distribution is skew"""


def recording(evidence: Evidence, name: str, **manifest: object) -> Evidence:
    """Evidence with the same strikes, as a recording named `name` with these manifest entries."""
    (head,) = evidence.recordings
    entries = {"recording_id": name, "created": f"2026-01-0{1 + len(name) % 9}T00:00:00Z", **manifest}
    ids = tuple(motion.strike_id for motion in evidence.motions)
    return replace(
        evidence,
        recordings=(
            replace(
                head,
                path=Path(f"{name}.mcap"),
                content_id=sha256_text(name),
                manifest=head.manifest.model_copy(update=entries),
                strike_ids=ids,
                files=(f"{name}.mcap",),
            ),
        ),
    )


def part(evidence: Evidence, start: int, stop: int, name: str, **manifest: object) -> Evidence:
    """Evidence with the strikes `start` to `stop`, as a recording of its own."""
    return recording(replace(evidence, motions=evidence.motions[start:stop]), name, **manifest)


def session_without_frames(
    rng: np.random.Generator,
    tilt: float,
    moved: dict[str, np.ndarray],
    axes: tuple[tuple[int, int, int, int], ...],
) -> Evidence:
    """Session of two strikes per axis, with phi and k but no frames.

    The table is tilted by `tilt` [rad]; the true edges are displaced by `moved` [m], by axis id.
    """
    plain = session_of(axes)
    motions: list[TipMotion] = []
    for strike in plain.plan.strikes:
        phi, k = tip(BODY, strike, moved[strike.axis_id])
        fit = fit_of(
            phi + tilt + rng.normal(0, np.hypot(SD_PHI, 5e-4)),
            k * (1 + rng.normal(0, SD_K)),
            SD_PHI,
            SD_K * k,
        )
        motions.append(TipMotion(f"{strike.id}.1", strike.id, Verdict.GOOD, "", None, None, fit, (), 1.1))
    return replace(plain, motions=tuple(motions))


def session_of(axes: tuple[tuple[int, int, int, int], ...]) -> Evidence:
    strikes = [planned_strike(BODY, *axis, repeat) for axis in axes for repeat in range(2)]
    return replace(BARE, plan=BARE.plan.model_copy(update={"strikes": strikes}))


BARE = session(BODY, np.random.default_rng(0), repeats=1)


def com_of(evidence: Evidence) -> CentreOfMass:
    """Centre of mass without all else, which is quick."""
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    return centre_of_mass(equiplanes(evidence, evidence.motions), systematic_errors(evidence), prior)


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


def test_two_halves_give_the_answer_of_the_whole(whole, one, joint):
    assert [motion.strike_id.partition(":")[2] for motion in joint.estimate.evidence.motions] == [
        motion.strike_id for motion in whole.motions
    ]
    assert np.allclose(joint.estimate.com.position, one.estimate.com.position, rtol=0, atol=1e-9)
    assert np.allclose(joint.estimate.com.covariance, one.estimate.com.covariance, rtol=1e-6, atol=1e-15)
    assert np.allclose(joint.estimate.inertial.inertia, one.estimate.inertial.inertia, rtol=1e-6, atol=1e-12)
    assert np.allclose(
        joint.estimate.inertial.inertia_sd, one.estimate.inertial.inertia_sd, rtol=1e-6, atol=1e-12
    )
    assert np.allclose(
        joint.estimate.distribution.masses, one.estimate.distribution.masses, rtol=0, atol=1e-8
    )
    assert [each.axis_id for each in joint.result.moments] == [each.axis_id for each in one.result.moments]


def test_order_of_the_files_does_not_change_the_bytes(halves, joint):
    assert answer_evidence(merge_evidence(halves[::-1])).json() == joint.json()


def test_joint_estimate_is_more_accurate_than_either(halves, joint):
    for half in halves:
        alone = com_of(half).covariance
        assert np.linalg.eigvalsh(alone - com_of(joint.estimate.evidence).covariance).min() > -1e-12
        assert np.trace(com_of(joint.estimate.evidence).covariance) < 0.9 * np.trace(alone)


def test_joint_result_lists_its_recordings(halves, joint):
    inputs = joint.result.inputs
    assert inputs.recordings is not None
    assert [(each.number, each.recording_id) for each in inputs.recordings] == [(1, "a"), (2, "bb")]
    ids = sorted(half.recordings[0].content_id for half in halves)
    assert inputs.content_id == sha256_text("\n".join(ids))
    assert sorted(each.content_id for each in inputs.recordings) == ids
    assert Result.model_validate_json(joint.json()) == joint.result


def test_result_of_one_recording_has_no_list_of_recordings(one):
    assert one.result.inputs.recordings is None
    assert "recordings" not in canonical_json(one.result.inputs)


@pytest.mark.usefixtures("undrawn")
def test_joint_report_lists_its_recordings(whole):
    short = answer_evidence(merge_evidence((part(whole, 0, 2, "a"), part(whole, 2, 3, "bb"))))
    html = render_report(short, [])
    for head in short.estimate.evidence.recordings:
        assert head.content_id in html
        assert str(head.path) in html
    assert short.result.inputs.content_id in html
    assert "2 recordings" in html


def test_strike_is_excluded_by_its_merged_id(halves):
    heads = by_start_time([half.recordings[0] for half in halves])
    last = heads[1].strike_ids[-1]
    assert resolve_exclusions(heads, frozenset({f"2:{last}"})) == {f"2:{last}"}
    assert resolve_exclusions(heads, frozenset({last})) == {f"2:{last}"}, "only one recording holds it"
    with pytest.raises(
        EstimationError, match=r"a.mcap, bb.mcap: no strike '3:s1.1' to exclude: its strikes are 1:"
    ):
        resolve_exclusions(heads, frozenset({"3:s1.1"}))
    both = [heads[0], replace(heads[0], path=Path("c.mcap"))]
    with pytest.raises(
        EstimationError, match=r"more than one strike '(.*)' to exclude: give one of 1:\1, 2:\1$"
    ):
        resolve_exclusions(both, frozenset({heads[0].strike_ids[0]}))
    without = answer_evidence(merge_evidence(halves), EstimateOptions(exclude=frozenset({f"2:{last}"})))
    assert [(row.id, row.used) for row in without.result.strikes][-1] == (f"2:{last}", False)


# --- recordings that cannot be merged


def test_same_recording_twice_is_refused(halves):
    copy = recording(halves[0], "a")
    copy = replace(copy, recordings=(replace(copy.recordings[0], path=Path("copy.mcap")),))
    with pytest.raises(
        MergeError,
        match=r"^a.mcap and copy.mcap are the same recording: no strike may count twice: give it once$",
    ):
        merge_evidence((halves[0], copy))


def test_strike_held_by_two_files_is_refused(whole):
    """Such as a copy of a recording of which a file is missing."""
    with pytest.raises(
        MergeError, match=r"of one recording, and both hold strike .*: no strike may count twice"
    ):
        merge_evidence((part(whole, 0, 6, "a"), part(whole, 5, 12, "bb", recording_id="a")))
    assert (
        len(merge_evidence((part(whole, 0, 6, "a"), part(whole, 6, 12, "bb", recording_id="a"))).motions)
        == 12
    )


def test_recording_of_another_object_is_refused(halves):
    one, other = halves
    spec = one.spec.model_copy(
        update={"name": "jar", "shape": one.spec.shape.model_copy(update={"scale_sd": 0.01})}
    )
    corrected = recording(other, "bb", object=spec, object_sha256="0" * 64)
    with pytest.raises(
        MergeError, match=r"^a.mcap and bb.mcap describe their object differently \(name\).*--object$"
    ):
        merge_evidence((one, corrected))
    overridden = [replace(each, object_path_used=True) for each in (one, corrected)]
    assert len(merge_evidence(overridden).motions) == 12
    box = spec.shape.box.model_copy(update={"size_m": [0.08, 0.06, 0.16]})
    taller = recording(
        other, "bb", object=spec.model_copy(update={"shape": spec.shape.model_copy(update={"box": box})})
    )
    with pytest.raises(
        MergeError,
        match=r"^a.mcap \(test box\) and bb.mcap \(jar\) are of different objects: estimate each by itself$",
    ):
        merge_evidence([replace(each, object_path_used=True) for each in (one, taller)])


# --- errors that recordings share


def renamed(evidence: Evidence, names: dict[str, str], along: float = 0.0) -> Evidence:
    """Evidence with other axis ids, and pivot points moved along the same lines by `along` [m]."""
    strikes = [
        strike.model_copy(
            update={
                "axis_id": names.get(strike.axis_id, strike.axis_id),
                "pivot": strike.pivot.model_copy(
                    update={
                        "point": (
                            (np.array(strike.pivot.point) + along * np.array(strike.pivot.direction)).tolist()
                        )
                    }
                ),
            }
        )
        for strike in evidence.plan.strikes
    ]
    return replace(evidence, plan=evidence.plan.model_copy(update={"strikes": strikes}))


def test_edge_with_another_id_is_recognised(halves, joint):
    names = {
        axis: f"other {i}"
        for i, axis in enumerate(sorted({strike.axis_id for strike in halves[1].plan.strikes}))
    }
    found = merge_evidence((halves[0], renamed(halves[1], names, along=0.01)))
    assert np.allclose(com_of(found).covariance, com_of(joint.estimate.evidence).covariance, rtol=1e-6)
    assert [strike.axis_id for strike in found.plan.strikes] == [
        strike.axis_id for strike in joint.estimate.evidence.plan.strikes
    ]


def test_same_id_for_two_edges_gives_two_axes(halves):
    one, other = sorted({strike.axis_id for strike in halves[1].plan.strikes})[:2]
    swapped = renamed(halves[1], {one: other, other: one})
    assert {strike.axis_id for strike in merge_evidence((halves[0], swapped)).plan.strikes} == {
        s.axis_id for s in halves[0].plan.strikes
    }
    only = replace(
        halves[0],
        plan=halves[0].plan.model_copy(
            update={"strikes": [s for s in halves[0].plan.strikes if s.axis_id != other]}
        ),
    )
    kept = tuple(motion for motion in only.motions if not motion.plan_strike_id.startswith(other))
    found = merge_evidence((replace(only, motions=kept), renamed(halves[1], {other: one, one: "elsewhere"})))
    axes = {strike.id: strike.axis_id for strike in found.plan.strikes}
    assert axes[f"1:{one}#0"] == axes[f"2:{one}#0"] == one
    assert axes[f"2:{other}#0"] == f"2:{one}"


def test_shared_error_of_an_edge_is_not_averaged_away(whole):
    """Twelve strikes repeated in four recordings: the part of the covariance from shared errors remains."""
    noisy = [
        replace(motion, fit=dataclasses.replace(motion.fit, covariance=1e-4 * motion.fit.covariance))
        for motion in whole.motions
    ]
    sure = replace(whole, motions=tuple(noisy))
    once = com_of(part(sure, 0, 12, "a")).covariance
    many = [recording(sure, "a" + "b" * i) for i in range(4)]
    often = com_of(merge_evidence(many)).covariance
    assert np.trace(often) > 0.75 * np.trace(once), "edges, tilt and radius do not shrink with repeats"
    as_if_new = [renamed(each, {}) for each in many]
    for i, each in enumerate(as_if_new):
        strikes = [
            strike.model_copy(update={"axis_id": f"{i}{strike.axis_id}"}) for strike in each.plan.strikes
        ]
        as_if_new[i] = replace(each, plan=each.plan.model_copy(update={"strikes": strikes}))
    assert np.allclose(com_of(merge_evidence(as_if_new)).covariance, often, rtol=1e-6)


def test_one_tilt_per_table_levelling(halves):
    same = merge_evidence(halves)
    assert levelling_indices(same.recordings) == [0, 0]
    assert systematic_errors(same).other_tilt_sds == ()
    other = merge_evidence(
        (halves[0], part(halves[1], 0, 6, "bb", rig={"name": "bench 2"}, gravity_tilt_sd_rad=2e-3))
    )
    assert levelling_indices(other.recordings) == [0, 1]
    assert systematic_errors(other).other_tilt_sds == (2e-3,)
    assert {plane.strike_id[0]: plane.level for plane in equiplanes(other, other.motions)} == {"1": 0, "2": 1}


def test_k_is_scaled_to_the_gravity_of_each_place(halves):
    """A g lower by 1 % makes k lower by 1 %, and must not change the moments."""
    one, other = halves
    g = 0.99 * one.manifest.g_m_s2
    lighter = [
        replace(
            motion,
            fit=dataclasses.replace(
                motion.fit,
                k=0.99 * motion.fit.k,
                covariance=motion.fit.covariance * np.outer([1, 0.99], [1, 0.99]),
            ),
        )
        for motion in other.motions
    ]
    # The manifest refuses values of g that do not occur on Earth; the estimate accepts them.
    moved = replace(other, motions=tuple(lighter))
    moved = part(moved, 0, 6, "bb", g_m_s2=g)
    here, there = (answer_evidence(merge_evidence((one, each))).estimate.inertial for each in (other, moved))
    assert np.allclose(here.inertia, there.inertia, rtol=1e-9)


def squared_mahalanobis(seed: int, *, tables: int) -> float:
    """Squared Mahalanobis error of c from two merged sessions with errors drawn from their stated sd."""
    rng = np.random.default_rng(seed)
    sd_edge, sd_tilt = 2e-4, 1e-3
    moved: dict[str, np.ndarray] = {}
    for axis in SIX_AXES:
        strike = planned_strike(BODY, *axis)
        turned = np.array(strike.R_world_object)
        moved[strike.axis_id] = turned[0] * rng.normal(0, sd_edge) + turned[2] * rng.normal(0, sd_edge)
    radius = rng.normal(0, 1e-4)
    for axis in SIX_AXES:
        strike = planned_strike(BODY, *axis)
        turned = np.array(strike.R_world_object)
        moved[strike.axis_id] = moved[strike.axis_id] + (turned[2] - turned[0]) * radius
    tilts = rng.normal(0, sd_tilt, 2)
    if tables == 1:
        tilts[1] = tilts[0]
    slips = {axis: rng.normal(0, 2e-4) for axis in moved}
    sessions = []
    for i, axes in enumerate((SIX_AXES[:4], SIX_AXES[2:])):
        found = session_without_frames(rng, tilts[i], moved, axes)
        motions = [
            replace(m, fit=dataclasses.replace(m.fit, phi=m.fit.phi + slips[found.planned(m).axis_id]))
            for m in found.motions
        ]
        rig = {"name": f"bench {i if tables == 2 else 0}"}
        sessions.append(
            recording(
                replace(found, motions=tuple(motions)),
                "ab"[i] * (i + 1),
                rig=rig,
                gravity_tilt_sd_rad=sd_tilt,
            )
        )
    com = com_of(merge_evidence(sessions))
    off = com.position - BODY.com
    return float(off @ np.linalg.solve(com.covariance, off))


def refilled(evidence: Evidence, moved_kg: float) -> Evidence:
    """Evidence of the same object with `moved_kg` of its upper part moved to the lower."""
    body = box_body(
        (0.08, 0.06, 0.15), (0.026, 0.014 - moved_kg, 0.004 + moved_kg), 0.005, (0.5, -0.35, 0.79)
    )
    other = session(body, np.random.default_rng(2))
    return replace(evidence, motions=other.motions, plan=other.plan)


def test_object_refilled_between_recordings_gives_a_warning(whole, halves, joint):
    assert WarningCode.RECORDINGS_DISAGREE not in {warning.code for warning in joint.result.warnings}
    found = answer_evidence(merge_evidence((halves[0], part(refilled(whole, 0.002), 6, 12, "bb"))))
    text = next(
        warning.text for warning in found.result.warnings if warning.code is WarningCode.RECORDINGS_DISAGREE
    )
    assert re.search(
        r"centres of mass lie 2\.\d mm apart, more than their errors allow: was the object opened, refilled"
        r" or exchanged",
        text,
    )


def test_recordings_of_one_body_agree_and_of_two_bodies_disagree(whole):
    def compared(*evidence: Evidence) -> Agreement:
        both = merge_evidence(evidence)
        planes = equiplanes(both, both.motions)
        numbers = [both.recorded_in.get(plane.strike_id, 0) for plane in planes]
        return agreement(
            planes, numbers, com_of(both), systematic_errors(both), ComPrior.from_bounds(*both.model.bounds)
        )

    alone = compared(whole)
    assert alone.holds
    assert alone.chi_squared == 0
    one = part(whole, 0, 12, "a")
    same = compared(one, part(refilled(whole, 0.0), 0, 12, "bb"))
    assert same.holds
    assert same.largest_shift < 1e-4
    other = compared(one, part(refilled(whole, 0.0005), 0, 12, "bb"))
    assert not other.holds
    # 0.5 g moved by 67 mm in 44 g
    assert other.largest_shift == pytest.approx(7.7e-4, rel=0.1)


@pytest.mark.parametrize("tables", [1, 2])
def test_covariance_of_joint_sessions_matches_the_errors(tables):
    found = np.array([squared_mahalanobis(seed, tables=tables) for seed in range(CHI2_RUNS)])
    low, high = CHI2_3
    assert low < found.mean() < high
    assert np.mean(found < 7.81) > 0.86, "95 % regions hold the true value"
