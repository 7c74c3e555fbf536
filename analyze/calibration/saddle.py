"""Fits corners of a chessboard to a few thousandths of a pixel, as two crossing blurred edges.

Model: I = m + g.u + a erf(d1 / (sqrt(2) s)) erf(d2 / (sqrt(2) s)), with I the grey value of a pixel at u, m
the level, g its slope, a half the contrast, d1, d2 the signed distances of the pixel from the two lines
through the corner, s the blur (sd). Nine numbers per corner (its position, two directions, level and its
slope, contrast, blur) are fitted by Gauss-Newton to the raw pixels near the lines: without interpolation the
noise of neighbouring samples stays independent, so that the covariance is correct. Where the lines are not at
right angles the product is not quite the blur of a lens, but the difference is the same on opposite sides of
the corner and does not shift it.

Measured on OpenCV 5.0 with rendered boards of known corners (noise 4 grey levels, blur 0.7 px, squares of 30
to 60 px): 0.007 px in x and in y, and 0.001 px without noise; CharucoDetector has 0.036 px, and so has
cornerSubPix called by itself with a window of 5 px. Neither has a bias there (CharucoDetector had +0.5 px
before opencv#28380).

`u` are pixels undistorted by the caller, so that the board's lines are straight; otherwise a lens of k1 =
-0.12 shifts corners by some thousandths, a fisheye by hundredths of a pixel.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array

_MAX_HALF_WIDTH_PX = 20
"""largest half width of the patch [px]; a longer edge hardly reduces the effect of pixel noise"""
_EXTENT = 0.45
"""length along each line that is used [squares]; beyond it the next corner begins"""
_REACH_PX = 3.2
"""distance from a line [px] beyond which a pixel carries no information on the line's position"""
_MIN_REACH_PX = 1.0
"""distance from a line [px] up to which pixels are used even if a tag is near"""
_TAG_BLURS = 1.8
"""distance that pixels used keep from the tag in the white square, in units of the blur's sd"""
_START_BLUR_PX = 0.8
"""first guess of the blur's sd [px]"""
_BLUR_RANGE_PX = (0.3, 4.0)
"""range of the blur's sd [px]"""
_MAX_SHIFT_PX = 3.0
"""largest distance of a corner from its start [px]"""
_MIN_CONTRAST = 12.0
"""least contrast [grey levels]"""
_MIN_PIXELS = 40
"""least number of pixels of a fit"""
_MAX_MISFIT = 0.35
"""largest rms residual over half the contrast; above it the patch shows no corner (a finger, a reflection)"""
_MAX_STEPS = 14
_STEP_TOLERANCE_PX = 1e-3
_PARAMETERS = 9
"""number of parameters: position (2), directions of the lines (2), level, its slope (2), half the contrast,
blur"""


@dataclass(frozen=True)
class Saddles:
    """Result of fitting n chessboard corners in an image: positions [px], covariances, blur, and success."""

    place: Array
    """(n, 2) column and row: the first position plus the fitted shift [px]"""
    covariance: Array
    """(n, 2, 2) covariance of the position, from the residuals [px^2]"""
    blur: Array
    """(n,) standard deviation of the edges' blur [px]"""
    good: NDArray[np.bool_]
    """(n,) True for an accepted corner"""


@dataclass(frozen=True)
class Patch:
    """Columns and rows (n, m) of m pixels around each of n corners, clipped to the image.

    A mask (n, m) is True for pixels that were inside the image before.
    """

    column: NDArray[np.int64]
    """(n, m) column, clipped to the image"""
    row: NDArray[np.int64]
    """(n, m) row, clipped to the image"""
    inside: NDArray[np.bool_]
    """(n, m) True for a pixel that was inside the image before clipping"""


