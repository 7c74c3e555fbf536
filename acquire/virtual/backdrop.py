"""Static background of the virtual camera's images: a wooden table up to its far edge, and a wall."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.station import Station

FAR_EDGE_M = 0.55
"""y of the table's far edge in W [m]"""
_WALL_M = 1.4
"""y of the wall in W [m]"""
_TABLE, _WALL = 148.0, 92.0
"""mean grey levels of table and wall at the reference exposure"""
LIGHT_WORLD = np.array([-0.35, -0.55, 0.76]) / np.linalg.norm([-0.35, -0.55, 0.76])
"""(3,) unit vector from the scene to the lamp in W, the world frame: above and to the left of the camera"""


def backdrop(station: Station, width: int, height: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Grey levels (height, width), 10 to 215, of table and wall at the reference exposure.

    That is 1500 us at a gain of 0 dB. Blur, vignetting and noise are left out.

    Args:
        station: camera calibration and pose.
        width: image width [px].
        height: image height [px].
        rng: generator of the wood's and the wall's texture.
    """
    p, ray = station.T_world_camera[:3, 3], _rays(station, width, height)
    x_table, y_table = _on_plane(p, ray)
    on_table = np.clip((FAR_EDGE_M - y_table) / 0.01, 0.0, 1.0)
    step = (_WALL_M - p[1]) / ray[..., 1]
    x_wall, z_wall = p[0] + step * ray[..., 0], p[2] + step * ray[..., 2]
    # The grain runs along x; far away it is finer than a pixel and fades.
    fade = np.exp(-np.maximum(y_table, -0.3) / 0.35)
    warp = 0.006 * _lattice_noise(rng, x_table / 0.08, y_table / 0.05)
    grain = _lattice_noise(rng, x_table / 0.12, (y_table + warp) / 0.006) + 0.6 * _lattice_noise(
        rng, x_table / 0.04, (y_table + warp) / 0.0025
    )
    table = (
        _TABLE * (1.0 - 0.22 * np.clip(y_table, -0.3, 0.6)) * (1.0 + 0.035 * fade * grain)
        + 60.0 * x_table.clip(-0.3, 0.3) * -0.3
    )
    wall = _WALL + 45.0 * z_wall - 28.0 * x_wall + 3.0 * _lattice_noise(rng, x_wall / 0.11, z_wall / 0.09)
    near_wall = 1.0 - 0.25 * np.exp(-np.abs(z_wall + 0.05) / 0.02)
    image = on_table * table + (1.0 - on_table) * wall * near_wall
    return np.clip(image, 10.0, 215.0).astype(np.float32)


def table_cover(station: Station, width: int, height: int) -> NDArray[np.float32]:
    """Fraction (height, width) of each pixel of an image of width x height px that shows the table."""
    _, y_table = _on_plane(station.T_world_camera[:3, 3], _rays(station, width, height))
    return np.clip((FAR_EDGE_M - y_table) / 0.01, 0.0, 1.0).astype(np.float32)


def _rays(station: Station, width: int, height: int) -> NDArray[np.float64]:
    """Directions (height, width, 3) in W of the pixels' lines of sight."""
    pixels = (
        np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        .reshape(-1, 1, 2)
        .astype(np.float64)
    )
    rays = cv2.undistortPoints(pixels, station.K, station.distortion).reshape(height, width, 2)
    R = station.T_world_camera[:3, :3]
    return rays[..., 0, None] * R[:, 0] + rays[..., 1, None] * R[:, 1] + R[:, 2]


def _on_plane(
    p: NDArray[np.float64], ray: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """X and y (height, width) [m] at which lines of sight meet z = 0, at most 10 m away.

    Args:
        p: (3,) position of the camera in W [m].
        ray: (height, width, 3) directions of the lines of sight in W.
    """
    reach = np.where(ray[..., 2] < -1e-6, -p[2] / np.minimum(ray[..., 2], -1e-6), np.inf)
    y_table = np.minimum(p[1] + reach * ray[..., 1], 10.0)
    return np.clip(p[0] + reach * ray[..., 0], -10.0, 10.0), y_table


def _lattice_noise(
    rng: np.random.Generator, u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Smooth noise in -1..1, interpolated between random values at integer (u, v).

    It is value noise with K. Perlin's fade curve (2002), with period 64 in u and v.

    Args:
        rng: generator of the values at the integers.
        u: first coordinate, of any shape.
        v: second coordinate, of the shape of `u`.

    Returns:
        Noise of the shape of `u`.
    """
    lattice = rng.uniform(-1.0, 1.0, (64, 64))
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    s, t = u - i, v - j
    s, t = s**3 * (s * (6 * s - 15) + 10), t**3 * (t * (6 * t - 15) + 10)
    i0, i1, j0, j1 = i % 64, (i + 1) % 64, j % 64, (j + 1) % 64
    low = (1 - s) * lattice[i0, j0] + s * lattice[i1, j0]
    high = (1 - s) * lattice[i0, j1] + s * lattice[i1, j1]
    return (1 - t) * low + t * high
