"""Pictures of the mat on a table, as a phone would take them, for tests and the benchmark of the mat.

The mat is what its PDF paints: the black areas are read from the file's drawing commands. A ray is cast
through the parts of every pixel, through a lens with radial distortion, onto a sheet that may be curled and
not to scale, a box on it, and hands in front; blur, vignetting and noise follow. Nothing of it is shared with
the estimator, nor does it know where the layout puts the tags.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cache

import cv2
import numpy as np

from analyze.tags.mat import mat
from analyze.tags.mat_pages import mat_pages
from analyze.tags.pdf import pdf_bytes
from analyze.types import CameraModel
from tests.analyze.tags.painted import PX_PER_MM, painted

WHITE, BLACK, TABLE, BOX, HAND = 215.0, 28.0, 120.0, 150.0, 175.0


@dataclass(frozen=True)
class Phone:
    """Camera: image size [px], focal length [px], radial distortion, blur [px] and noise [grey levels]."""

    width: int = 800
    height: int = 450
    focal: float = 775.0
    k1: float = 0.06
    blur: float = 0.8
    noise: float = 1.5
    parts: int = 3
    """parts of a pixel along each side through which a ray is cast"""

    @property
    def lens(self) -> CameraModel:
        """The lens as a calibration states it."""
        K = np.array(
            [[self.focal, 0, self.width / 2 + 2.0], [0, self.focal, self.height / 2 - 3.0], [0, 0, 1]]
        )
        return CameraModel(self.width, self.height, K, np.array([self.k1, 0, 0, 0, 0]), np.eye(4))


@dataclass(frozen=True)
class Paper:
    """Print and paper: scale, height of the sheet as a sum of waves, places of glued sheets."""

    scale: float = 1.0
    waves: tuple[tuple[float, float, float, float], ...] = ()
    """amplitude [m], wave vector (x, y) [1/m], phase"""
    glued: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * 3
    """shift x, y [m] and turn [rad] of each sheet about its middle"""

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Height of the paper over the table [m]."""
        z = np.zeros_like(x)
        for amplitude, kx, ky, phase in self.waves:
            z += amplitude * np.sin(kx * x + ky * y + phase)
        return z


@dataclass(frozen=True)
class Scene:
    """What lies on the table: mat, box, hands."""

    paper: str = "A4"
    print_: Paper = field(default_factory=Paper)
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """least and largest corner [m]"""
    hands: tuple[tuple[float, float, float, float], ...] = ()
    """ellipses in the image: middle and half sizes [px]"""


def random_paper(random: np.random.Generator, flatness: float = 1.5e-4, scale_sd: float = 1e-3) -> Paper:
    """Paper as it is taped by hand: curled with this sd of its height [m], of a scale that was checked."""
    waves = []
    for _ in range(4):
        long, about = random.uniform(0.1, 0.3), random.uniform(0, math.tau)
        k = math.tau / long
        waves.append(
            (flatness / math.sqrt(2), k * math.cos(about), k * math.sin(about), random.uniform(0, math.tau))
        )
    glued = [(*random.normal(0, 0.7e-3, 2), random.normal(0, math.radians(0.2))) for _ in range(3)]
    glued[1] = (0.0, 0.0, 0.0)
    return Paper(1 + random.normal(0, scale_sd), tuple(waves), tuple(glued))


def looking(eye: np.ndarray, at: np.ndarray, roll: float = 0.0) -> np.ndarray:
    """Pose (4, 4) in the world of a camera at `eye` [m] that looks at a point, rolled by an angle [rad]."""
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = math.cos(roll), math.sin(roll)
    T = np.eye(4)
    T[:3, :3] = np.stack([c * right + s * down, c * down - s * right, forward], axis=1)
    T[:3, 3] = eye
    return T


def random_view(random: np.random.Generator) -> np.ndarray:
    """Pose (4, 4) of a phone that stands about where a strike is filmed from."""
    distance, elevation = random.uniform(0.33, 0.52), math.radians(random.uniform(17, 42))
    about = math.radians(random.uniform(-14, 14))
    at = np.array([random.normal(0, 0.012), random.normal(0, 0.01), random.uniform(0.0, 0.04)])
    flat = distance * math.cos(elevation)
    high = distance * math.sin(elevation)
    eye = at + np.array([flat * math.sin(about), -flat * math.cos(about), high])
    return looking(eye, at, random.normal(0, math.radians(2.0)))


def bumped(T: np.ndarray, random: np.random.Generator, distance: float, turn: float) -> np.ndarray:
    """Pose of a camera shifted by a distance [m] and turned by an angle [rad], in random directions."""
    shift, axis = random.standard_normal((2, 3))
    moved = T.copy()
    moved[:3, 3] += distance * shift / np.linalg.norm(shift)
    moved[:3, :3] = cv2.Rodrigues(turn * axis / np.linalg.norm(axis))[0] @ moved[:3, :3]
    return moved


@cache
def _sheets(paper: str) -> list[np.ndarray]:
    """Pages of the mat as their PDF paints them, white 255, row 0 at the top."""
    return [image for image, _ in painted(pdf_bytes(mat_pages(mat(paper))))]


def picture(phone: Phone, T: np.ndarray, scene: Scene, random: np.random.Generator) -> np.ndarray:
    """Image (height, width) of the scene by a phone at a pose (4, 4)."""
    return noisy(phone, drawn(phone, T, scene), random)


