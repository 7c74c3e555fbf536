"""Sub-pixel corners of a black square, from a model of its edges fitted to the pixels along them.

The corners are accurate to a few hundredths of a pixel. The pixels are chosen in edge_band.py.

Model of one edge: I = black + (white - black) * Phi(d / s), with I the grey value of a pixel, black and white
the grey levels inside and outside, d the signed distance of a pixel's centre from the edge line in ideal
(distortion-free) coordinates, Phi the normal distribution function, s the blur of lens and pixel. Five
numbers per edge (position, direction, black, white, s) are fitted by Gauss-Newton to the raw pixels: without
interpolation there is no bias towards pixel centres, and the noise of neighbouring samples stays independent,
which makes the covariance correct. Corners are intersections of neighbouring edges.

A pixel integrates over its square. With a lens that blurs by half a pixel that is equivalent to a little more
blur. An edge that is sharper (sharpened by a phone, or drawn) is fitted with Phi averaged over the pixel's
breadth across the edge.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

from analyze.tracking.edge_band import HALF_BAND, NEXT, EdgeBand, edge_band

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.tracking.camera_model import PixelMap
    from analyze.types import Array

END_MARGIN_PX = 2.6
"""stretch left out at each end of an edge [px], where the blurred corner bends the edge"""
_END_MARGIN_BLURS = 3.4
"""stretch left out at each end of an edge, in units of the blur s; the larger of this and `END_MARGIN_PX` is
used (otherwise the error at s = 2 px is 0.008 px)"""
_LINE_TOLERANCE_PX = 0.02
"""largest step of a line [px] that ends the iteration; Gauss-Newton converges quadratically, so that the
remaining error is below 0.001 px"""
_BLUR_TOLERANCE_PX = 0.1
"""largest step of the blur [px] that ends the iteration; the covariance depends on s: with half the true blur
the sd would be half as large"""
_MAX_STEP, _MIN_STEP = np.array([0.8, 0.8, 0.5]), np.array([-0.8, -0.8, -0.3])
"""limits of one step [px]: offset of the line at its middle, its tilt, and the blur"""
_ROUNDING_VARIANCE = 1.0 / 12.0
"""variance of rounding to whole grey levels [grey levels^2]: a drawn image may have no other noise"""
_MIN_CONTRAST = 12.0
"""least contrast of an edge [grey levels]"""
_MIN_START_CONTRAST = 1.0
"""least contrast during the iteration [grey levels]"""
_START_SHAPE = np.array([[0.0, 0.0, 0.8]] * 4)
"""first line [px, px] and blur [px] of each edge"""
_RESTART_PX = 0.6
"""distance of the fit from its start [px] beyond which a second fit is made"""
_SAME_BAND_PX = 0.4
"""largest expected motion [px] at which the band of the previous image is used again"""
_MAX_STEPS = 8
"""most Gauss-Newton steps; two or three are usual"""
_SHARP_PX = 0.5
"""blur [px] below which the pixel's breadth is modelled separately; otherwise corners would be off by 0.004
px, at a blur of 0.3 px by 0.06 px"""
_MIN_BLUR, _MAX_BLUR = 0.45, 3.0
"""range of the blur of lens and pixel [px]"""
_MIN_LENS_BLUR = 0.1
"""least blur of the lens alone [px]"""
_BEFORE = np.array([3, 0, 1, 2])
"""index of the edge before each edge of a square"""
_TABLE_STEPS_PER_SIGMA = 512
_TABLE_SIGMAS = 16
"""range of the tables of the normal distribution [sigma]; blur is never below 0.25 px, the band never beyond
4"""
_Z = (
    np.arange(-_TABLE_SIGMAS * _TABLE_STEPS_PER_SIGMA, _TABLE_SIGMAS * _TABLE_STEPS_PER_SIGMA + 1)
    / _TABLE_STEPS_PER_SIGMA
)
_CUMULATIVE = ndtr(_Z)
_DENSITY = np.exp(-0.5 * _Z * _Z) / math.sqrt(2.0 * math.pi)


@dataclass(frozen=True)
class Square:
    """Corners of a black square, fitted to its edges in an image, with covariances and the image's blur.

    Corners are in ideal (distortion-free) pixels.
    """

    corners: Array
    """(4, 2) ideal px, in the order given"""
    covariance: Array
    """(4, 2, 2) covariance of each corner [px^2]"""
    sd: float
    """root mean square standard deviation over corners and axes [px]"""
    blur: float
    """blur of lens and pixel, mean over the edges [px]"""


@dataclass(frozen=True)
class _EdgeFits:
    """Fitted lines, blur and contrast of a square's four edges, with the normal equations of their fit.

    An edge's fitted line lies a + b t [px] outwards from the first line of the edge, along which the pixels
    (band) were chosen; t runs from -1 to 1 along the edge.
    """

    shape: Array
    """(4, 3) offset a, tilt b and blur s of each edge [px]; s is that of lens and pixel together"""
    products: Array
    """(4, 6, 6) sums of products from `_products`, before the last step"""
    contrast: Array
    """(4,) contrast [grey levels]"""
    variance: Array
    """(4,) variance of the residuals [grey levels^2]"""
    moved: float
    """size of the last step of the lines [px]"""


@dataclass(frozen=True)
class SquareFit:
    """A marker's black square as fitted in one image, with the pixels, line and blur of each edge.

    The fit in the next image starts from these pixels, lines and blurs. An edge's fitted line lies a + b t
    [px] outwards from the first line of the edge, along which the pixels were chosen; t runs from -1 to 1.
    """

    square: Square
    """the fitted square"""
    band: EdgeBand
    """pixels along its edges"""
    shape: Array
    """(4, 3) offset a, tilt b and blur s of each edge in the band [px]"""


def fit_square(
    image: NDArray[np.uint8], pixels: PixelMap, corners_ideal: Array, corners_raw: Array
) -> Square | None:
    """Square with corners refined to its edges in an image; None if no square is there.

    Args:
        image: (height, width) grey values.
        pixels: distortion-free (ideal) coordinates [px] of the centres of the image's pixels.
        corners_ideal: (4, 2) first corners, free of lens distortion [ideal px], within about 2 px.
        corners_raw: (4, 2) these corners in the image [raw px].

    Returns:
        Corners in the order given [ideal px], with their covariance and the blur. None if an edge leaves the
        image, is too short or too long, or the fit of an edge fails or shows a contrast, from dark inside to
        light outside, of less than 12 grey levels.
    """
    found = find_square(image, pixels, corners_ideal, corners_raw)
    return None if found is None else found.square


def find_square(
    image: NDArray[np.uint8], pixels: PixelMap, corners_ideal: Array, corners_raw: Array
) -> SquareFit | None:
    """Find a dark square near first corners: fit its edges to the grey values, and intersect them.

    Args:
        image: (height, width) grey values.
        pixels: ideal coordinates of the pixel centres.
        corners_ideal: (4, 2) first corners, free of lens distortion [ideal px], within about 2 px, in either
            sense of rotation.
        corners_raw: (4, 2) these corners in the image [raw px].

    Returns:
        The square, its corners in the order given [ideal px], with the pixels along its edges. None if an
        edge leaves the image, is too short or too long, or the fit of an edge fails or shows a contrast, from
        dark inside to light outside, of less than 12 grey levels.
    """
    band = edge_band(image.shape, pixels, corners_ideal, corners_raw, END_MARGIN_PX)
    found = None if band is None else _fit(image, band, _START_SHAPE)
    if found is None:
        return None
    moved = found.square.corners - corners_ideal
    margin = max(END_MARGIN_PX, _END_MARGIN_BLURS * found.square.blur)
    if float(np.max(np.abs(moved))) < _RESTART_PX and margin < 1.3 * END_MARGIN_PX:
        return found
    # The band lies around a poor start and may miss part of the edge, or the blur is larger than assumed.
    band = edge_band(image.shape, pixels, found.square.corners, corners_raw + moved, margin)
    return None if band is None else _fit(image, band, _START_SHAPE)


def refit_square(image: NDArray[np.uint8], before: SquareFit, expected_ideal: Array) -> SquareFit | None:
    """Fit a square again in the next image, on the pixels that were used in the previous image.

    This costs a third of `find_square`. It works only for a square that has moved so little (0.4 px) that the
    same pixels still show its edges.

    Args:
        image: (height, width) grey values, of the same size as the previous image.
        before: the square as fitted in the previous image, with the pixels used.
        expected_ideal: (4, 2) expected corners, free of lens distortion [ideal px].

    Returns:
        The fitted square, with the pixels, line and blur of each edge; None if it has moved too far, its blur
        has changed, or it is not there. `find_square` may still find it then.
    """
    if float(np.abs(expected_ideal - before.band.corners_ideal).max()) > _SAME_BAND_PX:
        return None
    found = _fit(image, before.band, before.shape)
    if found is None or float(np.abs(found.square.corners - before.band.corners_ideal).max()) > _RESTART_PX:
        return None
    # The band's ends were cut for a certain blur, which must still be about the same.
    return found if abs(found.square.blur - before.square.blur) < _BLUR_TOLERANCE_PX else None


def _fit(image: NDArray[np.uint8], band: EdgeBand, start: Array) -> SquareFit | None:
    """Square fitted to the grey values along its edges by Gauss-Newton; None if an edge does not fit.

    An edge does not fit if the iteration has not settled, its line has left the band, or its contrast is
    below 12 grey levels. If the mean blur is below 0.5 px, the fit is repeated with a model that averages
    over the breadth of a pixel.

    Args:
        image: (height, width) grey values.
        band: pixels along the edges.
        start: (4, 3) first offset, tilt and blur of each edge [px].

    Returns:
        The square, with the band and the fitted offset, tilt and blur of each edge.
    """
    grey = image.reshape(-1).take(band.index).astype(float)
    level = _descend(grey, band, start, None)
    if level is not None and float(level.shape[:, 2].sum()) < 4.0 * _SHARP_PX:
        breadth = _breadth(band)
        sharp = level.shape.copy()
        sharp[:, 2] = np.sqrt(np.maximum(sharp[:, 2] ** 2 - breadth**2 / 12.0, _MIN_LENS_BLUR**2))
        level = _descend(grey, band, sharp, breadth)
    if (
        level is None
        or level.moved > 0.3
        or np.abs(level.shape[:, :2]).max() > HALF_BAND
        or not level.contrast.min() >= _MIN_CONTRAST
    ):
        return None
    covariance_line = (
        np.linalg.inv(level.products[:, :5, :5])[:, :2, :2]
        * (level.variance / level.contrast**2)[:, None, None]
    )
    corners, covariance = _intersect(band, level.shape[:, :2], covariance_line)
    sd = math.sqrt(float((covariance[:, 0, 0] + covariance[:, 1, 1]).sum()) / 8.0)
    if not math.isfinite(sd):
        return None
    blur = float(level.shape[:, 2].sum()) / 4.0
    return SquareFit(Square(corners, covariance, sd, blur), band, level.shape)


def _descend(grey: Array, band: EdgeBand, start: Array, breadth: Array | None) -> _EdgeFits | None:
    """Fit lines, blur and contrast of a square's four edges by Gauss-Newton; None if an edge is lost.

    An edge is lost if its contrast falls to 1 grey level or less, or its pixels do not determine its five
    unknowns (offset, tilt, blur, black, white).

    Args:
        grey: (4, s) grey values of the band's pixels.
        band: the pixels along the edges.
        start: (4, 3) first offset a, tilt b and blur s of each edge [px].
        breadth: (4,) breadth of a pixel across each edge [px]; None for pixels as points.

    Returns:
        Per edge: offset, tilt and blur [px], sums of the normal equations, contrast [grey levels] and
        variance of the residuals [grey levels^2]. For all together: size of the last step of the lines [px].
    """
    shape = start.copy()
    least = _MIN_BLUR if breadth is None else _MIN_LENS_BLUR
    products = np.zeros((4, 6, 6))
    fitted, contrast, moved, weight = np.zeros((4, 5)), np.zeros(4), math.inf, np.zeros(4)
    for _ in range(_MAX_STEPS):
        products, weight = _products(shape, band, grey, breadth)
        # Black and white are linear in the image: solved for together with the step, they need no start.
        try:
            fitted = np.linalg.solve(products[:, :5, :5], products[:, :5, 5:])[..., 0]
        except np.linalg.LinAlgError:
            return None
        contrast = fitted[:, 4] - fitted[:, 3]
        if not contrast.min() > _MIN_START_CONTRAST:
            return None
        step = np.minimum(np.maximum(fitted[:, :3] / -contrast[:, None], _MIN_STEP), _MAX_STEP)
        shape += step
        np.minimum(np.maximum(shape[:, 2], least), _MAX_BLUR, out=shape[:, 2])
        size = np.abs(step).max(axis=0)
        moved = max(size[0], size[1])
        if moved < _LINE_TOLERANCE_PX and size[2] < _BLUR_TOLERANCE_PX:
            break
    # The sum of squares is from before the last step, whose effect follows from the linear model.
    remaining = products[:, 5, 5] - (products[:, :5, 5] * fitted).sum(axis=1)
    variance = np.maximum(remaining / np.maximum(weight - 5.0, 1.0), _ROUNDING_VARIANCE)
    if breadth is not None:
        shape[:, 2] = np.sqrt(shape[:, 2] ** 2 + breadth**2 / 12.0)
    return _EdgeFits(shape, products, contrast, variance, moved)


def _breadth(band: EdgeBand) -> Array:
    """Breadth (4,) [ideal px] over which a pixel blurs each of the four edges of a band.

    A pixel's two sides are projected on the edge's normal. The breadth is the longer projection; the effect
    of the shorter one is equivalent to more blur.
    """
    ideal, raw = (corners[NEXT] - corners for corners in (band.corners_ideal, band.corners_raw))
    return np.abs(raw).max(axis=1) * np.hypot(ideal[:, 0], ideal[:, 1]) / (raw**2).sum(axis=1)


def _products(shape: Array, band: EdgeBand, grey: Array, breadth: Array | None) -> tuple[Array, Array]:
    """Normal equations of the fit of four edges: products (4, 6, 6) of six columns, and pixel counts (4,).

    Products are summed over an edge's pixels. An edge's profile rises with the distance from its line from 0
    inside the square to 1 outside. The columns: minus the profile's derivatives by offset a, tilt b and blur
    s (three columns); 1 - profile; profile; grey value.

    Args:
        shape: (4, 3) a, b, s of each edge [px].
        band: the pixels along the edges, n per edge.
        grey: (4, n) their grey values.
        breadth: (4,) breadth of a pixel across each edge [px]; None for pixels as points.
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
        # The mean of Phi over the breadth w: its integral is s (z Phi(z) + phi(z)), which changes with s by
        # phi(z).
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
    """Standard normal distribution function and density at `z` (...), two arrays (...) of its shape.

    They are taken from tables, for speed, and are accurate to 1e-7.
    """
    place = z * _TABLE_STEPS_PER_SIGMA
    index = np.rint(place).astype(np.intp)
    place -= index
    index += _TABLE_SIGMAS * _TABLE_STEPS_PER_SIGMA
    density = _DENSITY.take(index, mode="clip")
    place *= density
    place /= _TABLE_STEPS_PER_SIGMA
    place += _CUMULATIVE.take(index, mode="clip")
    return place, density


