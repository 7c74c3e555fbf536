"""Makes the picture of a fixture: `python docs/fixture_picture.py OBJECT.toml PICTURE.png`."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 640, 620
"""size of one view [px]"""
OVERSAMPLED = 2
MARGIN_PX = 30
LIGHT = np.array([0.3, -0.6, 0.75])
FIXTURE, OBJECT = (0.62, 0.74, 0.88), (0.93, 0.70, 0.38)
"""colours, red, green, blue"""
EDGE_DEPTH = 2.5
"""step in depth that is drawn as an edge [mm]"""
Part = tuple[np.ndarray, np.ndarray, tuple[float, float, float]]


def view(parts: list[Part], azimuth: float, elevation: float) -> np.ndarray:
    """Draw surfaces, shaded and with their edges, from a direction [deg]; white background, BGR.

    Args:
        parts: vertices (n, 3) [mm], faces (f, 3) and colour of each surface.
        azimuth: direction around z.
        elevation: height of the eye.
    """
    a, e = np.radians([azimuth, elevation])
    right = np.array([np.cos(a), np.sin(a), 0.0])
    ahead = np.array([-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)])
    turn = np.stack([right, np.cross(right, ahead), ahead])
    size = OVERSAMPLED * np.array([WIDTH, HEIGHT])
    flat = np.vstack([vertices for vertices, _, _ in parts]) @ turn.T
    low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
    scale = float(np.min((size - 2 * OVERSAMPLED * MARGIN_PX) / (high - low)))
    offset = size / 2 - scale * (low + high) / 2
    depth = np.full(size[::-1], 1e6)
    colour, normals = np.ones((*size[::-1], 3)), np.zeros((*size[::-1], 3))
    for vertices, faces, rgb in parts:
        across = np.cross(
            vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
        )
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        places = vertices @ turn.T
        pixels = places[:, :2] * scale + offset
        pixels[:, 1] = size[1] - pixels[:, 1]
        for face, normal in zip(faces, across, strict=True):
            if normal @ ahead < 0:
                shade = 0.45 + 0.55 * max(0.0, float(normal @ LIGHT) / float(np.linalg.norm(LIGHT)))
                mask, window = _nearer(pixels[face], places[face, 2], depth)
                colour[window][mask] = shade * np.array(rgb)
                normals[window][mask] = normal
    edge = np.zeros(depth.shape, dtype=bool)
    for axis, part in ((0, np.s_[:-1]), (1, np.s_[:, :-1])):
        turned = np.abs(np.diff(normals, axis=axis)).sum(axis=2) > 0.6
        edge[part] |= turned | (np.abs(np.diff(depth, axis=axis)) > EDGE_DEPTH)
    colour[edge] *= 0.3
    image = np.round(255 * colour[..., ::-1]).astype(np.uint8)
    return cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


def _nearer(
    corners: np.ndarray, heights: np.ndarray, depth: np.ndarray
) -> tuple[np.ndarray, tuple[slice, slice]]:
    """Pixels that a triangle covers before all others so far; enters its depth there.

    Args:
        corners: (3, 2) corners of the triangle [px].
        heights: (3,) their distances from the eye.
        depth: (h, w) least distance so far; changed.

    Returns:
        Mask of the pixels in a window of the image, and the window.
    """
    x0, y0 = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
    x1, y1 = np.ceil(corners.max(axis=0)).astype(int) + 1
    window = (slice(y0, y1), slice(x0, x1))
    y, x = np.mgrid[window] + 0.5
    y, x = (
        y[: depth[window].shape[0], : depth[window].shape[1]],
        x[: depth[window].shape[0], : depth[window].shape[1]],
    )
    (ax, ay), (bx, by), (cx, cy) = corners
    double = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(double) < 1e-9:
        return np.zeros(x.shape, dtype=bool), window
    u = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / double
    v = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / double
    distance = heights[0] + u * (heights[1] - heights[0]) + v * (heights[2] - heights[0])
    mask = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6) & (distance < depth[window])
    depth[window][mask] = distance[mask]
    return mask, window


def main() -> int:
    """Draw the fixture of an object: with the object above it, and in it; return 2 on wrong usage, else 0."""
    if len(sys.argv) != 3:
        sys.stderr.write("usage: python docs/fixture_picture.py OBJECT.toml PICTURE.png\n")
        return 2
    from analyze.fixture.hold import HOLDS, HoldKind
    from analyze.fixture.print_mass import PrintMaterial
    from analyze.verbs.fixture.design_files import FixtureOptions, fixture_for

    found = fixture_for(
        Path(sys.argv[1]), FixtureOptions(HOLDS[HoldKind.FRICTION], PrintMaterial(), 220.0, 12)
    )
    place, mesh = found.made.setting.placement, found.made.mesh
    thing = place.to_fixture(found.model.vertices)
    lifted = thing + np.array([0.0, 0.0, place.depth + 8.0])
    base = (mesh.vertices, mesh.faces, FIXTURE)
    views = [
        view([base, (lifted, found.model.faces, OBJECT)], -35.0, 30.0),
        view([base], -35.0, 55.0),
        view([base, (thing, found.model.faces, OBJECT)], -35.0, 30.0),
    ]
    cv2.imwrite(sys.argv[2], np.hstack(views), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


if __name__ == "__main__":
    sys.exit(main())
