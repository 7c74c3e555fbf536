"""Corners of a black square to a few hundredths of a pixel: each edge is fitted to the grey values of the pixels along it.

Model of one edge: I = black + (white - black) * Phi(d / s), with d the signed distance of a pixel's centre from the edge line in ideal
(distortion-free) coordinates, Phi the normal distribution function, s the blur of lens and pixel. Five numbers per edge (position,
direction, black, white, s) are fitted by Gauss-Newton to the raw pixels: nothing is interpolated, so nothing is biased towards pixel
centres and the noise of neighbouring samples stays independent, which makes the covariance honest. Corners are intersections of
neighbouring edges.

A pixel adds up what falls on its square. Beside a lens that blurs by half a pixel that is as good as a little more blur; an edge that is
sharper (sharpened by a phone, or drawn) is fitted with Phi averaged over the pixel's breadth across the edge.
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
    from analyze.types import Array, IntArray

_HALF_BAND = 4
"""rows (or columns) taken on either side of the edge"""
_REACH_PX = 2.6
"""pixels farther than this from the edge carry no information on its place"""
END_MARGIN_PX = 2.6
"""stretch left out at each end, where the blurred corner bends the edge"""
_END_MARGIN_BLURS = 3.4
"""the same in units of the blur, where that is more: at s = 2 px it costs 0.008 px otherwise"""
_CONVERGED_PX = 0.02
"""Gauss-Newton converges quadratically: after a step this small the rest is below 0.001 px"""
_CONVERGED_BLUR_PX = 0.1
"""of s, which the covariance hangs on: left at half its size it makes the sd half as large as the errors"""
_MOST_STEP, _LEAST_STEP = np.array([0.8, 0.8, 0.5]), np.array([-0.8, -0.8, -0.3])
"""px, of one step: line at the middle and its turn, blur"""
_ROUNDING = 1.0 / 12.0
"""grey levels^2, of whole grey levels: a drawn image may have no other noise"""
_LEAST_CONTRAST = 12.0
"""grey levels"""
_LEAST_START = 1.0
"""grey levels of contrast on the way there"""
_START = np.array([[0.0, 0.0, 0.8]] * 4)
"""line [px], blur [px]"""
_RESTART_PX = 0.6
"""px; a start farther off than this is worth a second fit"""
_SAME_BAND_PX = 0.4
"""px that a square may be expected away from where its band was laid"""
_ITERATIONS = 8
"""most Gauss-Newton steps; two or three are the rule"""
_SHARP_PX = 0.5
"""px; at less blur than this the pixel's own breadth is told from a blur: corners would be 0.004 px off, at 0.3 px 0.06"""
_LEAST_BLUR, _MOST_BLUR = 0.45, 3.0
"""px, of lens and pixel"""
_LEAST_LENS_BLUR = 0.1
"""px, of the lens alone"""
_NEXT, _BEFORE = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
_EDGE = np.arange(4)
_ACROSS = np.arange(-_HALF_BAND, _HALF_BAND + 1)
_PER_SIGMA = 512
_STEEPEST = 16
"""sigma on either side that the tables of the normal distribution hold; blur is never below 0.25 px, the band never beyond 4"""
_Z = np.arange(-_STEEPEST * _PER_SIGMA, _STEEPEST * _PER_SIGMA + 1) / _PER_SIGMA
_CUMULATIVE = ndtr(_Z)
_DENSITY = np.exp(-0.5 * _Z * _Z) / math.sqrt(2.0 * math.pi)


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


@dataclass(frozen=True)
class _Band:
    """The pixels along a square's four edges, and where each lies."""

    corners_ideal: Array
    """(4, 2) px, of the square that it was laid around"""
    corners_raw: Array
    """(4, 2) px"""
    index: IntArray
    """(4, s) into the image's pixels, row by row"""
    t: Array
    """(4, s) along each edge, from -1 to 1"""
    v: Array
    """(4, s) ideal px out of the square"""
    valid: NDArray[np.bool_]
    """(4, s)"""
    window: tuple[float, float]
    """px, middle and half width of the stretch of v that is fitted"""
    middle: Array
    """(4, 2) ideal px, of the edges"""
    along: Array
    """(4, 2) unit"""
    outward: Array
    """(4, 2) unit"""
    half: Array
    """(4,) ideal px, half an edge's length"""


@dataclass(frozen=True)
class _Level:
    """Where the descent ended."""

    shape: Array
    """(4, 3) a, b, s of each edge, s of lens and pixel"""
    products: Array
    """(4, 6, 6) as of `_products`, before the last step"""
    contrast: Array
    """(4,) grey levels"""
    variance: Array
    """(4,) grey levels^2, of the residuals"""
    moved: float
    """px, the last step"""


