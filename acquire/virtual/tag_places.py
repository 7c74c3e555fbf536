"""Places on an object where tags can be glued: flat enough, seen from six sides.

They serve objects whose file lists no tags, and tags whose place the file leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIZES_M = (0.06, 0.05, 0.04, 0.03, 0.025, 0.02, 0.016, 0.012, 0.009)
"""edges of the black square that are tried [m], largest first"""
CARD_OVER_TAG = 1.25
"""edge of a tag's white card over that of its black square"""
_UNEVEN = 0.15
"""largest distance of the surface from the card's plane, as a fraction of the tag's edge: a 30 mm tag then
fits a wall of 40 mm radius"""
_GLUED_SHARE = 0.2
"""smallest part of a card that lies flat where it juts out, as a fraction of its edge"""
_TILT_COS = float(np.cos(np.radians(20.0)))
"""cosine of the largest angle between the surface's normal and the side from which it is looked at"""
_STRAIGHT_COS = float(np.cos(np.radians(8.0)))
"""cosine of the angle below which the card faces that side exactly, as on a round wall"""
_SIDES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)


@dataclass(frozen=True)
class TagPlace:
    """Place on an object's surface for a tag: pose in O, the object's frame, and the largest tag's edge."""

    T_object_marker: NDArray[np.float64]
    """(4, 4) pose of the tag (x right, y up, z out of the surface) [m]"""
    size_m: float
    """edge of the largest black square that fits [m]"""


def tag_places(triangles: NDArray[np.float64], largest_m: float, legible_m: float = 0.0) -> list[TagPlace]:
    """Places for one tag on each of the six sides of an object where there is room: ±x, ±y, ±z.

    Each is where the largest tag fits, nearest to the middle of the side. Upright sides have the tag's y
    along O's z, top and base along O's y. Where only tags that the camera cannot read lie flat, the card of a
    legible one juts out over the side.

    Args:
        triangles: (n, 3, 3) corners of the surface's triangles [m, in O, the object's frame].
        largest_m: largest edge of a tag's black square [m].
        legible_m: edge of the smallest tag that the camera can read [m]; 0 for no card that juts out.
    """
    places = [_place_on_side(triangles, side, largest_m, legible_m) for side in _SIDES]
    return [place for place in places if place is not None]


def _place_on_side(
    triangles: NDArray[np.float64], side: NDArray[np.float64], largest_m: float, legible_m: float
) -> TagPlace | None:
    """Place for the largest tag on one side of an object; None if there is none.

    Args:
        triangles: (n, 3, 3) corners of the surface's triangles [m, in O, the object's frame].
        side: (3,) unit vector out of the object, along an axis.
        largest_m: largest edge of a tag's black square [m].
        legible_m: edge of the smallest tag that the camera can read [m]; 0 for no card that juts out.
    """
    up = np.array([0.0, 1.0, 0.0]) if side[2] else np.array([0.0, 0.0, 1.0])
    R_side = np.column_stack([np.cross(up, side), up, side])
    local = triangles @ R_side
    low, high = local.min(axis=(0, 1)), local.max(axis=(0, 1))
    share = np.array([(a, b) for a in (0, -0.15, 0.15, -0.3, 0.3) for b in (0, -0.15, 0.15, -0.3, 0.3)])
    share = share[np.argsort(np.abs(share).sum(axis=1), kind="stable")]
    middles = (low[:2] + high[:2]) / 2 + share * (high[:2] - low[:2])
    heights, hit = _heights(local, middles)
    best: TagPlace | None = None
    poses: list[NDArray[np.float64]] = []
    for middle, height, face in zip(middles, heights, hit, strict=True):
        if not np.isfinite(height):
            continue
        corners = local[face]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        if normal[2] < _TILT_COS:
            continue
        if normal[2] > _STRAIGHT_COS:
            normal = np.array([0.0, 0.0, 1.0])
        right = np.cross([0.0, 1.0, 0.0], normal)
        right /= np.linalg.norm(right)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([right, np.cross(normal, right), normal])
        T[:3, 3] = *middle, height
        poses.append(T)
        for size in SIZES_M:
            if best is not None and size <= best.size_m:
                break
            if size <= largest_m and _lies_flat(local, T, size):
                pose = np.eye(4)
                pose[:3] = R_side @ T[:3]
                best = TagPlace(pose, size)
                break
    if best is None or best.size_m < legible_m:
        return _jutting_place(local, R_side, poses, legible_m) or best
    return best


