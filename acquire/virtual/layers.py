"""Opaque layers, front to back, each with its light and the part of every pixel that it covers."""

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
    """Light and cover within `box`, both (box height, box width)."""

    box: Box
    light: NDArray[np.float32]
    """grey levels times cover"""
    cover: NDArray[np.float32]
    """0..1"""


@dataclass(frozen=True)
class Outline:
    """Directed lines in pixels, for k sub-exposures; see `coverage` for their orientation."""

    start: NDArray[np.float64]
    """(k, m, 2) px"""
    end: NDArray[np.float64]
    """(k, m, 2) px"""
    value: NDArray[np.float64]
    """(m,) grey levels inside minus outside"""
    cover: NDArray[np.float64]
    """(m,) cover inside minus outside"""


def layer(outline: Outline, width: int, height: int) -> Layer | None:
    """Fill an outline, mean over its sub-exposures; None where it lies outside the image of width x height."""
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


def bounds(layers: Sequence[Layer]) -> Box:
    """Smallest box around at least one layer."""
    return Box(
        min(item.box.left for item in layers),
        min(item.box.top for item in layers),
        max(item.box.right for item in layers),
        max(item.box.bottom for item in layers),
    )


def covered(back: Layer, front: Sequence[Layer]) -> Layer:
    """`back` with small layers over it, each hiding what it covers."""
    box = bounds([back, *front])
    found = back
    if box != back.box:
        found = Layer(box, *(np.zeros((box.bottom - box.top, box.right - box.left), np.float32) for _ in range(2)))
        found.light[back.box.within(box)], found.cover[back.box.within(box)] = back.light, back.cover
    for item in front:
        inside, free = item.box.within(box), 1.0 - item.cover
        found.light[inside] = found.light[inside] * free + item.light
        found.cover[inside] = found.cover[inside] * free + item.cover
    return found


def composed(front_to_back: Sequence[Layer]) -> Layer:
    """One layer from several that hide one another.

    Where two share a pixel the front one takes its cover first; neighbours that meet at an edge fill it completely, without a seam.
    """
    if len(front_to_back) == 1:
        return front_to_back[0]
    box = bounds(front_to_back)
    light, cover = (np.zeros((box.bottom - box.top, box.right - box.left), np.float32) for _ in range(2))
    for item in front_to_back:
        inside = item.box.within(box)
        share = np.minimum((1.0 - cover[inside]) / np.maximum(item.cover, np.float32(1e-6)), np.float32(1.0))
        light[inside] += item.light * share
        cover[inside] += item.cover * share
    return Layer(box, light, cover)


def paint(scene: NDArray[np.float32], item: Layer) -> None:
    """Draw a layer over `scene` (height, width), in place."""
    target = scene[item.box.slices]
    target *= 1.0 - item.cover
    target += item.light


def paint_shadow(scene: NDArray[np.float32], item: Layer, depth: float) -> None:
    """Darken `scene` (height, width) by `depth` (0..1) where the layer covers it, in place."""
    scene[item.box.slices] *= 1.0 - np.float32(depth) * item.cover
