"""Opaque image layers, each with grey levels and the covered fraction of every pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.coverage import Box, box_around, coverage

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


@dataclass(frozen=True)
class Layer:
    """Grey levels times covered fraction, and covered fraction 0..1, of the pixels in a box of the image."""

    box: Box
    """pixels that the layer may cover"""
    light: NDArray[np.float32]
    """(box height, box width) grey levels times cover"""
    cover: NDArray[np.float32]
    """(box height, box width) covered fraction, 0..1"""


@dataclass(frozen=True)
class Outline:
    """Directed boundary lines of areas in the image [px], for k sub-exposures (poses during one exposure).

    The inside of a line is on its right as seen in the image (x right, y down), going from start to end. Each
    line has the steps, inside minus outside, of grey level and of cover (1 where an area covers the image).
    """

    start: NDArray[np.float64]
    """(k, m, 2) start points [px]"""
    end: NDArray[np.float64]
    """(k, m, 2) end points [px]"""
    value: NDArray[np.float64]
    """(m,) grey levels inside minus outside"""
    cover: NDArray[np.float64]
    """(m,) cover inside minus outside"""


def cut_lines(
    first: NDArray[np.float64], last: NDArray[np.float64], pieces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Cut each of n lines into equal pieces, so that lens distortion can bend it.

    Args:
        first: (n, d) start points.
        last: (n, d) end points.
        pieces: (n,) number of pieces of each line, at least 1.

    Returns:
        Points (p, d) along the lines, line after line, and for each of the q pieces the index (q,) of its
        start point. The end point of a piece is the point after its start point.
    """
    share = [np.linspace(0.0, 1.0, count + 1)[:, None] for count in pieces]
    points = np.concatenate([a + s * (b - a) for a, b, s in zip(first, last, share, strict=True)])
    return points, np.delete(np.arange(len(points)), np.cumsum(pieces + 1) - 1)


def filled_layer(outline: Outline, width: int, height: int) -> Layer | None:
    """Image layer of the areas within an outline, averaged over its sub-exposures.

    Sub-exposures are poses during one exposure. A layer has, for each pixel of a box of the image, the
    fraction that is covered, and this fraction times the grey level. None if the outline has no lines or lies
    outside the image of width x height px.
    """
    if outline.start.shape[1] == 0:
        return None
    both = np.concatenate([outline.start.reshape(-1, 2), outline.end.reshape(-1, 2)])
    box = box_around(both, width, height)
    if box.empty:
        return None
    count = outline.start.shape[0]
    weights = np.tile(np.stack([outline.value, outline.cover]) / count, count)
    light, cover = coverage(outline.start.reshape(-1, 2), outline.end.reshape(-1, 2), weights, box)
    return Layer(box, light, cover)


def bounding_box(layers: Sequence[Layer]) -> Box:
    """Smallest box of pixels that contains the boxes of one or more layers."""
    return Box(
        min(item.box.left for item in layers),
        min(item.box.top for item in layers),
        max(item.box.right for item in layers),
        max(item.box.bottom for item in layers),
    )


def overlay(back: Layer, front: Sequence[Layer]) -> Layer:
    """Layer `back` with the layers `front` drawn over it in order, each hiding the area that it covers.

    The result's box contains the boxes of all these layers. If the box of `back` does already, `back` itself
    is changed and returned.
    """
    box = bounding_box([back, *front])
    found = back
    if box != back.box:
        found = Layer(
            box, *(np.zeros((box.bottom - box.top, box.right - box.left), np.float32) for _ in range(2))
        )
        found.light[back.box.within(box)], found.cover[back.box.within(box)] = back.light, back.cover
    for item in front:
        inside, free = item.box.within(box), 1.0 - item.cover
        found.light[inside] = found.light[inside] * free + item.light
        found.cover[inside] = found.cover[inside] * free + item.cover
    return found


def masked(item: Layer, hiding: Sequence[Layer]) -> Layer:
    """Layer `item` without the fraction of each pixel that the layers `hiding` cover together."""
    if not hiding:
        return item
    hidden = np.zeros_like(item.cover)
    for front in hiding:
        shared = Box(
            left=max(item.box.left, front.box.left),
            top=max(item.box.top, front.box.top),
            right=min(item.box.right, front.box.right),
            bottom=min(item.box.bottom, front.box.bottom),
        )
        if not shared.empty:
            hidden[shared.within(item.box)] += front.cover[shared.within(front.box)]
    seen = np.asarray(1.0 - np.minimum(hidden, np.float32(1.0)), np.float32)
    return Layer(item.box, item.light * seen, item.cover * seen)


def compose(front_to_back: Sequence[Layer]) -> Layer:
    """Combine one or more layers that hide one another, given from front to back, and return one layer.

    Per pixel, a layer has its light (grey level times cover) and its cover (fraction 0..1 of the pixel that
    it hides). In a shared pixel the front layer takes its cover first, and layers behind it only what is
    left; two layers that meet at an edge fill it without a seam. A single layer is returned as it is.
    """
    if len(front_to_back) == 1:
        return front_to_back[0]
    box = bounding_box(front_to_back)
    light, cover = (np.zeros((box.bottom - box.top, box.right - box.left), np.float32) for _ in range(2))
    for item in front_to_back:
        inside = item.box.within(box)
        share = np.minimum((1.0 - cover[inside]) / np.maximum(item.cover, np.float32(1e-6)), np.float32(1.0))
        light[inside] += item.light * share
        cover[inside] += item.cover * share
    return Layer(box, light, cover)


def paint(scene: NDArray[np.float32], item: Layer) -> None:
    """Draw the layer `item` of grey levels over the image `scene` (height, width), in place.

    The layer hides the image in proportion to the fraction of each pixel that it covers.
    """
    target = scene[item.box.slices]
    target *= 1.0 - item.cover
    target += item.light


def paint_shadow(scene: NDArray[np.float32], item: Layer, depth: float) -> None:
    """Darken the image `scene` (height, width) in place where the layer `item` covers it.

    A fully covered pixel loses the fraction `depth` (0..1) of its grey level.
    """
    scene[item.box.slices] *= 1.0 - np.float32(depth) * item.cover