@dataclass(frozen=True)
class SquareFit:
    """A fitted square with what the next image's fit can start from."""

    square: Square
    band: _Band
    shape: Array
    """(4, 3) a, b, s of each edge, in the band"""


def fit_square(image: NDArray[np.uint8], pixels: PixelMap, corners_ideal: Array, corners_raw: Array) -> Square | None:
    """`find_square`, the square alone."""
    found = find_square(image, pixels, corners_ideal, corners_raw)
    return None if found is None else found.square


def find_square(image: NDArray[np.uint8], pixels: PixelMap, corners_ideal: Array, corners_raw: Array) -> SquareFit | None:
    """Refine a dark square's corners.

    Args:
        image: (height, width) grey values.
        pixels: ideal coordinates of the pixel centres.
        corners_ideal: (4, 2) start, ideal px, within about 2 px, in either sense of rotation.
        corners_raw: (4, 2) the same in raw px.

    Returns:
        The square, or None where an edge leaves the image, is too short, or does not look like one.
    """
    band = _band(image.shape, pixels, corners_ideal, corners_raw, END_MARGIN_PX)
    found = None if band is None else _fit(image, band, _START)
    if found is None:
        return None
    moved = found.square.corners - corners_ideal
    margin = max(END_MARGIN_PX, _END_MARGIN_BLURS * found.square.blur)
    if float(np.max(np.abs(moved))) < _RESTART_PX and margin < 1.3 * END_MARGIN_PX:
        return found
    # The band of pixels was laid around a poor start and may miss part of the edge, or the blur is larger than thought.
    band = _band(image.shape, pixels, found.square.corners, corners_raw + moved, margin)
    return None if band is None else _fit(image, band, _START)


def find_again(image: NDArray[np.uint8], before: SquareFit, expected_ideal: Array) -> SquareFit | None:
    """The square of the image before, where it has moved so little that the same pixels tell its place: a third of the work.

    Args:
        image: of the same size.
        before: what was found in it.
        expected_ideal: (4, 2) ideal px, where it is expected.

    Returns:
        None where it has moved too far, or is not there: `find_square` may know.
    """
    if float(np.abs(expected_ideal - before.band.corners_ideal).max()) > _SAME_BAND_PX:
        return None
    found = _fit(image, before.band, before.shape)
    if found is None or float(np.abs(found.square.corners - before.band.corners_ideal).max()) > _RESTART_PX:
        return None
    # The blur that the band's ends were cut for is still about the same.
    return found if abs(found.square.blur - before.square.blur) < _CONVERGED_BLUR_PX else None


def _band(shape: tuple[int, ...], pixels: PixelMap, corners_ideal: Array, corners_raw: Array, end_margin: float) -> _Band | None:
    taken = _pixels_along(shape, corners_raw)
    if taken is None:
        return None
    index, valid = taken
    start = corners_ideal
    stop = start[_NEXT]
    along = stop - start
    length = np.hypot(along[:, 0], along[:, 1])
    along /= length[:, None]
    area = float(np.sum(start[:, 0] * stop[:, 1] - stop[:, 0] * start[:, 1]))
    # y points down: a positive area is clockwise on the screen, and (dy, -dx) points out of the square.
    outward = along[:, ::-1] * (np.array([1.0, -1.0]) * math.copysign(1.0, area))
    middle = 0.5 * (start + stop)
    half = 0.5 * length
    points = pixels.ideal.reshape(-1, 2).take(index, axis=0)
    tv = (points - middle[:, None, :]) @ np.stack([along / half[:, None], outward], axis=-1)
    t, v = np.ascontiguousarray(tv[..., 0]), np.ascontiguousarray(tv[..., 1])
    cell = float(length.min()) / 8.0
    inner = min(_REACH_PX, 0.8 * cell)
    outer = min(_REACH_PX, 0.7 * cell)
    valid &= np.abs(t) < (1.0 - min(end_margin, cell) / half)[:, None]
    window = 0.5 * (outer - inner), 0.5 * (outer + inner)
    return _Band(corners_ideal, corners_raw, index, t, v, valid, window, middle, along, outward, half)