def noisy(phone: Phone, light: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Image (height, width) by a phone, with its noise, of the light (height, width) that reaches it."""
    return np.clip(np.rint(light + random.normal(0, phone.noise, light.shape)), 0, 255).astype(np.uint8)


def drawn(phone: Phone, T: np.ndarray, scene: Scene) -> np.ndarray:
    """Light (height, width) that reaches a phone at a pose (4, 4), in grey levels."""
    rays = _rays(phone) @ T[:3, :3].T.astype(np.float32)
    eye = T[:3, 3].astype(np.float32)
    grey = _table(scene, eye, rays)
    if scene.box is not None:
        _draw_box(grey, scene.box, eye, rays)
    image = grey.reshape(phone.height, phone.parts, phone.width, phone.parts).mean(axis=(1, 3))
    for x, y, wide, high in scene.hands:
        cv2.ellipse(image, ((x, y), (2 * wide, 2 * high), 20.0), HAND, -1, cv2.LINE_AA)
    image = cv2.GaussianBlur(image, (0, 0), phone.blur)
    row, column = np.mgrid[: phone.height, : phone.width]
    radius = np.hypot(row - phone.height / 2, column - phone.width / 2) / (phone.width / 2)
    return image * (1 - 0.15 * radius**2)


@cache
def _rays(phone: Phone) -> np.ndarray:
    """Directions (n, 3) of the parts of all pixels in the camera's frame, by fixed-point iteration."""
    K = phone.lens.K
    x = (np.arange(phone.width * phone.parts) + 0.5) / phone.parts - 0.5
    y = (np.arange(phone.height * phone.parts) + 0.5) / phone.parts - 0.5
    grid = np.stack(np.meshgrid((x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1]), axis=-1).astype(np.float32)
    ideal = grid.copy()
    for _ in range(12):
        ideal = grid / (1 + phone.k1 * np.sum(ideal**2, axis=-1, keepdims=True))
    return np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=-1).reshape(-1, 3)


def _table(scene: Scene, eye: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Grey value (n,) of the table and the mat at which each ray ends."""
    down = np.minimum(rays[:, 2], -1e-4)
    z = np.zeros(len(rays), np.float32)
    for _ in range(3 if scene.print_.waves else 1):
        along = (z - eye[2]) / down
        x, y = eye[0] + along * rays[:, 0], eye[1] + along * rays[:, 1]
        z = scene.print_.height(x, y).astype(np.float32)
    grey = np.where(rays[:, 2] < -1e-4, TABLE + 12 * np.sin(90 * x) * np.sin(140 * y), 90.0).astype(
        np.float32
    )
    layout = mat(scene.paper)
    order = [1, 0, 2] if len(layout.middles) == 3 else [0]
    for sheet in order:
        texture, (dx, dy, turn) = (
            _sheets(scene.paper)[sheet],
            scene.print_.glued[sheet if len(order) > 1 else 1],
        )
        middle = layout.middles[sheet] / 1000
        low, high = layout.width / 2000, layout.height / 2000
        u, v = x / scene.print_.scale - middle - dx, y / scene.print_.scale - dy
        c, s = math.cos(turn), math.sin(turn)
        u, v = c * u + s * v, c * v - s * u
        left = -low if sheet == 0 else -0.093 if len(order) > 1 and sheet == 2 else -low
        right = 0.093 if len(order) > 1 and sheet == 0 else low
        inside = (u > left) & (u < right) & (np.abs(v) < high)
        column = ((u[inside] + low) * 1000 * PX_PER_MM - 0.5).astype(np.float32)
        row = ((high - v[inside]) * 1000 * PX_PER_MM - 0.5).astype(np.float32)
        grey[inside] = _sampled(texture, column, row)
    return grey


def _sampled(texture: np.ndarray, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Grey values (n,) of the paper at places (n,), (n,) [px of the texture]."""
    wide = 4096
    pad = -len(column) % wide
    maps = [np.pad(each, (0, pad)).reshape(-1, wide) for each in (column, row)]
    ink = np.concatenate(
        [
            cv2.remap(
                texture, maps[0][at : at + 8192], maps[1][at : at + 8192], cv2.INTER_LINEAR, borderValue=255
            )
            for at in range(0, len(maps[0]), 8192)
        ]
    ).ravel()[: len(column)]
    return BLACK + (WHITE - BLACK) * ink.astype(np.float32) / 255


def _draw_box(grey: np.ndarray, box: tuple, eye: np.ndarray, rays: np.ndarray) -> None:
    """Draw an upright box, and its shadow's edge, over the grey values (n,)."""
    with np.errstate(divide="ignore"):
        ends = (np.array(box, np.float32)[:, None, :] - eye) / rays
    near, far = np.minimum(*ends), np.maximum(*ends)
    entry, exit_ = near.max(axis=1), far.min(axis=1)
    hit = (entry < exit_) & (entry > 0)
    face = near[hit].argmax(axis=1)
    grey[hit] = np.array([BOX - 40, BOX, BOX + 45], np.float32)[face]


def half_hidden(
    scene: Scene, phone: Phone, T: np.ndarray, random: np.random.Generator, share: float
) -> Scene:
    """Scene with hands in front of about this share of the mat's tags (at most half)."""
    tags = mat(scene.paper).tags
    hidden = random.permutation(len(tags))[: math.floor(share * len(tags))]
    hands = []
    for number in hidden.tolist():
        tag = tags[number]
        point = T[:3, :3].T @ (np.array([tag.x / 1000, tag.y / 1000, 0]) - T[:3, 3])
        px = phone.lens.K @ point / point[2]
        size = 0.4 * phone.focal * tag.width / 1000 / point[2]
        hands.append((float(px[0]), float(px[1]), size, size))
    return replace(scene, hands=tuple(hands))
