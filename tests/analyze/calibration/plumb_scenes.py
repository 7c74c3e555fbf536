"""Images of strings that hang plumb over a table that slopes, independent of the estimator.

Lens formulas of their own; blur before the pixels add up. Models perspective, lens, strings of a width in
pixels, an uneven ground, a box with a tag-like square before it, blur, noise; no depth of field, no swinging.
Integer coordinates are pixel centres.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tests.analyze.calibration.boards import TrueLens

FINE = 4
LENS = TrueLens(656, 492, 1430.0, 1431.0, 330.5, 243.0, (-0.12, 0.10, 3e-4, -2e-4, 0.0))
WORLD_CAMERA = np.array([[1.0, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]])
"""(4, 4) pose of the nominal camera in W [m], which looks along y"""


@dataclass(frozen=True)
class Scene:
    """Appearance of strings and background: widths and blur [px], greys and noise [grey levels]."""

    width_px: float = 2.0
    string: float = 40.0
    ground: float = 170.0
    blur: float = 0.7
    noise: float = 4.0
    box: bool = False


def turned(pose, by):
    """Pose (4, 4) of the camera turned by the rotation vector `by` (3,) [rad] in W about its own centre."""
    T = pose.copy()
    T[:3, :3] = cv2.Rodrigues(np.asarray(by, float))[0] @ pose[:3, :3]
    return T


def photograph(strings, slope, rng, scene=None, pose=WORLD_CAMERA, lens=LENS):
    """Image (height, width), uint8, of strings through points (x, y) [m] of the table's plane in W.

    The vertical, along which they hang, leans by `slope` (2,) [rad] towards W's x and y.
    """
    scene = scene or Scene()
    cells, rows = np.arange(lens.width * FINE), np.arange(lens.height * FINE)[:, None]
    image = (scene.ground + 12.0 * np.sin(cells / (90.0 * FINE)) + 8.0 * np.cos(rows / (70.0 * FINE))).astype(
        np.float32
    )
    if scene.box:
        image[220 * FINE : 460 * FINE, 240 * FINE : 330 * FINE] = 120.0
        image[300 * FINE : 380 * FINE, 250 * FINE : 325 * FINE] = 205.0
        image[310 * FINE : 370 * FINE, 258 * FINE : 317 * FINE] = 30.0
        image[440 * FINE :, :] -= 40.0
    v = (np.arange(lens.height * FINE) + 0.5) / FINE - 0.5
    for x, y in strings:
        height = np.linspace(-0.3, 0.6, 4001)
        points = np.column_stack([x + slope[0] * height, y + slope[1] * height, height])
        seen = lens.project((points - pose[:3, 3]) @ pose[:3, :3])
        order = np.argsort(seen[:, 1])
        u = np.interp(v, seen[order, 1], seen[order, 0])
        left, right = ((u + side * scene.width_px / 2 + 0.5) * FINE for side in (-1, 1))
        band = slice(max(int(left.min()) - 1, 0), int(right.max()) + 2)
        share = np.clip(
            np.minimum(cells[band] + 1, right[:, None]) - np.maximum(cells[band], left[:, None]), 0, 1
        )
        image[:, band] += (share * (scene.string - image[:, band])).astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), scene.blur * FINE)
    image = image.reshape(lens.height, FINE, lens.width, FINE).mean(axis=(1, 3))
    return np.clip(np.round(image + rng.normal(0, scene.noise, image.shape)), 0, 255).astype(np.uint8)
