"""Tags of the mat as they are seen in an image, the mean over several, and the shift between two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.tags.mat import Mat, MatTag
    from analyze.types import Array

MOVED_PX = 0.4
"""least shift of the tags' corners in the image that shows a moved camera [px]"""
MOVED_SIGMAS = 6.0
"""least shift of the corners, in standard deviations of the difference of two images"""


@dataclass(frozen=True)
class MatView:
    """Tags of one mat in one image, or the mean of several, with their corners."""

    mat: Mat
    """the mat"""
    tags: tuple[MatTag, ...]
    """the n tags that are seen"""
    corners: Array
    """(n, 4, 2) corners, free of lens distortion [ideal px]"""
    covariance: Array
    """(n, 4, 2, 2) covariance of each corner by the image's noise [px^2]"""


def mean_view(views: Sequence[MatView]) -> MatView | None:
    """Mean of several images of a camera and mat that stand still; None without any.

    Each tag's corners are averaged over the images in which it is seen, with the median's error where one of
    them differs.

    Args:
        views: the tags in each image; those of another mat than most show are not used.
    """
    if not views:
        return None
    papers = [view.mat.paper for view in views]
    layout = views[papers.index(max(papers, key=papers.count))].mat
    seen: dict[MatTag, list[tuple[Array, Array]]] = {}
    for view in views:
        if view.mat.paper == layout.paper:
            for tag, corners, covariance in zip(view.tags, view.corners, view.covariance, strict=True):
                seen.setdefault(tag, []).append((corners, covariance))
    means = [np.median([corners for corners, _ in each], axis=0) for each in seen.values()]
    spreads = [
        np.mean([covariance for _, covariance in each], axis=0) * _median_variance(len(each))
        for each in seen.values()
    ]
    return MatView(layout, tuple(seen), np.array(means), np.array(spreads))


def _median_variance(many: int) -> float:
    """Variance of the median of many values, over that of one: up to pi/2 times the mean's."""
    return (1.0 if many < 3 else 0.5 * math.pi) / many


def without_tag(view: MatView, index: int) -> MatView:
    """View without the tag of this index."""
    return only_tags(view, [tag for number, tag in enumerate(view.tags) if number != index])


def only_tags(view: MatView, tags: Sequence[MatTag]) -> MatView:
    """View with only these of its tags, in this order."""
    where = [view.tags.index(tag) for tag in tags]
    return MatView(view.mat, tuple(tags), view.corners[where], view.covariance[where])


def view_shift(before: MatView, after: MatView) -> float | None:
    """Shift [px] in the image of the tags that two views share, their median; None if they share none.

    0 if it is within the images' noise. Shapes are those of `MatView`: corners (n, 4, 2).

    Args:
        before: tags in the earlier image.
        after: tags in the later image.
    """
    common = [tag for tag in before.tags if tag in after.tags]
    if not common:
        return None
    first, second = only_tags(before, common), only_tags(after, common)
    shifts = np.sqrt(np.mean(np.sum((second.corners - first.corners) ** 2, axis=-1), axis=-1))
    noise = np.sqrt(np.trace(first.covariance + second.covariance, axis1=-2, axis2=-1).mean(axis=-1))
    middle = float(np.median(shifts))
    return middle if middle > max(MOVED_PX, MOVED_SIGMAS * float(np.median(noise))) else 0.0
