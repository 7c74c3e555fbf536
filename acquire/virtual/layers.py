"""Opaque image layers, each with its light and the covered fraction of every pixel."""

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
    """Light and cover within a box."""

    box: Box
    light: NDArray[np.float32]
    """(box height, box width) grey levels times cover"""
    cover: NDArray[np.float32]
    """(box height, box width) covered fraction, 0..1"""


@dataclass(frozen=True)
class Outline:
    """Directed lines in the image, for k sub-exposures; see `coverage` for their orientation."""

    start: NDArray[np.float64]
    """(k, m, 2) start points [px]"""
    end: NDArray[np.float64]
    """(k, m, 2) end points [px]"""
    value: NDArray[np.float64]
    """(m,) grey levels inside minus outside"""
    cover: NDArray[np.float64]
    """(m,) cover inside minus outside"""


def filled_layer(outline: Outline, width: int, height: int) -> Layer | None:
    """Filled outline, averaged over its sub-exposures; None if it lies outside the image."""
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
    """Smallest box around one or more layers."""
    return Box(
        min(item.box.left for item in layers),
        min(item.box.top for item in layers),
        max(item.box.right for item in layers),
        max(item.box.bottom for item in layers),
    )


def overlay(back: Layer, front: Sequence[Layer]) -> Layer:
    """Layer `back` with small layers drawn over it, each hiding the area that it covers."""
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


def compose(front_to_back: Sequence[Layer]) -> Layer:
    """Combine layers that hide one another, given from front to back, into one layer.

    In a shared pixel the front layer takes its cover first; neighbours that meet at an edge fill it without a
    seam.
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
    """Draw a layer over `scene` (height, width) in place."""
    target = scene[item.box.slices]
    target *= 1.0 - item.cover
    target += item.light


def paint_shadow(scene: NDArray[np.float32], item: Layer, depth: float) -> None:
    """Darken `scene` (height, width) in place by `depth` (0..1) where the layer covers it."""
    scene[item.box.slices] *= 1.0 - np.float32(depth) * item.cover
