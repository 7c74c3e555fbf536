"""Outline by motion: drawn boxes that turn in the image, as planned, larger, smaller, with an arm beside."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
import pytest

from analyze.motion.print_motion import MAX_BEYOND, MAX_MISSING
from analyze.tracking.print_follower import PrintFollower
from analyze.tracking.print_outline import OutlineMisfit, outline_misfit
from analyze.types import CameraModel

WIDTH, HEIGHT, FOCAL, AWAY = 640, 480, 1200.0, 0.5
PIVOT = np.array([380.0, 400.0])
"""place about which the box turns in the image: its lower right corner [px]"""
PLANNED = np.array([180.0, 200.0])
"""width and height of the planned box in the image [px]"""


class TurnInTheImage:
    """Motion about the line of sight: points are kept as pixels."""

    def on_main_face(self, pixels: np.ndarray) -> np.ndarray:
        return pixels

    def moved(self, x: np.ndarray, points: np.ndarray) -> np.ndarray:
        c, s = np.cos(x[0]), np.sin(x[0])
        return (points - PIVOT) @ np.array([[c, s], [-s, c]]) + PIVOT


def drawn(size: np.ndarray, theta: float, *, wall: bool, arm: bool, can: bool = False) -> np.ndarray:
    """Image of a printed box of a size [px] at an angle [rad], or of a can with pale print."""
    random = np.random.default_rng(4)
    image = np.full((HEIGHT, WIDTH), 90, np.float32)
    if wall:
        image += 30 * cv2.GaussianBlur(random.normal(size=image.shape), (0, 0), 3) / 0.1
    if arm and theta:
        image[100:400, 140:185] = 20
    box = np.full((HEIGHT, WIDTH), 150, np.float32)
    for corner in random.uniform([0, 0], [WIDTH, HEIGHT], (300, 2)).astype(int):
        cv2.rectangle(box, corner.tolist(), (corner + 14).tolist(), float(random.uniform(40, 230)), -1)
    low = (PIVOT - size).astype(int)
    if can:
        around = np.clip(2 * (np.arange(WIDTH) - low[0]) / size[0] - 1, -1, 1)
        shade = around * np.cos(theta - 1.2) * 0.8 + np.sqrt(1 - around**2) * 0.6
        box = (70 + 90 * shade + 0.1 * (box - 150)).astype(np.float32)
    mask = np.zeros_like(image)
    mask[low[1] : int(PIVOT[1]), low[0] : int(PIVOT[0])] = 1.0
    turn = cv2.getRotationMatrix2D(PIVOT.tolist(), -np.degrees(theta), 1.0)
    box, mask = (cv2.warpAffine(each, turn, (WIDTH, HEIGHT)) for each in (box, mask))
    image = mask * box + (1 - mask) * image
    return (image + random.normal(0, 1.5, image.shape)).astype(np.float32)


def misfit(size: np.ndarray, *, wall: bool = True, arm: bool = False, can: bool = False) -> OutlineMisfit:
    """Misfit of the planned box to images of a box of another size [px]."""
    K = np.array([[FOCAL, 0, WIDTH / 2 - 0.5], [0, FOCAL, HEIGHT / 2 - 0.5], [0, 0, 1]])
    camera = CameraModel(WIDTH, HEIGHT, K, np.zeros(5), np.eye(4))
    corners = PIVOT - PLANNED * [[0, 0], [1, 0], [1, 1], [0, 1]]
    vertices = np.column_stack([(corners - K[:2, 2]) / FOCAL * AWAY, np.full(4, AWAY)])
    placed = vertices, np.array([[0, 1, 2], [0, 2, 3]])
    rest = drawn(size, 0.0, wall=wall, arm=arm, can=can)
    angles = np.radians([10, 15, 20, 25, 30, 36, 42, 48])
    moving = [
        (drawn(size, angle, wall=wall, arm=arm, can=can), np.array([angle, 0, 0, 0, 0, 0.0]))
        for angle in angles
    ]
    return outline_misfit(cast("PrintFollower", TurnInTheImage()), camera, placed, rest, moving)


@pytest.mark.parametrize("wall", [True, False])
@pytest.mark.parametrize("arm", [False, True])
def test_the_right_box_fits_beside_an_arm_and_before_any_wall(wall, arm):
    assert misfit(PLANNED, wall=wall, arm=arm).worst < MAX_MISSING / 2


@pytest.mark.parametrize("wall", [True, False])
@pytest.mark.parametrize("factor", [(1.3, 1.0), (1.0, 1.3), (1.25, 1.25)])
def test_a_larger_box_moves_beyond_the_outline(wall, factor):
    found = misfit(PLANNED * factor, wall=wall)
    assert found.beyond > 1.5 * MAX_BEYOND
    assert found.missing < MAX_MISSING / 2


@pytest.mark.parametrize("factor", [(0.6, 1.0), (1.0, 0.7)])
def test_a_smaller_box_leaves_the_wall_within_the_outline(factor):
    found = misfit(PLANNED * factor)
    assert found.missing > MAX_MISSING
    assert found.beyond < MAX_BEYOND / 2


def test_shades_of_a_can_that_stay_with_the_light_do_not_count():
    assert misfit(PLANNED, wall=False, can=True).worst < MAX_MISSING / 2
