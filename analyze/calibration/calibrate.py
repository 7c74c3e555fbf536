"""Calibrates a lens from views (images) of a board, with its uncertainty and diagnostics.

It solves for the lens and the board's poses, refits the corners, rejects outliers, and judges the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from analyze.calibration.board import corner_points
from analyze.calibration.board_pose import ObservedView, weighted_corners
from analyze.calibration.precision import pixel_sd
from analyze.calibration.solve import MEDIAN_CHI, Bundle, refine_bundle, solve
from analyze.calibration.straight import refit
from analyze.calibration.verdict import coverage, doubts, tilt, undetermined
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from analyze.calibration.detect import View
    from analyze.calibration.lens import Lens
    from analyze.calibration.precision import PixelMap
    from analyze.calibration.verdict import Coverage
    from analyze.tags.sheet import Board
    from analyze.types import Array
    from schemas.session_manifest import LensModel

OUTLIER_RATIO = 5.0
"""distance from its prediction, over its standard deviation, above which a corner is left out; more if most
corners scatter more than stated"""
_BAD_VIEW_RATIO, _BAD_VIEW_PX = 4.0, 0.05
"""a view is left out if its residual exceeds both this multiple of the others' median and this value [px]"""
_MAX_OUTLIER_SHARE = 0.3
"""largest share of outliers among a view's corners; above it the view is left out"""
STEPS = 4
"""number of steps of the calibration"""


@dataclass(frozen=True)
class Shot:
    """Image of a calibration board with the corners found in it."""

    name: str
    """name of the image for messages"""
    image: NDArray[np.uint8]
    """(height, width) grey values"""
    view: View
    """corners of the board"""


@dataclass(frozen=True)
class Dropped:
    """View (image of the board) that was left out of a calibration, with the reason."""

    name: str
    """name of the image"""
    reason: str
    """reason in words, with its numbers"""


@dataclass(frozen=True)
class Calibration:
    """Calibrated lens with its uncertainty and diagnostics."""

    lens: Lens
    """best fit of the lens, with p numbers: focal lengths, principal point [px], distortion coefficients"""
    covariance: Array
    """(p, p) covariance of the lens's numbers, scaled by `scatter` squared"""
    bundle: Bundle
    """best fit of the lens and of the board's pose per view, with residuals"""
    shots: tuple[Shot, ...]
    """views that were used, with their refitted corners"""
    dropped: tuple[Dropped, ...]
    """views that were left out"""
    corners_dropped: int
    """number of single corners that were left out of the views used"""
    pixels: PixelMap
    """standard deviation [px] of the pixel to which a direction projects, over the image"""
    covered: Coverage
    """coverage of the image by corners"""
    tilts: tuple[float, ...]
    """angle between the board's normal and the line of sight to its middle, 0 to pi/2, per view [rad]"""
    scatter: float
    """factor on the corners' stated sd that the residuals require, at least 1"""
    undetermined: tuple[str, ...]
    """reasons why the lens cannot be used; empty if it can"""
    doubts: tuple[str, ...]
    """warnings about the lens, each with its number and a remedy or cause; empty if there are none"""

    @property
    def sd(self) -> Array:
        """Standard deviations (p,) of the lens's p numbers: of fx, fy, cx, cy [px], then the distortion.

        The distortion is k1, k2, p1, p2, k3 for a pinhole, k1 to k4 for a fisheye.
        """
        return np.sqrt(np.diag(self.covariance))

    @property
    def strain_sd(self) -> float:
        """Standard deviation of the image's strain from errors of the lens and from a stretched print.

        The strain is the relative error of a length in one direction against one across it. Both parts are
        added in squares; that of the print is fx / fy - 1, because the camera's pixels are square.
        """
        fx, fy = self.lens.numbers[:2]
        return float(np.hypot(self.pixels.strain_sd, fx / fy - 1.0))

    @property
    def rms_px(self) -> float:
        """Root mean square distance [px] of the observed corners from those predicted by lens and poses."""
        residual: Array = np.concatenate(self.bundle.residuals)
        squared: Array = np.asarray(np.sum(residual**2, axis=1), dtype=np.float64)
        return float(np.sqrt(np.mean(squared)))


