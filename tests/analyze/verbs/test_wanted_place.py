"""Planned outline, offset and hands in the observations of `analyze watch`, and the curves of strikes."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.motion.scene import Scene
from analyze.tracking.camera_model import project, world_to_camera
from analyze.tracking.pose import marker_corners
from analyze.types import MotionFit, TipAngle, TipMotion
from analyze.verbs.watch.curve import strike_curve
from analyze.verbs.watch.wanted_place import WantedPlace
from schemas.strike_result import Verdict
from schemas.watch_lines import MAX_CURVE_POINTS
from tests.analyze.motion.tipping import camera, marker, planned

BOX = np.array([[x, y, z] for x in (0.0, 0.06) for y in (0.0, 0.04) for z in (0.0, 0.12)])


def scene(
    x: float = 0.0, y: float = 0.0, yaw: float = 0.0, grey: float = 100.0, noise_px: float = 0.0
) -> Scene:
    """Image of the marker on an object that is off its planned place by x, y [m] and yaw [rad]."""
    strike, tag = planned(), marker()
    assert tag.T_object_marker is not None
    R, p = np.array(strike.R_world_object), np.array(strike.p_world_object)
    corners = marker_corners(tag.size) @ tag.T_object_marker[:3, :3].T + tag.T_object_marker[:3, 3]
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    world = (corners @ R.T + p) @ turn.T + np.array([x, y, 0.0])
    R_camera, p_camera = world_to_camera(camera())
    seen = project(camera(), world @ R_camera.T + p_camera)
    seen = seen + np.random.default_rng(2).normal(0.0, noise_px, seen.shape)
    return Scene(10**9, {tag.id: seen}, (), 0.0, np.full((62, 82), grey, np.float32))


def place(hull: np.ndarray | None = None) -> WantedPlace:
    tag = marker()
    return WantedPlace(planned(), camera(), {tag.id: tag}, BOX if hull is None else hull)


@pytest.mark.parametrize(
    ("x", "y", "yaw"), [(0.0, 0.0, 0.0), (0.004, -0.003, 0.05), (-0.02, 0.01, -0.3), (0.05, 0.0, 0.0)]
)
def test_the_offset_is_found(x: float, y: float, yaw: float) -> None:
    found = place().compare([scene(x, y, yaw, noise_px=0.05)])
    assert found["offset_m"] == pytest.approx([x, y], abs=4e-4)
    assert found["yaw_error_rad"] == pytest.approx(yaw, abs=0.01)


def test_an_object_on_another_face_has_no_offset() -> None:
    upside = scene()
    corners = next(iter(upside.corners.values()))
    turned = Scene(1, {marker().id: corners[[1, 2, 3, 0]]}, (), 0.0, upside.coarse)
    assert place().compare([turned])["offset_m"] is None


@pytest.mark.parametrize("twice", [(), (3,)])
def test_without_a_usable_marker_there_is_no_offset(twice: tuple[int, ...]) -> None:
    seen = scene()
    corners = seen.corners if twice else {}
    found = place().compare([Scene(1, corners, twice, 0.0, seen.coarse)])
    assert found["offset_m"] is None
    assert found["yaw_error_rad"] is None


def test_the_outline_is_that_of_the_planned_object() -> None:
    found = place().compare([scene()])
    outline = np.array(found["outline_px"])
    R_camera, p_camera = world_to_camera(camera())
    strike = planned()
    world = BOX @ np.array(strike.R_world_object).T + np.array(strike.p_world_object)
    seen = project(camera(), world @ R_camera.T + p_camera)
    assert outline.min(axis=0) == pytest.approx(seen.min(axis=0), abs=0.1)
    assert outline.max(axis=0) == pytest.approx(seen.max(axis=0), abs=0.1)
    assert 4 <= len(outline) <= 8


def test_the_axes_are_drawn_where_the_object_stands() -> None:
    origin = np.array(planned().p_world_object)
    R_camera, p_camera = world_to_camera(camera())
    for x in (0.0, 0.05):
        axes = place().compare([scene(x)])["axes_px"]
        seen = project(camera(), (origin + np.array([x, 0.0, 0.0]))[None] @ R_camera.T + p_camera)[0]
        assert axes[0] == pytest.approx(seen, abs=0.5)
        assert len(axes) == 4


def test_without_a_shape_there_is_no_outline() -> None:
    tag = marker()
    found = WantedPlace(planned(), camera(), {tag.id: tag}, None).compare([scene(), scene()])
    assert found["outline_px"] is None
    assert found["moving_fraction"] is None
    assert found["offset_m"] is not None


def test_hands_change_pixels_and_lamps_do_not() -> None:
    wanted, before = place(), scene()
    assert wanted.compare([before])["moving_fraction"] is None
    assert wanted.compare([before, scene()])["moving_fraction"] == 0.0
    assert wanted.compare([before, scene(grey=140.0)])["moving_fraction"] == 0.0
    outline = np.array(wanted.compare([before])["outline_px"])
    column, row = (outline.mean(axis=0) / 8).astype(int)
    hand = before.coarse.copy()
    hand[row - 3 : row + 3, column - 3 : column + 3] = 30.0
    assert wanted.compare([before, Scene(1, before.corners, (), 0.0, hand)])["moving_fraction"] > 0.01


def motion(frames: int, *, fitted: bool) -> TipMotion:
    time_s = np.arange(frames) / 120.0 - 0.2
    theta = np.clip(time_s, 0.0, None)
    zero = np.zeros(frames)
    angle = TipAngle((1e9 * (time_s + 100.0)).astype(np.int64), theta, zero + 1e-4, zero, zero)
    start, stop = 40, frames - 20
    fit = MotionFit("test", 0.4, 60.0, np.eye(2), 0.0, 1.0, 0, (start, stop), np.full(stop - start, 0.01))
    return TipMotion("s1.1", "s1", Verdict.GOOD, "", angle, None, fit if fitted else None)


def test_a_curve_shows_measurement_and_fit_from_the_contact_on() -> None:
    curve = strike_curve(motion(150, fitted=True), 100_000_000_000)
    assert curve is not None
    assert curve.time_s[0] == pytest.approx(-0.1, abs=0.01)
    assert len(curve.fit_time_s) == 90
    at = curve.fit_time_s.index(curve.fit_time_s[10])
    assert curve.fit_rad[at] == pytest.approx(curve.fit_time_s[at] - 0.01, abs=1e-4)


@pytest.mark.parametrize("fitted", [True, False])
def test_a_long_curve_is_thinned(fitted: bool) -> None:
    curve = strike_curve(motion(3000, fitted=fitted), None)
    assert curve is not None
    assert len(curve.time_s) <= MAX_CURVE_POINTS
    assert len(curve.fit_time_s) <= MAX_CURVE_POINTS
    assert bool(curve.fit_rad) is fitted


def test_an_object_that_was_not_followed_has_no_curve() -> None:
    assert strike_curve(TipMotion("s1.1", "s1", Verdict.MARKER_LOST, ""), None) is None