def _fit(image: NDArray[np.uint8], band: _Band, start: Array) -> SquareFit | None:
    """Gauss-Newton from `start` (4, 3)."""
    grey = image.reshape(-1).take(band.index).astype(float)
    level = _descend(grey, band, start, None)
    if level is not None and float(level.shape[:, 2].sum()) < 4.0 * _SHARP_PX:
        breadth = _breadth(band)
        sharp = level.shape.copy()
        sharp[:, 2] = np.sqrt(np.maximum(sharp[:, 2] ** 2 - breadth**2 / 12.0, _LEAST_LENS_BLUR**2))
        level = _descend(grey, band, sharp, breadth)
    if level is None or level.moved > 0.3 or np.abs(level.shape[:, :2]).max() > _HALF_BAND or not level.contrast.min() >= _LEAST_CONTRAST:
        return None
    covariance_line = np.linalg.inv(level.products[:, :5, :5])[:, :2, :2] * (level.variance / level.contrast**2)[:, None, None]
    corners, covariance = _intersect(band, level.shape[:, :2], covariance_line)
    sd = math.sqrt(float((covariance[:, 0, 0] + covariance[:, 1, 1]).sum()) / 8.0)
    if not math.isfinite(sd):
        return None
    blur = float(level.shape[:, 2].sum()) / 4.0
    noise = math.sqrt(float(level.variance.sum()) / 4.0)
    return SquareFit(Square(corners, covariance, sd, float(level.contrast.min()), noise, blur), band, level.shape)


def _descend(grey: Array, band: _Band, start: Array, breadth: Array | None) -> _Level | None:
    """Gauss-Newton from `start` (4, 3) with pixels as points, or of `breadth` (4,) px; None where there is no edge."""
    shape = start.copy()
    least = _LEAST_BLUR if breadth is None else _LEAST_LENS_BLUR
    products = np.zeros((4, 6, 6))
    fitted, contrast, moved, weight = np.zeros((4, 5)), np.zeros(4), math.inf, np.zeros(4)
    for _ in range(_ITERATIONS):
        products, weight = _products(shape, band, grey, breadth)
        # Black and white are linear in the image: solved for with the step, they need no start.
        try:
            fitted = np.linalg.solve(products[:, :5, :5], products[:, :5, 5:])[..., 0]
        except np.linalg.LinAlgError:
            return None
        contrast = fitted[:, 4] - fitted[:, 3]
        if not contrast.min() > _LEAST_START:
            return None
        step = np.minimum(np.maximum(fitted[:, :3] / -contrast[:, None], _LEAST_STEP), _MOST_STEP)
        shape += step
        np.minimum(np.maximum(shape[:, 2], least), _MOST_BLUR, out=shape[:, 2])
        size = np.abs(step).max(axis=0)
        moved = max(size[0], size[1])
        if moved < _CONVERGED_PX and size[2] < _CONVERGED_BLUR_PX:
            break
    # The sum is of before the last step; what the step takes off it is known, because the model is as good as linear there.
    remaining = products[:, 5, 5] - (products[:, :5, 5] * fitted).sum(axis=1)
    variance = np.maximum(remaining / np.maximum(weight - 5.0, 1.0), _ROUNDING)
    if breadth is not None:
        shape[:, 2] = np.sqrt(shape[:, 2] ** 2 + breadth**2 / 12.0)
    return _Level(shape, products, contrast, variance, moved)


def _breadth(band: _Band) -> Array:
    """(4,) ideal px, a pixel's breadth across each edge. That along the longer of its axes: what the shorter adds is as good as blur."""
    ideal, raw = (corners[_NEXT] - corners for corners in (band.corners_ideal, band.corners_raw))
    return np.abs(raw).max(axis=1) * np.hypot(ideal[:, 0], ideal[:, 1]) / (raw**2).sum(axis=1)


def _products(shape: Array, band: _Band, grey: Array, breadth: Array | None) -> tuple[Array, Array]:
    """Sums of products (4, 6, 6) over the pixels of each edge, and how many pixels it has (4,).

    Of: the change of the edge's profile (0 inside, 1 outside) with a, b and s, its sign turned; 1 - profile; profile; grey.
    """
    s = shape[:, 2, None]
    d = shape[:, 1, None] * band.t
    np.subtract(band.v, d, out=d)
    d -= shape[:, 0, None]
    weight = ((np.abs(d - band.window[0]) < band.window[1]) & band.valid).astype(float)
    rows = np.empty((4, 6, band.t.shape[1]))
    profile = rows[:, 4]
    if breadth is None:
        d /= s
        cumulative, density = _normal(d)
        profile[...] = cumulative
        density *= weight
        np.divide(density, s, out=rows[:, 0])
        np.multiply(rows[:, 0], d, out=rows[:, 2])
    else:
        # The mean of Phi over the breadth w: its integral is s (z Phi(z) + phi(z)), which changes with s by phi(z).
        w = breadth[:, None]
        lower, upper = (d - 0.5 * w) / s, (d + 0.5 * w) / s
        (below, density_below), (above, density_above) = _normal(lower), _normal(upper)
        profile[...] = (upper * above - lower * below + density_above - density_below) * (s / w)
        np.multiply(above - below, weight / w, out=rows[:, 0])
        np.multiply(density_below - density_above, weight / w, out=rows[:, 2])
    profile *= weight
    np.subtract(weight, profile, out=rows[:, 3])
    np.multiply(rows[:, 0], band.t, out=rows[:, 1])
    np.multiply(grey, weight, out=rows[:, 5])
    return rows @ rows.transpose(0, 2, 1), weight.sum(axis=1)


