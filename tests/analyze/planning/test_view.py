"""Visibility of tags through a tip: faults with number and remedy, and tags off the surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.precision import TrackedSwing, frame_sd, strike_covariances
from analyze.planning.prepared import prepare_object
from analyze.planning.view import default_camera, refuse_off_surface
from analyze.types import CameraModel
from schemas.rig_limits import MIN_TAG_EDGE_PX
from schemas.session_manifest import LensModel
from tests.analyze.geometry.shapes import box_triangles, spec_of, stl
from tests.analyze.planning.test_plan import SIZE, side_markers
from tests.analyze.planning.test_refusal import EVERY, sides

STRIKER = StrikerModel(fastest_m_s=5.0)


def box_with(markers, camera=None, friction=1.0):
    spec = spec_of({"box": {"size_m": list(SIZE)}}, markers=markers)
    return prepare_object(
        load_object_model(spec, None, ""), spec, Bench(STRIKER, camera or default_camera(), friction)
    )


def sized(size):
    return [marker | {"size_m": size} for marker in side_markers()]


def codes(prepared):
    return {entry.code for entry in prepared.rejected}


def test_tags_too_small_in_the_image_are_reported():
    prepared = box_with(sized(0.003))
    small = [entry for entry in prepared.rejected if entry.code == "tag_small"]
    assert small
    assert all(6 < entry.number < 10 for entry in small)
    with pytest.raises(
        PlanError, match=r"with a tag too small in the image \(\d+(?: to \d+)? px\).*: print larger tags"
    ) as caught:
        plan_strikes(prepared, "", PlanRequest(9))
    assert "\n" not in str(caught.value)


def test_smallest_tag_is_that_of_the_rig_limits():
    """A tag just above `MIN_TAG_EDGE_PX` is planned with, one just below is rejected as too small.

    The face that carries it is 0.52 m from the camera, where 1 mm is 2.75 px.
    """
    exact = MIN_TAG_EDGE_PX / (1430 / (0.55 - SIZE[1] / 2))
    only = [marker for marker in side_markers() if marker["id"] in {2, 3}]
    assert not codes(box_with([marker | {"size_m": exact * 1.001} for marker in only])) & {"tag_small"}
    assert "tag_small" in codes(box_with([marker | {"size_m": exact * 0.999} for marker in only]))


def test_smaller_tags_are_planned_with_a_larger_error():
    """The noise of the angle is inversely proportional to the width, and below 60 px to its square."""
    wide, narrow = (
        plan_strikes(box_with(sized(size)), "", PlanRequest(9)).strikes[0].phi_measured_sd_rad
        for size in (0.03, 0.012)
    )
    assert narrow > 1.05 * wide
    assert frame_sd(30) == pytest.approx(4 * frame_sd(60))
    assert frame_sd(60) == pytest.approx(2 * frame_sd(120))


@pytest.mark.parametrize("faces", [("+x", "+y"), ("-x", "-y", "-z")])
def test_edges_seen_from_the_other_end_are_planned_turned(faces):
    """Seen from one end, tags on two or three sides show edges that leave a direction of c unknown."""
    every = sides((80, 60, 150), (0, 0, 0), only=EVERY)
    prepared = box_with([every[EVERY.index(face)] for face in faces], friction=0.6)
    plan = plan_strikes(prepared, "", PlanRequest(9))
    turned = [strike.heading_rad != 0 for strike in plan.strikes]
    assert turned == sorted(turned), "the stand is moved more than once"
    assert 0 < sum(turned) < len(turned)
    assert plan.predicted_com_sd_m < 0.3e-3
    for strike in plan.strikes:
        assert ("as the camera then sees a tag" in strike.card) == bool(strike.heading_rad)
        tags = [every[name]["T_object_marker"] for name in strike.visible_markers]
        towards = np.array(strike.R_world_object) @ np.array(tags[0])[:3, 2]
        assert towards[1] * np.cos(strike.heading_rad) < -0.9, "the tag does not face the camera"
    assert any("turned by 180 degrees" in text for text in plan.warnings)


def test_tags_out_of_the_image_are_reported():
    lens = default_camera()
    moved = lens.T_world_camera.copy()
    moved[0, 3] += 0.15
    prepared = box_with(side_markers(), replace(lens, T_world_camera=moved))
    out = [entry for entry in prepared.rejected if entry.code == "out_of_image"]
    assert out
    assert all(entry.number > 0 and "too far out" in entry.text for entry in out)
    with pytest.raises(
        PlanError, match=r"12 with the tag out of the image \(by \d+ to \d+ px\): move or turn the camera"
    ):
        plan_strikes(prepared, "", PlanRequest(9))


def test_visibility_uses_the_lens_model():
    """From 0.1 m before the box a fisheye sees tags that a pinhole of its focal length does not."""
    T = default_camera().T_world_camera.copy()
    T[1, 3] = -0.1 - SIZE[1] / 2
    pinhole = CameraModel(656, 492, np.array([[300.0, 0, 327.5], [0, 300, 245.5], [0, 0, 1]]), np.zeros(5), T)
    fisheye = replace(pinhole, model=LensModel.FISHEYE, distortion=np.array([-0.1, 0.0, 0.0, 0.0]))
    out = [
        sum(entry.code == "out_of_image" for entry in box_with(sized(0.01), lens).rejected)
        for lens in (pinhole, fisheye)
    ]
    assert out[0] > out[1]


def test_tag_hidden_by_the_object_is_reported():
    """A slab on the same foot stands 60 mm in front of the tag's face."""
    body = np.concatenate(
        [box_triangles(np.array([80.0, 60, 150])), box_triangles(np.array([80.0, 80, 20]), (0, -70, -65))]
    )
    body = np.concatenate([body, box_triangles(np.array([80.0, 20, 150]), (0, -100, 0))])
    marker = next(marker for marker in side_markers() if marker["id"] == 3)
    spec = spec_of({"file": "b.stl", "unit": "mm"}, 0.2, markers=[marker])
    prepared = prepare_object(
        load_object_model(spec, stl(body), "b.stl"), spec, Bench(STRIKER, default_camera(), 1.0)
    )
    hidden = [entry for entry in prepared.rejected if entry.code == "hidden"]
    assert hidden
    assert "hides marker 3" in hidden[0].text
    with pytest.raises(PlanError, match="glue"):
        plan_strikes(prepared, "", PlanRequest(9))