def calibrate(
    shots: Sequence[Shot], board: Board, model: LensModel, progress: Callable[[str, int, int], None]
) -> Calibration:
    """Calibrate a camera's lens from images of a board.

    Corners and views that do not fit are left out.

    Args:
        shots: images with their corners, at least one, all of one size.
        board: the board.
        model: lens model.
        progress: called with a text, the number of finished steps and of all steps (`STEPS`).

    Returns:
        The lens with its uncertainty and diagnostics; not to be used if its `undetermined` is not empty.
    """
    points = corner_points(board)
    height, width = shots[0].image.shape
    kept, lost = list(shots), 0
    dropped: list[Dropped] = []
    progress("solving for the lens", 0, STEPS)
    bundle = solve(_observed(kept, points), model, width, height)
    for turn in range(STEPS - 1):
        progress("refitting the corners with that lens", turn + 1, STEPS)
        # Before the corners are refitted, a large residual may be due to the lens: in the first round only
        # gross errors are left out.
        limit = 3.0 if turn == 0 else 1.0
        kept, bad, bundle = _without_bad_views(kept, bundle, limit)
        dropped += bad
        if turn < 2:
            kept, left, bundle = _refitted(kept, board, points, bundle)
            dropped += left
            bundle = refine_bundle(_observed(kept, points), bundle.lens, bundle.poses)
        kept, left, bundle, fewer = _without_outliers(kept, bundle, limit)
        dropped += left
        lost += fewer
        if fewer or left or bad or turn == STEPS - 2:
            bundle = refine_bundle(_observed(kept, points), bundle.lens, bundle.poses)
    return assess(kept, bundle, points, dropped, lost)


def assess(
    shots: Sequence[Shot], bundle: Bundle, points: Array, dropped: Sequence[Dropped], corners_dropped: int
) -> Calibration:
    """Compute the uncertainty and diagnostics of a lens from a finished fit.

    Args:
        shots: views that were used.
        bundle: best fit of lens and poses.
        points: (n, 3) all corners of the board in the board's frame [m].
        dropped: views that were left out.
        corners_dropped: number of single corners that were left out.

    Returns:
        The calibration with lens, covariance, coverage of the image, and reasons against its use.
    """
    scatter = bundle.scatter()
    covariance = bundle.covariance * scatter**2
    covered = coverage([shot.view.place for shot in shots], bundle.lens.width, bundle.lens.height)
    pixels = pixel_sd(bundle.lens, covariance)
    middle = points.mean(axis=0)
    tilts = tuple(tilt(pose, middle) for pose in bundle.poses)
    sd = np.sqrt(np.diag(covariance))
    return Calibration(
        lens=bundle.lens,
        covariance=covariance,
        bundle=bundle,
        shots=tuple(shots),
        dropped=tuple(dropped),
        corners_dropped=corners_dropped,
        pixels=pixels,
        covered=covered,
        tilts=tilts,
        scatter=scatter,
        undetermined=tuple(undetermined(bundle.lens, sd, pixels, tilts, covered)),
        doubts=tuple(doubts(bundle.lens, sd, pixels, scatter, covered)),
    )


def _observed(shots: Sequence[Shot], points: Array) -> list[ObservedView]:
    """Corners of the board that each shot shows: places on the board and in the image, and weights.

    Each entry, one per shot, holds of its m corners the places in the board's frame (m, 3) [m] and in the
    image (m, 2) [px], and the matrices (m, 2, 2) [1/px] that divide a residual by its standard deviation.

    Args:
        shots: images with their corners.
        points: (n, 3) all corners of the board in the board's frame [m].
    """
    return [weighted_corners(shot.view, points) for shot in shots]


def _refitted(
    shots: Sequence[Shot], board: Board, points: Array, bundle: Bundle
) -> tuple[list[Shot], list[Dropped], Bundle]:
    """Refit the corners in all shots (board images) on pixels freed of the fitted lens's distortion.

    If fewer than three shots can be refitted (or not all of one or two), the fitted lens is too inaccurate:
    all shots are then returned unchanged.

    Returns:
        The shots with refitted corners; the shots left out because too few of their corners are sharp; the
        bundle (lens, poses, residuals) of the shots kept, not fitted anew.
    """
    views = [
        refit(shot.image, board, shot.view, points, bundle.lens, pose)
        for shot, pose in zip(shots, bundle.poses, strict=True)
    ]
    if sum(view is not None for view in views) < min(3, len(shots)):
        # The lens is too inaccurate for a refit: the corners are kept, and their residuals will show it.
        return list(shots), [], bundle
    kept = [replace(shot, view=view) for shot, view in zip(shots, views, strict=True) if view is not None]
    left = [
        Dropped(shot.name, "too few corners are sharp")
        for shot, view in zip(shots, views, strict=True)
        if view is None
    ]
    return kept, left, _bundle_of(bundle, [view is not None for view in views])


