"""A bumped camera is noticed by the background, a tipping object or a plain wall is not mistaken for one."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from analyze.importing.mat_cameras import MatWatch
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.seen_tips import WatchedImages
from analyze.sources.source import TimedImage
from analyze.tracking.camera_motion import camera_shift
from analyze.types import CameraModel
from tests.analyze.importing.tip_videos import REST, setting, tip, write_video


def scene(seed: int = 1, spread: float = 25.0) -> np.ndarray:
    """(360, 640) image of a rough table and wall."""
    coarse = np.random.default_rng(seed).normal(120, spread, (45, 80)).clip(0, 255).astype(np.uint8)
    return cv2.resize(coarse, (640, 360), interpolation=cv2.INTER_CUBIC)


def moved(image: np.ndarray, shift: tuple[float, float], turn: float = 0.0) -> np.ndarray:
    M = cv2.getRotationMatrix2D((320, 180), np.degrees(turn), 1.0)
    M[:, 2] += shift
    return cv2.warpAffine(image, M, (640, 360), borderMode=cv2.BORDER_REFLECT)


def noisy(image: np.ndarray, seed: int) -> np.ndarray:
    return np.clip(image + np.random.default_rng(seed).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def with_object(image: np.ndarray, angle: float) -> np.ndarray:
    """Image with a large printed box in front, turned by an angle [rad]."""
    box = scene(5, 60.0)[:200, :120]
    M = cv2.getRotationMatrix2D((60, 100), np.degrees(angle), 1.0)
    M[:, 2] += [260, 120]
    mask = cv2.warpAffine(np.full_like(box, 255), M, (640, 360))
    return np.where(mask > 127, cv2.warpAffine(box, M, (640, 360)), image)


@pytest.mark.parametrize(("shift", "turn"), [((6.0, 0.0), 0.0), ((1.0, -2.0), 0.0), ((0.0, 0.0), 0.01)])
def test_bump_is_found(shift, turn):
    before = with_object(scene(), 0.0)
    after = with_object(moved(scene(), shift, turn), 0.6)
    found = camera_shift(noisy(before, 1), noisy(after, 2))
    assert found is not None
    if turn:
        assert abs(found.turn) == pytest.approx(turn, rel=0.2)
    else:
        assert found.pixels == pytest.approx(np.hypot(*shift), abs=0.4)


def test_tipping_object_before_a_still_background_is_no_bump():
    found = camera_shift(noisy(with_object(scene(), 0.0), 1), noisy(with_object(scene(), -1.2), 2))
    assert found is None


def test_background_that_shows_nothing_gives_no_answer():
    plain = np.full((360, 640), 120, np.uint8)
    assert camera_shift(with_object(plain, 0.0), with_object(plain, -1.0)) is None
    assert camera_shift(noisy(with_object(plain, 0.0), 1), noisy(with_object(plain, -1.0), 2)) is None


def test_camera_that_is_bumped_in_a_strike_or_between_strikes_is_reported(tmp_path):
    def filmed(name: str, before: tuple[float, float], after: tuple[float, float]) -> Path:
        """Video of a tip before a rough background, which shifts from `before` to `after` in the tip."""
        ground = [cv2.resize(moved(scene(), shift), (320, 240)) for shift in (before, after)]
        images = [
            np.where(np.abs(image.astype(int) - 120) < 2, ground[number > REST + 20], image)
            for number, image in enumerate(tip())
        ]
        return write_video(tmp_path / name, images, crf="10")

    paths = (
        filmed("a.mp4", (0, 0), (0, 0)),
        filmed("b.mp4", (0, 0), (8, 0)),
        filmed("c.mp4", (9, 6), (9, 6)),
    )
    files = setting(tmp_path, ("s1", "s2", "s3"), placed=False)
    with prepare(ImportOptions(paths, *files)) as prepared:
        during, between = (line for line in prepared.remarks() if "the camera" in line)
    assert during.startswith("b.mp4: the camera moved by 4.")
    assert between.startswith("c.mp4: the camera stood otherwise than in a.mp4, by up to ")


@pytest.mark.parametrize("returns", [True, False])
def test_shake_that_returns_is_reported_like_one_that_stays(returns):
    aside = moved(scene(), (3.0, 0.0))
    images = [scene()] * 40 + [aside] * 40 + [scene() if returns else aside] * 20
    lens = CameraModel(
        640, 360, np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]]), np.zeros(5), np.eye(4)
    )
    watched = WatchedImages(
        [TimedImage(number, noisy(image, number)) for number, image in enumerate(images)],
        MatWatch(lens, None, None),
    )
    assert len(list(watched.frames())) == len(images)
    assert watched.shift_px == pytest.approx(3.0, abs=0.4)


def test_shake_of_a_camera_before_which_no_tip_is_found_is_reported(tmp_path):
    def shaken(number: int, image: np.ndarray) -> np.ndarray:
        sway = 5 * np.sin(0.3 * number)
        ground = cv2.resize(moved(scene(), (2 * sway, 0.0)), (320, 240))
        box = np.roll(image, round(sway), axis=1)
        return np.where(np.abs(box.astype(int) - 120) < 2, ground, box)

    paths = (
        write_video(tmp_path / "s1.mp4", tip(), crf="10"),
        write_video(tmp_path / "s2.mp4", [shaken(*each) for each in enumerate(tip())], crf="10"),
    )
    with prepare(ImportOptions(paths, *setting(tmp_path, ("s1", "s2")))) as prepared:
        assert prepared.windows[1].onset is None
        assert any(line.startswith("s2.mp4: the camera moved by ") for line in prepared.remarks())