def _intersect(band: EdgeBand, line: Array, covariance: Array) -> tuple[Array, Array]:
    """Corners (4, 2) [px] of a square from its fitted edges, and their covariance (4, 2, 2) [px^2].

    Corner i is the intersection of edges i - 1 and i. Pixels are ideal: free of lens distortion.

    Args:
        band: the pixels, with middle, direction and length of each edge.
        line: (4, 2) offset a and tilt b of each edge [px]: the line lies a + b t outside that of the band,
            with t from -1 to 1 along the edge.
        covariance: (4, 2, 2) covariance of (a, b) [px^2].
    """
    point = band.middle + line[:, :1] * band.outward
    direction = band.along + (line[:, 1] / band.half)[:, None] * band.outward
    normal = direction[:, ::-1] * np.array([-1.0, 1.0])
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    level = (normal * point).sum(axis=1)
    matrix = np.stack([normal[_BEFORE], normal], axis=1)
    inverse = np.linalg.inv(matrix)
    corners = np.asarray(inverse @ np.stack([level[_BEFORE], level], axis=-1)[..., None], dtype=np.float64)[
        ..., 0
    ]
    # Offsets of the two lines at the corner: a + b t with t = +1 on the incoming edge, -1 on the outgoing
    # one.
    even, odd = covariance[:, 0, 0] + covariance[:, 1, 1], 2 * covariance[:, 0, 1]
    variance = np.stack([(even + odd)[_BEFORE], even - odd], axis=-1)
    return corners, (inverse * variance[:, None, :]) @ inverse.transpose(0, 2, 1)