def patches(start: Array, per_square: Array, width: int, height: int) -> Patch:
    """Square of m pixels around each of n chessboard corners, from which the corner is fitted.

    Args:
        start: (n, 2) first positions, good to about a pixel [px].
        per_square: (n, 2, 2) matrices; columns: shift [px] per square along the board's x, and y.
        width: image width [px].
        height: image height [px].

    Returns:
        Columns and rows of the pixels, clipped to the image, and a mask of those inside it, each (n, m).
    """
    half = int(min(_MAX_HALF_WIDTH_PX, math.ceil(_EXTENT * float(np.abs(per_square).sum(axis=2).max()))))
    step = np.arange(-half, half + 1)
    middle = np.rint(start).astype(np.int64)
    row, column = np.meshgrid(step, step, indexing="ij")
    columns = middle[:, :1] + column.ravel()
    rows = middle[:, 1:] + row.ravel()
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return Patch(np.clip(columns, 0, width - 1), np.clip(rows, 0, height - 1), inside)


def fit_saddles(
    image: NDArray[np.uint8], start: Array, per_square: Array, rim: float, patch: Patch, straight: Array
) -> Saddles:
    """Fit n chessboard corners to the grey values around them, by Gauss-Newton.

    Args:
        image: (height, width) grey values.
        start: (n, 2) first positions [px].
        per_square: (n, 2, 2) matrices; columns: shift [px] per square along the board's x, and y.
        rim: white margin between a tag and the edge of its square [square sides].
        patch: pixels around the corners, from `patches`.
        straight: (n, m, 2) undistorted positions of the patch's pixels relative to `start` [px].

    Returns:
        Positions [px] and their covariances [px^2] of all n corners, and the blur [px]; corners that were not
        fitted well, or have too few pixels, have `good` False.
    """
    n = len(start)
    x = np.zeros((n, _PARAMETERS))
    x[:, 2] = np.arctan2(per_square[:, 1, 0], per_square[:, 0, 0])
    x[:, 3] = np.arctan2(per_square[:, 1, 1], per_square[:, 0, 1])
    x[:, 8] = _START_BLUR_PX
    at = _Pixels(np.ascontiguousarray(straight[..., 0]), np.ascontiguousarray(straight[..., 1]))
    wanted = _within(at, per_square)
    wanted &= np.minimum(*map(np.abs, _distances(x, at))) < _REACH_PX + _MAX_SHIFT_PX
    # Only the quarter of the patch that lies near a line is used.
    order = np.argsort(~wanted, axis=1, kind="stable")[:, : int(wanted.sum(axis=1).max(initial=1))]
    wanted = np.take_along_axis(wanted, order, axis=1)
    at = _Pixels(*(np.where(wanted, np.take_along_axis(each, order, axis=1), 0.0) for each in (at.x, at.y)))
    grey = image[
        np.take_along_axis(patch.row, order, axis=1), np.take_along_axis(patch.column, order, axis=1)
    ].astype(np.float64)
    usable = wanted & np.take_along_axis(patch.inside, order, axis=1)
    used, normal, variance = usable, np.zeros((n, _PARAMETERS, _PARAMETERS)), np.zeros(n)
    step = np.full((n, _PARAMETERS), np.inf)
    for turn in range(_MAX_STEPS):
        # The samples are chosen at the start, and once more when the corner is accurate to a tenth of a
        # pixel.
        if turn in {0, 4}:
            used = usable & _near(x, at, per_square, rim)
        if turn == 0:
            _start_levels(x, at, grey, used)
        normal, gradient, squares_left = _normal_equations(x, at, grey, used)
        step = _solve(normal, gradient)
        left = squares_left - np.einsum("np,np->n", gradient, step)
        variance = np.maximum(left, 0.0) / np.maximum(used.sum(axis=1) - _PARAMETERS, 1)
        step[:, :2] = np.clip(step[:, :2], -1.0, 1.0)
        step[:, 2:4] = np.clip(step[:, 2:4], -0.15, 0.15)
        step[:, 8] = np.clip(step[:, 8], -0.4, 0.6)
        x += step
        x[:, 8] = np.clip(x[:, 8], *_BLUR_RANGE_PX)
        if turn > 4 and float(np.nanmax(np.abs(step[:, :2]), initial=0.0)) < _STEP_TOLERANCE_PX:
            break
    share = used.sum(axis=1) / np.maximum((wanted & _near(x, at, per_square, rim)).sum(axis=1), 1)
    covariance = _inverse(normal)[:, :2, :2] * variance[:, None, None]
    good = (
        np.isfinite(x).all(axis=1)
        & np.isfinite(covariance).all(axis=(1, 2))
        & (np.abs(step[:, :2]).max(axis=1) < 0.05)
        & (np.abs(x[:, :2]).max(axis=1) < _MAX_SHIFT_PX)
        & (2.0 * np.abs(x[:, 7]) > _MIN_CONTRAST)
        & (x[:, 8] > _BLUR_RANGE_PX[0])
        & (x[:, 8] < _BLUR_RANGE_PX[1])
        & (np.sqrt(variance) < _MAX_MISFIT * np.abs(x[:, 7]))
        & (used.sum(axis=1) >= _MIN_PIXELS)
        & (share > 0.8)
    )
    return Saddles(start + x[:, :2], covariance, x[:, 8], good)


