"""Check of a placement before its strike, on drawn boxes before a wall and on a table."""

import cv2
import numpy as np
import pytest

from analyze.tracking.placed_outline import Surroundings
from analyze.types import CameraModel

HEIGHT, WIDTH, PX_PER_M = 400, 600, 1500.0
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
RNG = np.random.default_rng(5)


def camera() -> CameraModel:
    """Half a metre before the origin, looking along W's y."""
    K = np.array([[750.0, 0, WIDTH / 2], [0, 750.0, 300], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    pose[:3, 3] = [0.0, -0.5, 0.0]
    return CameraModel(WIDTH, HEIGHT, K, np.zeros(5), pose)


def card(width: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A standing rectangle at the origin [m]."""
    return np.array([[-1, 0, 0], [1, 0, 0], [1, 0, 1], [-1, 0, 1]]) * [width / 2, 1, height], TRIANGLES


def scene(texture: float) -> np.ndarray:
    """Wall with a texture of given strength, and a table."""
    coarse = np.random.default_rng(1).normal(110, texture, (HEIGHT // 8, WIDTH // 8)).astype(np.float32)
    image = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    image[300:] += 40
    return image


def filmed(surroundings: np.ndarray, width: float, height: float, shadow: float = 1.0) -> np.ndarray:
    """Image of a printed rectangle, with its shadow on the right, and noise."""
    image = surroundings.copy()
    half, up = round(width / 2 * PX_PER_M), round(height * PX_PER_M)
    left, right = WIDTH // 2 - half, WIDTH // 2 + half
    image[300 - up // 2 : 340, right : right + 80] *= shadow
    image[300 - up : 300, left:right] = 150
    for row in range(300 - up + 12, 290, 24):
        image[row : row + 12, left + 10 : right - 10 : 3] = 60
    return image + RNG.normal(0, 1, image.shape).astype(np.float32)


@pytest.mark.parametrize("texture", [0.0, 12.0])
@pytest.mark.parametrize(
    ("lies", "planned", "found"),
    [
        ((0.07, 0.10), (0.07, 0.10), False),
        ((0.10, 0.06), (0.10, 0.06), False),
        ((0.07, 0.13), (0.07, 0.10), True),
        ((0.07, 0.06), (0.07, 0.10), True),
        ((0.13, 0.07), (0.07, 0.13), True),
    ],
)
def test_another_outline_is_found_where_the_surroundings_are_known(texture, lies, planned, found):
    known = Surroundings()
    wall = scene(texture)
    known.add(filmed(wall, 0.14, 0.04), camera(), card(0.14, 0.04))
    assert known.contradict(filmed(wall, *lies), camera(), card(*planned)) is found


def test_nothing_is_said_of_surroundings_that_are_not_known():
    assert not Surroundings().contradict(filmed(scene(12.0), 0.1, 0.1), camera(), card(0.05, 0.05))
    known = Surroundings()
    known.add(filmed(scene(12.0), 0.13, 0.13), camera(), card(0.13, 0.13))
    assert not known.contradict(filmed(scene(12.0), 0.06, 0.06), camera(), card(0.10, 0.10))


@pytest.mark.parametrize("texture", [0.0, 12.0])
def test_shadow_and_light_do_not_count(texture):
    known = Surroundings()
    wall = scene(texture)
    known.add(filmed(wall, 0.14, 0.04, 0.6), camera(), card(0.14, 0.04))
    image = 0.9 * filmed(wall, 0.07, 0.10, 0.6)
    assert not known.contradict(image, camera(), card(0.07, 0.10))


def test_nothing_is_said_after_the_camera_was_moved():
    known = Surroundings()
    known.add(filmed(scene(12.0), 0.14, 0.04), camera(), card(0.14, 0.04))
    image = np.roll(filmed(scene(12.0), 0.07, 0.10), 30, axis=1)
    assert not known.contradict(image, camera(), card(0.07, 0.10))