def _jutting_place(
    local: NDArray[np.float64],
    R_side: NDArray[np.float64],
    poses: list[NDArray[np.float64]],
    legible_m: float,
) -> TagPlace | None:
    """Place for a legible tag whose card juts out over a side that is too narrow for it; None without one.

    The card's middle must lie flat, and no part of the object may stand before it.

    Args:
        local: (n, 3, 3) corners of the surface's triangles [m], z towards the viewer.
        R_side: (3, 3) rotation from that frame to O, the object's frame.
        poses: poses (4, 4) of the card to try, in the same frame, best first.
        legible_m: edge of the smallest legible tag [m].
    """
    size = min((each for each in SIZES_M if each >= legible_m), default=None)
    if size is None or not legible_m:
        return None
    for T in poses:
        if _lies_flat(local, T, _GLUED_SHARE * size) and _stands_free(local, T, size):
            pose = np.eye(4)
            pose[:3] = R_side @ T[:3]
            return TagPlace(pose, size)
    return None


def _stands_free(local: NDArray[np.float64], T: NDArray[np.float64], size: float) -> bool:
    """True if no part of the surface stands before a tag's card, by more than 0.15 of the tag's edge.

    Args:
        local: (n, 3, 3) corners of the surface's triangles [m], z towards the viewer.
        T: (4, 4) pose of the card in the same frame.
        size: edge of the black square [m].
    """
    steps = np.linspace(-0.5, 0.5, 7) * CARD_OVER_TAG * size
    card = np.array([(a, b, 0.0) for a in steps for b in steps]) @ T[:3, :3].T + T[:3, 3]
    heights, _ = _heights(local, card[:, :2])
    return bool((heights - card[:, 2] <= _UNEVEN * size).all())


def _lies_flat(local: NDArray[np.float64], T: NDArray[np.float64], size: float) -> bool:
    """True if the corners and the middles of the sides of a tag's card lie on the surface.

    Their distance from it, along z, may be up to 0.15 times the length of the tag's edge.

    Args:
        local: (n, 3, 3) corners of the surface's triangles [m], z towards the viewer.
        T: (4, 4) pose of the card in the same frame.
        size: edge of the black square [m].
    """
    half = CARD_OVER_TAG * size / 2
    rim = np.array([(a, b, 0.0) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]) * half
    points = rim @ T[:3, :3].T + T[:3, 3]
    heights, _ = _heights(local, points[:, :2])
    return bool(np.isfinite(heights).all() and np.abs(heights - points[:, 2]).max() <= _UNEVEN * size)


def _heights(
    local: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Highest z of a surface at points (n, 2), and its triangle; -inf where there is none.

    Args:
        local: (m, 3, 3) corners of the surface's triangles [m].
        points: (n, 2) x and y [m].
    """
    origin, edge, other = local[:, 0], local[:, 1] - local[:, 0], local[:, 2] - local[:, 0]
    area = edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0]
    safe = np.where(area == 0, 1.0, area)
    near = points[:, None, :] - origin[:, :2]
    u = (near[..., 0] * other[:, 1] - near[..., 1] * other[:, 0]) / safe
    v = (edge[:, 0] * near[..., 1] - edge[:, 1] * near[..., 0]) / safe
    hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (area != 0)
    heights = np.where(hit, origin[:, 2] + u * edge[:, 2] + v * other[:, 2], -np.inf)
    return heights.max(axis=1), heights.argmax(axis=1)
