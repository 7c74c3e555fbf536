"""Corners of a black square to a few hundredths of a pixel: each edge is fitted to the grey values of the pixels along it.

Model of one edge: I = black + (white - black) * Phi(d / s), with d the signed distance of a pixel's centre from the edge line in ideal
(distortion-free) coordinates, Phi the normal distribution function, s the blur. Five numbers per edge (position, direction, black,
white, s) are fitted by Gauss-Newton to the raw pixels: nothing is interpolated, so nothing is biased towards pixel centres and the
noise of neighbouring samples stays independent, which makes the covariance honest. Corners are intersections of neighbouring edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.tracking.camera_model import PixelMap
    from analyze.types import Array

_HALF_BAND = 4
"""rows (or columns) taken on either side of the edge"""
_REACH_PX = 2.6
"""pixels farther than this from the edge carry no information on its place"""
_END_MARGIN_PX = 2.6
"""stretch left out at each end, where the blurred corner bends the edge"""
_END_MARGIN_BLURS = 3.4
"""the same in units of the blur, where that is more: at s = 2 px it costs 0.008 px otherwise"""
_CONVERGED_PX = 0.02
"""Gauss-Newton converges quadratically: after a step this small the rest is below 0.001 px"""
_CONVERGED_BLUR_PX = 0.1
"""of s, which the covariance hangs on: left at half its size it makes the sd half as large as the errors"""
_RESTART_PX = 0.6
"""px; a start farther off than this is worth a second fit"""
_INVERSE_SQRT_2PI = 1.0 / math.sqrt(2.0 * math.pi)


@dataclass(frozen=True)
class Square:
    """Corners in ideal pixels with what their uncertainty is."""

    corners: Array
    """(4, 2) ideal px, in the order given"""
    covariance: Array
    """(4, 2, 2) px^2, each corner's own"""
    sd: float
    """px, root mean square over corners and axes"""
    contrast: float
    """grey levels between inside and outside, the weakest edge"""
    noise: float
    """grey levels, 1 sigma of the residuals"""
    blur: float
    """px, mean s"""


def fit_square(image: NDArray[np.uint8], pixels: PixelMap, corners_ideal: Array, corners_raw: Array, iterations: int = 8) -> Square | None:
    """Refine a dark square's corners.

    Args:
        image: (height, width) grey values.
        pixels: ideal coordinates of the pixel centres.
        corners_ideal: (4, 2) start, ideal px, within about 2 px, in either sense of rotation.
        corners_raw: (4, 2) the same in raw px.
        iterations: most Gauss-Newton steps; two or three are the rule.

    Returns:
        The square, or None where an edge leaves the image, is too short, or does not look like one.
    """
    square = _fit_once(image, pixels, corners_ideal, corners_raw, iterations, _END_MARGIN_PX)
    if square is None:
        return None
    moved = square.corners - corners_ideal
    margin = max(_END_MARGIN_PX, _END_MARGIN_BLURS * square.blur)
    if float(np.max(np.abs(moved))) < _RESTART_PX and margin < 1.3 * _END_MARGIN_PX:
        return square
    # The band of pixels was laid around a poor start and may miss part of the edge, or the blur is larger than thought.
    return _fit_once(image, pixels, square.corners, corners_raw + moved, iterations, margin)


def _fit_once(
    image: NDArray[np.uint8], pixels: PixelMap, corners_ideal: Array, corners_raw: Array, iterations: int, end_margin: float
) -> Square | None:
    samples = _pixels_along(image, pixels, corners_raw)
    if samples is None:
        return None
    grey, points, valid = samples
    start = corners_ideal
    along = np.roll(start, -1, axis=0) - start
    length = np.hypot(along[:, 0], along[:, 1])
    along /= length[:, None]
    area = 0.5 * float(np.sum(start[:, 0] * np.roll(start[:, 1], -1) - np.roll(start[:, 0], -1) * start[:, 1]))
    # y points down: a positive area is clockwise on the screen, and (dy, -dx) points out of the square.
    outward = np.stack([along[:, 1], -along[:, 0]], axis=-1) * np.sign(area)
    middle = 0.5 * (start + np.roll(start, -1, axis=0))
    offset = points - middle[:, None, :]
    u = np.einsum("esc,ec->es", offset, along)
    v = np.einsum("esc,ec->es", offset, outward)
    half = 0.5 * length[:, None]
    cell = np.min(length) / 8.0
    inner = min(_REACH_PX, 0.8 * cell)
    outer = min(_REACH_PX, 0.7 * cell)
    valid &= np.abs(u) < half - min(end_margin, cell)
    t = u / half
    # a, b: line v = a + b t; then black, white, s
    parameters = np.zeros((4, 5))
    parameters[:, 4] = 0.8
    far_in, far_out = valid & (v < -1.2) & (v > -inner - 1.0), valid & (v > 1.2) & (v < outer + 1.0)
    if min(far_in.sum(axis=1).min(), far_out.sum(axis=1).min()) < 4:
        return None
    parameters[:, 2] = np.sum(grey * far_in, axis=1) / far_in.sum(axis=1)
    parameters[:, 3] = np.sum(grey * far_out, axis=1) / far_out.sum(axis=1)
    if np.min(parameters[:, 3] - parameters[:, 2]) < 12.0:
        return None
    step, normal = np.full((4, 5), np.inf), np.zeros((4, 5, 5))
    weight, remaining = np.zeros(4), np.zeros(4)
    for _ in range(iterations):
        normal, gradient, weight, squares = _normal_equations(parameters, t, v, grey, valid, (inner, outer))
        try:
            step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return None
        # The sum is of before this step; what the step takes off it is known, because the model is as good as linear there.
        remaining = squares - np.einsum("ep,ep->e", gradient, step)
        step[:, :2] = np.clip(step[:, :2], -1.2, 1.2)
        step[:, 4] = np.clip(step[:, 4], -0.3, 0.5)
        parameters += step
        parameters[:, 4] = np.clip(parameters[:, 4], 0.25, 3.0)
        if np.max(np.abs(step[:, :2])) < _CONVERGED_PX and np.max(np.abs(step[:, 4])) < _CONVERGED_BLUR_PX:
            break
    if float(np.max(np.abs(step[:, :2]))) > 0.3 or np.max(np.abs(parameters[:, :2])) > _HALF_BAND:
        return None
    variance = np.maximum(remaining, 0.0) / np.maximum(weight - 5.0, 1.0)
    covariance_line = np.linalg.inv(normal)[:, :2, :2] * variance[:, None, None]
    corners, covariance = _intersect(middle, along, outward, half[:, 0], parameters[:, :2], covariance_line)
    contrast = float(np.min(parameters[:, 3] - parameters[:, 2]))
    sd = math.sqrt(float(np.mean(np.trace(covariance, axis1=1, axis2=2))) / 2.0)
    if not math.isfinite(sd) or contrast < 12.0:
        return None
    return Square(corners, covariance, sd, contrast, math.sqrt(float(np.mean(variance))), float(np.mean(parameters[:, 4])))