@dataclass(frozen=True)
class _Pixels:
    """Undistorted pixels around n corners, m each: positions x to the right and y down, (n, m) each [px].

    They are relative to the first position of the pixel's corner.
    """

    x: Array
    """(n, m) to the right [px]"""
    y: Array
    """(n, m) down [px]"""


def _within(at: _Pixels, per_square: Array) -> NDArray[np.bool_]:
    """True (n, m) for those of m pixels around each of n board corners that are near the corner.

    Near is within `_EXTENT` squares of the board, along its x and along its y. False where a pixel has no
    undistorted position (NaN).

    Args:
        at: undistorted positions of the pixels, relative to their corner.
        per_square: (n, 2, 2) matrices; columns: shift [px] per square along the board's x, and y.
    """
    to_squares = np.linalg.inv(per_square)[:, :, :, None]
    across = to_squares[:, 0, 0] * at.x + to_squares[:, 0, 1] * at.y
    along = to_squares[:, 1, 0] * at.x + to_squares[:, 1, 1] * at.y
    return (np.abs(across) < _EXTENT) & (np.abs(along) < _EXTENT)


def _distances(x: Array, at: _Pixels) -> tuple[Array, Array]:
    """Signed distances [px] of m pixels from the two lines through each of n chessboard corners.

    The lines are the edges of the squares that meet at the corner.

    Args:
        x: (n, 9) fitted parameters, of which the first four are used: shift of the corner from its first
            position (2) [px], directions of the two lines (2) [rad].
        at: undistorted positions of m pixels around each corner, relative to its first position [px].

    Returns:
        Distances (n, m) from the first line, and (n, m) from the second.
    """
    cos, sin = np.cos(x[:, 2:4]), np.sin(x[:, 2:4])
    ux, uy = at.x - x[:, :1], at.y - x[:, 1:2]
    return uy * cos[:, :1] - ux * sin[:, :1], uy * cos[:, 1:] - ux * sin[:, 1:]


def _near(x: Array, at: _Pixels, per_square: Array, rim: float) -> NDArray[np.bool_]:
    """True (n, m) for those of m pixels around each of n chessboard corners that enter the corner's fit.

    They lie near one of the two lines (edges of squares) through the corner, and clear of the tags.

    Args:
        x: (n, 9) fitted parameters, of which are used: shift of the corner from its first position [px] and
            directions of the two lines [rad] (the first four), and the blur [px] (the last).
        at: undistorted positions of m pixels around each corner, relative to its first position [px].
        per_square: (n, 2, 2) matrices; columns: shift [px] per square along the board's x, and y.
        rim: white margin between a tag and the edge of its square [square sides], foreshortened like the
            square.
    """
    area = np.abs(np.linalg.det(per_square))
    across = area[:, None] / np.linalg.norm(per_square, axis=1)
    reach = np.clip(rim * across - _TAG_BLURS * x[:, 8:9], _MIN_REACH_PX, _REACH_PX)
    first, second = _distances(x, at)
    return (np.abs(first) < reach[:, :1]) | (np.abs(second) < reach[:, 1:])