def _normal(z: Array) -> tuple[Array, Array]:
    """The normal distribution's function and density, from tables, to 1e-7: the functions themselves cost more than all the rest."""
    place = z * _PER_SIGMA
    index = np.rint(place).astype(np.intp)
    place -= index
    index += _STEEPEST * _PER_SIGMA
    density = _DENSITY.take(index, mode="clip")
    place *= density
    place /= _PER_SIGMA
    place += _CUMULATIVE.take(index, mode="clip")
    return place, density


def _pixels_along(shape: tuple[int, ...], corners_raw: Array) -> tuple[IntArray, NDArray[np.bool_]] | None:
    """Index (4, s) and validity (4, s) of the raw pixels in a band along each edge."""
    height, width = shape
    start, stop = corners_raw, corners_raw[_NEXT]
    delta = stop - start
    steep = np.abs(delta[:, 1]) > np.abs(delta[:, 0])
    major = steep.astype(np.intp)
    from_major, to_major = start[_EDGE, major], stop[_EDGE, major]
    low, high = np.minimum(from_major, to_major), np.maximum(from_major, to_major)
    extent = high - low
    if not (extent.min() >= 6.0 and extent.max() <= 2000.0):
        return None
    first = np.ceil(low)
    last = np.floor(high)
    steps = np.arange(int((last - first).max()) + 1)
    # Shorter edges repeat their last pixel, unused: beyond it the image may end, as below a tag seen from the side.
    along = np.minimum(first[:, None] + steps, last[:, None])
    slope = delta[_EDGE, 1 - major] / delta[_EDGE, major]
    across = start[_EDGE, 1 - major][:, None] + slope[:, None] * (along - from_major[:, None])
    middle = np.rint(across).astype(np.intp)
    used = (steps <= (last - first)[:, None]).repeat(len(_ACROSS), axis=1)
    along_px = along.astype(np.intp)
    (left, top), (right, bottom) = corners_raw.min(axis=0), corners_raw.max(axis=0)
    reach = _HALF_BAND + 2
    if left < reach or top < reach or right > width - 1 - reach or bottom > height - 1 - reach:
        along_px, middle = _within(along_px, middle, used, np.where(steep, height, width), np.where(steep, width, height))
        if np.any(used.sum(axis=1) < 0.9 * len(_ACROSS) * (last - first + 1)):
            return None
    step_across = np.where(steep, 1, width)[:, None]
    index = along_px * np.where(steep, width, 1)[:, None] + middle * step_across
    index = (index[..., None] + step_across[..., None] * _ACROSS).reshape(4, -1)
    return index, used


def _within(along: IntArray, middle: IntArray, used: NDArray[np.bool_], length: IntArray, breadth: IntArray) -> tuple[IntArray, IntArray]:
    """Bands (4, n) moved into the image, of `length` and `breadth` (4,) as each edge sees it; clears `used` (4, n * band) beyond it."""
    across = middle[..., None] + _ACROSS
    inside = (along >= 0)[..., None] & (along < length[:, None])[..., None] & (across >= 0) & (across < breadth[:, None, None])
    used &= inside.reshape(4, -1)
    kept = np.clip(middle, _HALF_BAND, breadth[:, None] - 1 - _HALF_BAND)
    return np.clip(along, 0, length[:, None] - 1), kept


def _intersect(band: _Band, line: Array, covariance: Array) -> tuple[Array, Array]:
    """Corner i = edge i-1 x edge i, with covariance (4, 2, 2) from both lines' (a, b)."""
    point = band.middle + line[:, :1] * band.outward
    direction = band.along + (line[:, 1] / band.half)[:, None] * band.outward
    normal = direction[:, ::-1] * np.array([-1.0, 1.0])
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    level = (normal * point).sum(axis=1)
    matrix = np.stack([normal[_BEFORE], normal], axis=1)
    inverse = np.linalg.inv(matrix)
    corners = np.asarray(inverse @ np.stack([level[_BEFORE], level], axis=-1)[..., None], dtype=np.float64)[..., 0]
    # Offsets of the two lines at the corner: a + b t with t = +1 on the incoming edge, -1 on the outgoing one.
    even, odd = covariance[:, 0, 0] + covariance[:, 1, 1], 2 * covariance[:, 0, 1]
    variance = np.stack([(even + odd)[_BEFORE], even - odd], axis=-1)
    return corners, (inverse * variance[:, None, :]) @ inverse.transpose(0, 2, 1)