def moved(by_m, index=0):
    """Markers of the box, with marker `index` moved `by_m` [m] off its face."""
    markers = side_markers()
    pose = np.array(markers[index]["T_object_marker"])
    pose[:3, 3] += by_m * pose[:3, 2]
    markers[index]["T_object_marker"] = pose.tolist()
    return markers


def check(markers, **shape):
    spec = spec_of({"box": {"size_m": list(SIZE)}} | shape, markers=markers)
    refuse_off_surface(load_object_model(spec, None, ""), spec)


@pytest.mark.parametrize(
    ("by", "message"), [(0.050, "marker 0 lies 50 mm outside"), (-0.010, "marker 0 lies 10 mm inside")]
)
def test_tag_off_the_surface_is_refused(by, message):
    with pytest.raises(PlanError, match=message) as caught:
        check(moved(by))
    assert "\n" not in str(caught.value)


def test_tag_within_the_accuracy_of_a_hand_measurement_is_accepted():
    for by in (-0.0025, 0.0, 0.0025):
        check(moved(by))
    check([marker | {"size_m": 0.09} for marker in side_markers()])
    check([marker | {"thickness_m": 0.004} for marker in moved(0.006)])


@pytest.mark.parametrize("index", range(4))
def test_tag_that_faces_into_the_object_is_refused(index):
    markers = side_markers()
    pose = np.array(markers[index]["T_object_marker"])
    pose[:3, 1:3] *= -1
    markers[index]["T_object_marker"] = pose.tolist()
    with pytest.raises(PlanError, match=f"marker {index} looks into the object: correct T_object_marker"):
        check(markers)


def test_surface_error_widens_the_tolerance():
    with pytest.raises(PlanError):
        check(moved(0.008))
    check(moved(0.008), surface_sd_m=0.003)


def test_lower_frame_rate_gives_larger_sd():
    """A sixth of the frames gives at best 2.4 times the sd; at 2 frames per second the prior limits it."""
    spec = spec_of({"box": {"size_m": list(SIZE)}}, markers=side_markers())
    model = load_object_model(spec, None, "")
    fast, slow = (
        prepare_object(model, spec, Bench(STRIKER, default_camera(), 1.0, frame_rate=rate))
        for rate in (120.0, 20.0)
    )
    expected = fast.usable[0].candidate.expected
    rates = (2.0, 20.0, 119.0, 120.0, 241.0, 480.0)
    noise = {
        rate: np.sqrt(strike_covariances([TrackedSwing(expected, 1.15, 5e-4)], rate)[0][0, 0])
        for rate in rates
    }
    assert 2.2 < noise[20.0] / noise[120.0] < 4.0
    assert noise[119.0] == pytest.approx(noise[120.0], rel=0.05)
    assert noise[241.0] / noise[480.0] == pytest.approx(np.sqrt(480 / 241), rel=0.05)
    assert noise[20.0] < noise[2.0] < 1.1
    assert (
        plan_strikes(slow, "", PlanRequest(9)).predicted_com_sd_m
        > plan_strikes(fast, "", PlanRequest(9)).predicted_com_sd_m
    )