def _without_bad_views(
    shots: list[Shot], bundle: Bundle, limit: float
) -> tuple[list[Shot], list[Dropped], Bundle]:
    """Leave out shots whose corners lie far from their predictions (motion blur, bent board, misread tag).

    A shot is left out if its median residual exceeds both `limit` times `_BAD_VIEW_RATIO` times the median
    over all shots, and `limit` times `_BAD_VIEW_PX`. None is left out if fewer than three would remain.

    Args:
        shots: images with their corners.
        bundle: fit to these shots.
        limit: factor on both thresholds, above 1 while the lens is still inaccurate.

    Returns:
        The shots kept, those left out, and the bundle (lens, poses, residuals) of the kept ones, not fitted
        anew.
    """
    size = np.array([float(np.sqrt(np.median(np.sum(residual**2, axis=1)))) for residual in bundle.residuals])
    usual = float(np.median(size))
    bad = (size > limit * _BAD_VIEW_RATIO * usual) & (size > limit * _BAD_VIEW_PX)
    if not bad.any() or np.count_nonzero(~bad) < 3:
        return shots, [], bundle
    left = [
        Dropped(
            shot.name,
            f"its corners lie {px:.2f} px off, the others' {usual:.2f} px: it moved, or the board was bent",
        )
        for shot, px, away in zip(shots, size, bad, strict=True)
        if away
    ]
    return list(compress(shots, ~bad)), left, _bundle_of(bundle, ~bad)


def _without_outliers(
    shots: Sequence[Shot], bundle: Bundle, limit: float
) -> tuple[list[Shot], list[Dropped], Bundle, int]:
    """Leave out outlying corners, and shots with more than `_MAX_OUTLIER_SHARE` of them.

    A corner is an outlier if it lies `limit` times `OUTLIER_RATIO` standard deviations or more from its
    prediction; the threshold is scaled up if most corners scatter more than stated. Nothing is left out if
    fewer than three shots would remain.

    Args:
        shots: images with their corners.
        bundle: fit to these shots.
        limit: factor on the threshold, above 1 while the lens is still inaccurate.

    Returns:
        The shots kept, with their remaining corners; the shots left out; the bundle (lens, poses, residuals)
        of the kept shots, not fitted anew, so that its residuals still include the outliers; the number of
        corners left out of kept shots.
    """
    chi = np.concatenate(bundle.sigmas)
    most = limit * OUTLIER_RATIO * max(1.0, float(np.median(chi)) / MEDIAN_CHI)
    good = [sigmas < most for sigmas in bundle.sigmas]
    bad = [float(np.mean(~each)) > _MAX_OUTLIER_SHARE for each in good]
    if sum(not each for each in bad) < 3:
        return list(shots), [], bundle, 0
    left, kept, lost = list[Dropped](), list[Shot](), 0
    for shot, each, away in zip(shots, good, bad, strict=True):
        off = int(np.count_nonzero(~each))
        if away:
            why = f"{off} of its {counted(len(each), 'corner')} lie off: it moved, or the board was bent"
            left.append(Dropped(shot.name, why))
        else:
            kept.append(replace(shot, view=shot.view.only(each)))
            lost += off
    return kept, left, _bundle_of(bundle, [not away for away in bad]), lost


def _bundle_of(bundle: Bundle, kept: Sequence[bool] | NDArray[np.bool_]) -> Bundle:
    """Copy of a calibration's fit (bundle) with only the views that are True in `kept`, not fitted anew.

    Lens, covariance and cost stay those of all views.
    """
    return replace(
        bundle,
        poses=tuple(compress(bundle.poses, kept)),
        residuals=tuple(compress(bundle.residuals, kept)),
        sigmas=tuple(compress(bundle.sigmas, kept)),
    )
