"""Strikes on a box without a tag, by its printed side."""

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.errors import TrackingError
from analyze.motion.print_motion import analyse_images, print_motion
from analyze.motion.strike import placement_of
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.sections import next_face_angle, rolling_outline, strike_supports
from schemas.strike_result import Verdict
from tests.analyze.motion.printed_box import RATE_HZ, box, camera, tip


def test_the_print_shows_the_tip_as_well_as_tags():
    _, model = box()
    made = tip(0, seed=0)
    shape = model.vertices, model.faces
    motion, _, _ = print_motion(made.frames, camera(), shape, placement_of(made.planned), made.contact_ns)
    frame = np.rint((motion.angle.time_ns - made.frames[0].time_ns) * 1e-9 * RATE_HZ).astype(int)
    moving = (made.theta[frame] > 0.02) & (made.theta[frame] < 1.5)
    off = np.degrees(motion.angle.theta - made.theta[frame])[moving]
    assert len(frame) > 0.9 * len(made.frames)
    assert abs(off.mean()) < 0.04
    assert off.std() < 0.05
    task = StrikeTask(
        "s1.1",
        made.planned,
        made.contact_ns,
        None,
        rolling_outline(model, made.planned),
        next_face_angle(model, made.planned),
        supports=strike_supports(model, made.planned),
    )
    found, _ = analyse_images(made.frames, camera(), [], shape, task)
    assert found.verdict is Verdict.GOOD
    assert found.fit is not None
    assert found.fit.k is not None
    assert abs(math.degrees(found.fit.phi - made.phi)) < 0.05
    assert abs(found.fit.k / made.k - 1) < 0.003
    assert abs(found.fit.phi - made.phi) < 3 * math.sqrt(found.fit.covariance[0, 0])


@pytest.mark.parametrize("number", [0, 1])
def test_the_edge_of_a_shadow_may_cross_the_print(number):
    _, model = box()
    made = tip(number, seed=0)
    place = np.linspace(-1.0, 1.0, made.frames[0].image.shape[1])
    dark = [1.0 - 0.3 / (1.0 + np.exp((place + 0.8 - 1.2 * theta) / 0.02)) for theta in made.theta]
    frames = [
        replace(frame, image=np.rint(frame.image * each).astype(np.uint8))
        for frame, each in zip(made.frames, dark, strict=True)
    ]
    shape = model.vertices, model.faces
    motion, _, _ = print_motion(frames, camera(), shape, placement_of(made.planned), made.contact_ns)
    frame = np.rint((motion.angle.time_ns - made.frames[0].time_ns) * 1e-9 * RATE_HZ).astype(int)
    moving = (made.theta[frame] > 0.02) & (made.theta[frame] < 1.5)
    off = np.degrees(motion.angle.theta - made.theta[frame])[moving]
    assert moving.sum() > 50
    assert np.sqrt(np.mean(off**2)) < 0.07


def test_a_blank_side_is_refused_with_what_to_do():
    _, model = box()
    made = tip(0, seed=0, blank=True)
    with pytest.raises(TrackingError, match=r"too little print.*stick on any sticker with print, or a tag"):
        print_motion(made.frames[:45], camera(), (model.vertices, model.faces), placement_of(made.planned), 0)


def test_noise_that_images_at_rest_share_is_no_print():
    """As coding freezes it."""
    _, model = box()
    made = tip(0, seed=0, blank=True)
    frozen = np.random.default_rng(1).normal(0, 3.5, made.frames[0].image.shape)
    frames = [
        replace(frame, image=np.clip(np.rint(frame.image + frozen), 0, 255).astype(np.uint8))
        for frame in made.frames[:45]
    ]
    with pytest.raises(TrackingError, match=r"too little print \(blank"):
        print_motion(frames, camera(), (model.vertices, model.faces), placement_of(made.planned), 0)


@pytest.mark.parametrize(("factor", "found"), [(0.75, "more"), (1.3, "less")])
def test_an_object_that_is_higher_or_lower_than_its_card_shows_is_refused(factor, found):
    """As when another side is up."""
    _, model = box()
    made = tip(3, seed=0)
    other = model.vertices.copy()
    base = other[:, 2].min()
    other[:, 2] = base + factor * (other[:, 2] - base)
    with pytest.raises(TrackingError, match=f"{found} than the planned shape moves with the print: put the"):
        print_motion(made.frames, camera(), (other, model.faces), placement_of(made.planned), made.contact_ns)


def test_frames_without_the_print_are_left_out():
    """As when the object leaves the image: an even background is no print."""
    _, model = box()
    made = tip(0, seed=0)
    gone = len(made.frames) - 12
    frames = [
        replace(frame, image=np.full_like(frame.image, 90)) if number >= gone else frame
        for number, frame in enumerate(made.frames)
    ]
    shape = model.vertices, model.faces
    motion, _, _ = print_motion(frames, camera(), shape, placement_of(made.planned), made.contact_ns)
    assert motion.angle.time_ns[-1] < frames[gone].time_ns


def test_a_place_further_along_the_image_shows_in_where_the_object_turns():
    """Beyond the border that is left for it, points lie on the object's outline, and on what is behind it."""
    _, model = box()
    made = tip(0, seed=0)
    places = []
    for off in (-4e-3, 4e-3):
        seen_from = camera().T_world_camera.copy()
        seen_from[0, 3] += off
        motion, view, _ = print_motion(
            made.frames,
            replace(camera(), T_world_camera=seen_from),
            (model.vertices, model.faces),
            placement_of(made.planned),
            made.contact_ns,
        )
        places.append(view.camera.T_world_camera[:2, 3])
        frame = np.rint((motion.angle.time_ns - made.frames[0].time_ns) * 1e-9 * RATE_HZ).astype(int)
        moving = (made.theta[frame] > 0.02) & (made.theta[frame] < 1.5)
        error = np.degrees(motion.angle.theta - made.theta[frame])[moving]
        assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.linalg.norm(places[0] - places[1]) < 1e-3


def test_what_moves_about_another_line_does_not_tell_of_the_pose_at_rest():
    """A bevel has landed at 0.5 rad: from there on the body stands 8 px further."""
    _, model = box()
    made = tip(0, seed=0)
    frames = [
        replace(frame, image=np.roll(frame.image, 8, axis=1)) if theta > 0.5 else frame
        for frame, theta in zip(made.frames, made.theta, strict=True)
    ]
    shape, placement = (model.vertices, model.faces), placement_of(made.planned)

    def place(images, edge_left_rad):
        _, view, _ = print_motion(images, camera(), shape, placement, made.contact_ns, edge_left_rad)
        return view.camera.T_world_camera[:3, 3]

    right = place(made.frames, 0.5)
    assert np.linalg.norm(place(frames, 0.5) - right) < 3e-4
    assert np.linalg.norm(place(frames, math.inf) - right) > 1e-3
