"""Strikes whose markers have no known place on the object: the followed point lies off the edge."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.motion.balance_fit import EdgeErrors, moment_balance
from analyze.motion.edge_motion import edge_motion
from analyze.motion.edge_offset import displacement_per_offset
from tests.analyze.motion.drawn_strikes import seen
from tests.analyze.motion.sliding import Body, push_for, simulate

OFFSETS = (np.array([8e-3, 5e-3]), np.array([-6e-3, 9e-3]))
"""offsets of the followed point from the edge, along and off the table [m]"""
HOP, HOP_SECONDS = 2e-4, 0.08
"""height [m] and duration [s] of the edge's hop after the impact"""


def hopping_strike(offset, place_sd):
    """A strike whose edge hops, seen by a point beside the edge; its body, and the frames to fit."""
    body = Body(friction=0.8, rho=0.001)
    course = simulate(body, [push_for(body, 1.2)])
    motion, _ = seen(course, body, np.random.default_rng(4), math.radians(0.01))
    along, up = (displacement_per_offset(motion.angle.theta) @ offset).T
    hop = HOP * np.sin(np.pi * np.clip(course.time / HOP_SECONDS, 0.0, 1.0)) ** 2
    angle = replace(motion.angle, slip=motion.angle.slip + along)
    motion = replace(motion, angle=angle, lift=motion.lift + up + hop, place_sd=place_sd)
    return motion, body, (33, int(np.argmax(course.theta > body.phi + math.radians(25))))


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_point_beside_a_hopping_edge_neither_slides_nor_lifts_nor_shifts_phi(offset):
    motion, body, window = hopping_strike(offset, None)
    found = edge_motion(motion, window)
    assert found.lift_range < HOP
    assert found.slide_range < 1.5e-3  # the edge itself slides by 1.1 mm
    errors = EdgeErrors(found.offset_covariance, found.by_radius)
    fit = moment_balance(found.motion, window, body.rho, None, errors)
    assert abs(fit.phi - body.phi) < math.radians(0.02)


def test_a_point_with_a_known_place_that_rises_by_millimetres_has_lifted():
    motion, _, window = hopping_strike(OFFSETS[0], 5e-4)
    assert edge_motion(motion, window).lift_range > 2e-3


def test_a_strike_without_a_frame_to_fit_keeps_the_offset_it_came_with():
    motion, _, _ = hopping_strike(OFFSETS[0], None)
    found = edge_motion(motion, (33, 33))
    assert np.isfinite(found.offset_covariance).all()