def _start_levels(x: Array, at: _Pixels, grey: Array, used: NDArray[np.bool_]) -> None:
    """Set grey level, its slope and half the contrast in the parameters `x` of n corner fits, in place.

    They are fitted by linear least squares, and stand in columns 4 to 7: level, slope along the image's x and
    y [per px], half the contrast.

    Args:
        x: (n, 9) parameters of the fits (`_PARAMETERS`), whose positions, directions and blurs are used.
        at: undistorted positions (n, m) of the pixels, relative to their corner's first position [px].
        grey: (n, m) grey values of the pixels.
        used: (n, m) True for pixels that enter the fit.
    """
    first, second = _distances(x, at)
    shape = (2.0 * ndtr(first / x[:, 8:9]) - 1.0) * (2.0 * ndtr(second / x[:, 8:9]) - 1.0)
    rows = np.stack([np.ones_like(shape), at.x, at.y, shape], axis=1) * used[:, None, :]
    x[:, 4:8] = _solve(rows @ rows.transpose(0, 2, 1), (rows @ grey[..., None])[..., 0])


def _normal_equations(
    x: Array, at: _Pixels, grey: Array, used: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Normal equations of n corner fits, linearised at their parameters `x`.

    Args:
        x: (n, 9) parameters of the fits: shift from the first position (2) [px], directions of the two lines
            [rad], grey level, its slope (2) [1/px], half the contrast, blur [px].
        at: positions of m pixels per corner, relative to the corner's first position [px].
        grey: (n, m) grey values of the pixels.
        used: (n, m) True for pixels that enter the fit.

    Returns:
        Normal matrices (n, 9, 9), right-hand sides (n, 9), sums of squared residuals (n,) [grey levels^2].
    """
    d1, d2 = _distances(x, at)
    s, a = x[:, 8:9], x[:, 7:8]
    z1, z2 = d1 / s, d2 / s
    first, second = 2.0 * ndtr(z1) - 1.0, 2.0 * ndtr(z2) - 1.0
    bell = 2.0 / math.sqrt(2.0 * math.pi) * a / s
    by_first, by_second = bell * np.exp(-0.5 * z1 * z1) * second, bell * first * np.exp(-0.5 * z2 * z2)
    cos, sin = np.cos(x[:, 2:4]), np.sin(x[:, 2:4])
    ux, uy = at.x - x[:, :1], at.y - x[:, 1:2]
    rows = np.empty((len(x), _PARAMETERS, grey.shape[1]))
    rows[:, 0] = by_first * sin[:, :1] + by_second * sin[:, 1:]
    rows[:, 1] = -by_first * cos[:, :1] - by_second * cos[:, 1:]
    # A line that turns by da moves a pixel's distance by -t da, t along the line.
    rows[:, 2] = -by_first * (ux * cos[:, :1] + uy * sin[:, :1])
    rows[:, 3] = -by_second * (ux * cos[:, 1:] + uy * sin[:, 1:])
    rows[:, 4], rows[:, 5], rows[:, 6] = 1.0, at.x, at.y
    np.multiply(first, second, out=rows[:, 7])
    rows[:, 8] = -(by_first * z1 + by_second * z2)
    residual = (grey - x[:, 4:5] - x[:, 5:6] * at.x - x[:, 6:7] * at.y - a * rows[:, 7]) * used
    rows *= used[:, None, :]
    return (
        rows @ rows.transpose(0, 2, 1),
        (rows @ residual[..., None])[..., 0],
        np.sum(residual * residual, axis=1),
    )


def _solve(normal: Array, gradient: Array) -> Array:
    """Solutions (n, p) of n systems of normal equations; 0 in undetermined directions.

    Args:
        normal: (n, p, p) normal matrices.
        gradient: (n, p) right-hand sides.
    """
    return (_inverse(normal) @ gradient[..., None])[..., 0]


def _inverse(normal: Array) -> Array:
    """Pseudo-inverses (n, p, p) of n normal matrices, computed after scaling to unit diagonals."""
    scale = np.sqrt(np.maximum(np.einsum("npp->np", normal), 1e-12))
    even = normal / scale[:, :, None] / scale[:, None, :]
    inverse: Array = np.asarray(np.linalg.pinv(even, hermitian=True, rcond=1e-10), dtype=np.float64)
    return inverse / scale[:, :, None] / scale[:, None, :]