def _normal_equations(
    parameters: Array, t: Array, v: Array, grey: Array, valid: NDArray[np.bool_], reach: tuple[float, float]
) -> tuple[Array, Array, Array, Array]:
    a, b, black, white, s = (parameters[:, i, None] for i in range(5))
    d = v - a - b * t
    weight = (valid & (d > -reach[0]) & (d < reach[1])).astype(float)
    z = d / s
    level = ndtr(z) * weight
    # Rows are derivatives of the model by a, b, black, white, s; the last one is the residual.
    rows = np.empty((4, 6, t.shape[1]))
    np.multiply(np.exp(-0.5 * z * z) * weight, (black - white) * _INVERSE_SQRT_2PI / s, out=rows[:, 0])
    np.multiply(rows[:, 0], t, out=rows[:, 1])
    np.subtract(weight, level, out=rows[:, 2])
    rows[:, 3] = level
    np.multiply(rows[:, 0], z, out=rows[:, 4])
    rows[:, 5] = (grey - black) * weight - (white - black) * level
    products = rows @ rows.transpose(0, 2, 1)
    return products[:, :5, :5], products[:, :5, 5], weight.sum(axis=1), products[:, 5, 5]


def _pixels_along(image: NDArray[np.uint8], pixels: PixelMap, corners_raw: Array) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """Grey values (4, s), ideal coordinates (4, s, 2) and validity (4, s) of the raw pixels in a band along each edge."""
    height, width = image.shape
    start, stop = corners_raw, np.roll(corners_raw, -1, axis=0)
    delta = stop - start
    steep = np.abs(delta[:, 1]) > np.abs(delta[:, 0])
    major = np.where(steep, 1, 0)
    edge = np.arange(4)
    low = np.minimum(start[edge, major], stop[edge, major])
    high = np.maximum(start[edge, major], stop[edge, major])
    if np.min(high - low) < 6.0 or np.max(high - low) > 2000.0:
        return None
    first = np.ceil(low).astype(int)
    count = np.floor(high).astype(int) - first + 1
    along = first[:, None] + np.arange(int(count.max()))
    slope = delta[edge, 1 - major] / delta[edge, major]
    across = start[edge, 1 - major][:, None] + slope[:, None] * (along - start[edge, major][:, None])
    across_px = np.rint(across).astype(int)[:, :, None] + np.arange(-_HALF_BAND, _HALF_BAND + 1)
    along_px = np.broadcast_to(along[:, :, None], across_px.shape)
    columns = np.where(steep[:, None, None], across_px, along_px).reshape(4, -1)
    rows = np.where(steep[:, None, None], along_px, across_px).reshape(4, -1)
    used = np.broadcast_to((along <= np.floor(high)[:, None])[:, :, None], across_px.shape).reshape(4, -1)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    if np.any(inside.sum(axis=1) < 0.9 * used.sum(axis=1)):
        return None
    index = np.clip(rows, 0, height - 1) * width + np.clip(columns, 0, width - 1)
    return image.reshape(-1)[index].astype(float), pixels.ideal.reshape(-1, 2)[index], used & inside


def _intersect(middle: Array, along: Array, outward: Array, half: Array, line: Array, covariance: Array) -> tuple[Array, Array]:
    """Corner i = edge i-1 x edge i, with covariance (4, 2, 2) from both lines' (a, b)."""
    point = middle + line[:, :1] * outward
    direction = along + (line[:, 1] / half)[:, None] * outward
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    level = np.einsum("ec,ec->e", normal, point)
    matrix = np.stack([np.roll(normal, 1, axis=0), normal], axis=1)
    inverse = np.linalg.inv(matrix)
    corners = np.einsum("eij,ej->ei", inverse, np.stack([np.roll(level, 1), level], axis=-1))
    # Offsets of the two lines at the corner: a + b t with t = +1 on the incoming edge, -1 on the outgoing one.
    end = covariance[:, 0, 0] + 2 * covariance[:, 0, 1] + covariance[:, 1, 1]
    begin = covariance[:, 0, 0] - 2 * covariance[:, 0, 1] + covariance[:, 1, 1]
    variance = np.stack([np.roll(end, 1), begin], axis=-1)
    return corners, np.einsum("eij,ej,ekj->eik", inverse, variance, inverse)
