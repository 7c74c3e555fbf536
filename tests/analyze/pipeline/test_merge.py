"""Merging of recordings of one object.

No strike counts twice, no shared error is averaged away, and the order of the files does not matter.
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import EstimationError, MergeError
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import by_start_time, levelling_indices, merge_evidence, resolve_exclusions
from analyze.report.report import render_report
from analyze.result.answer import answer_evidence
from schemas.document import canonical_json, sha256_text
from schemas.result import Result, WarningCode
from tests.analyze.pipeline.merged_sessions import (
    com_of,
    part,
    recording,
)

pytestmark = pytest.mark.usefixtures("coarse_regions")


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


def test_a_strike_of_one_plan_may_be_struck_in_either_recording(halves, joint):
    """Two recordings that together hold every strike of their plan are complete."""
    (half, _) = halves
    codes = [warning.code for warning in answer_evidence(half).result.warnings]
    assert WarningCode.RECORDING_INCOMPLETE in codes
    assert WarningCode.RECORDING_INCOMPLETE not in [warning.code for warning in joint.result.warnings]
    plan = joint.estimate.evidence.plan
    assert len(plan.strikes) == len(half.plan.strikes)
    assert {motion.plan_strike_id for motion in joint.estimate.evidence.motions} == {
        strike.id for strike in plan.strikes
    }


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
    """Two files of one recording must not overlap: a strike in both would count twice."""
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
    assert {strike.axis_id for strike in found.plan.strikes} == {
        strike.axis_id for strike in joint.estimate.evidence.plan.strikes
    }


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
