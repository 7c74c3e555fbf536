"""Print on a face of a body as one strike showed it at rest: points, grey values and features in O.

Such a view serves as a tag does: it has a name, a place on the object and corners, which the fit of its
points to another image determines. Its place is as uncertain as the pose at rest was.
"""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.print_features import detect_features
from analyze.tracking.print_likeness import PrintedSurface
from analyze.tracking.print_template import points_on_planes, print_template, visible_triangles
from analyze.types import Marker

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.tracking.print_likeness import RestView
    from analyze.types import Array, CameraModel, IntArray

VIEW_PREFIX = "print-"
"""beginning of a view's name; the id of its strike follows"""
PLACE_SD, TURN_SD = 4e-4, np.radians(0.25)
"""1 sigma of a view's place in O along each axis [m], and of its turn about each axis [rad]: errors of the
pose at rest"""
VIEW_BLURS_PX = (6.0, 2.4, 0.8)
"""1 sigma of the blur of the levels in the image at rest [px]: an object in flight is up to four times
smaller, and is compared with as much detail as its image shows"""
MAX_POINTS = 1500
"""largest number of points of a strike's views"""
MIN_COSINE = 0.45
"""least cosine between the surface's normal and the line of sight at rest: print seen at grazing angles is
smeared"""
MIN_POINTS = 120
"""number of points below which a view is not used"""
MIN_NEW_SHARE = 0.25
"""share of a view's points that no view taken before shows, below which it is not used"""
COMPARED_POINTS = 150
"""number of points of a view by which it is compared with others"""
SAME_PRINT_M = 6e-3
"""distance of two points [m] below which they show the same print"""
MAX_FLATNESS = 0.1
"""depth of the points over their breadth below which they lie in a plane"""


@dataclass(frozen=True)
class PrintedView:
    """Print on one face of a body as one strike showed it."""

    name: str
    """`VIEW_PREFIX` and the strike's id, with a number if it showed more than one face"""
    size: float
    """edge of the square in the points' middle that stands for the view [m]"""
    T_object_view: Array
    """(4, 4) pose of the square in O, translation in m"""
    points: Array
    """(m, 3) points of the surface in O [m]"""
    normals: Array
    """(m, 3) outward normals there"""
    grey: Array
    """(levels, m) grey values at rest"""
    slope: Array
    """(levels, m, 3) gradient along the surface, in O [grey/m]"""
    px_per_m: float
    """scale of the image at rest in the points' middle [px/m]"""
    features: Array
    """(f, 3) points of the surface in O with a descriptor [m]"""
    descriptors: NDArray[np.float32]
    """(f, 128) their SIFT descriptors (Lowe 2004)"""

    @property
    def marker(self) -> Marker:
        """The square as a marker."""
        return Marker(self.name, self.size, self.T_object_view, PLACE_SD, TURN_SD)


def printed_views(
    views: Mapping[str, RestView], vertices: Array, triangles: IntArray
) -> tuple[PrintedView, ...]:
    """Views of a body's print by strikes; those that show hardly more than others are left out.

    So are strikes that show other print on a face than another strike: one of the two was put down wrongly.

    Args:
        views: the object at rest by strike id.
        vertices: (v, 3) vertices in O [m].
        triangles: (t, 3) indices, counter-clockwise from outside.
    """
    differences = PrintedSurface(vertices, triangles).differences(views)
    doubtful = {name for each in differences for name in each.strikes}
    found = [
        each
        for name, view in views.items()
        if name not in doubtful
        for each in _views_by_face(f"{VIEW_PREFIX}{name}", view, vertices, triangles)
    ]
    # Those with the most detail lead.
    found.sort(key=lambda each: -each.px_per_m * len(each.points))
    kept: list[PrintedView] = []
    for each in found:
        if _new_share(each, kept) > MIN_NEW_SHARE:
            kept.append(each)
    return tuple(kept)


def _new_share(view: PrintedView, others: Sequence[PrintedView]) -> float:
    """Share of a view's points that no other view shows."""
    some = view.points[:: max(1, len(view.points) // COMPARED_POINTS)]
    new = np.ones(len(some), dtype=bool)
    for other in others:
        new &= np.linalg.norm(some[:, None] - other.points, axis=2).min(axis=1) > SAME_PRINT_M
    return float(np.mean(new))


def _views_by_face(name: str, view: RestView, vertices: Array, triangles: IntArray) -> list[PrintedView]:
    """Views of the faces that one strike showed.

    Each face is a view of its own: an error of the pose at rest shifts the print on each in another way.
    """
    camera = _of_part(view)
    R, p = view.R_world_object, view.p_world_object
    image = view.image.astype(np.float32)
    template = print_template([image, image], camera, vertices, triangles, (R, p), MAX_POINTS, VIEW_BLURS_PX)
    if not len(template.points):
        return []
    features, descriptors = _features(view, camera, vertices, triangles)
    points = (template.points - p) @ R
    nearest = np.linalg.norm(features[:, None] - points, axis=2).argmin(axis=1)
    sight = camera.T_world_camera[:3, 3] - template.points
    away = np.linalg.norm(sight, axis=1)
    shown = np.sum(template.normals * sight, axis=1) > MIN_COSINE * away
    faces = [face for face in range(template.faces) if np.sum(shown & (template.face == face)) >= MIN_POINTS]
    found: list[PrintedView] = []
    for number, face in enumerate(faces, 1):
        kept = shown & (template.face == face)
        middle, toward = points[kept].mean(axis=0), (sight[kept] / away[kept, None]).mean(axis=0) @ R
        on_face = template.face[nearest] == face
        found.append(
            PrintedView(
                name if len(faces) == 1 else f"{name}-{number}",
                *_square(points[kept], middle, toward),
                points[kept],
                template.normals[kept] @ R,
                template.grey[:, kept],
                template.slope.mean(axis=0)[:, kept] @ R,
                float(camera.K[0, 0] / np.mean(away[kept])),
                features[on_face],
                descriptors[on_face],
            )
        )
    return found


def _of_part(view: RestView) -> CameraModel:
    """Camera that takes only the part of the image which a view holds, free of lens distortion."""
    K = view.camera.K.copy()
    K[:2, 2] -= view.origin
    height, width = view.image.shape
    return replace(view.camera, width=width, height=height, K=K, distortion=np.zeros(5))


def _square(points: Array, middle: Array, toward: Array) -> tuple[float, Array]:
    """Edge [m] and pose (4, 4) in O of a square in the points' middle, in their plane if they have one.

    Otherwise it lies across the direction `toward` (3,).
    """
    _, size, axes = np.linalg.svd(points - middle, full_matrices=False)
    z = axes[2] * np.sign(axes[2] @ toward) if size[2] < MAX_FLATNESS * size[1] else toward
    z = z / np.linalg.norm(z)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    pose[:3, 3] = middle
    across = (points - middle) @ pose[:3, :2]
    return 2.0 * float(np.sqrt(np.mean(across**2))), pose


def _features(
    view: RestView, camera: CameraModel, vertices: Array, triangles: IntArray
) -> tuple[Array, NDArray[np.float32]]:
    """Places (f, 3) in O [m] and descriptors (f, 128) of features on the surface."""
    R, p = view.R_world_object, view.p_world_object
    placed = vertices @ R.T + p
    drawn, _ = visible_triangles(camera, placed, triangles)
    pixels, descriptors = detect_features(view.image, (drawn >= 0).astype(np.uint8))
    at = np.rint(pixels).astype(np.int64)
    triangle = drawn[at[:, 1], at[:, 0]]
    on = triangle >= 0
    corner = placed[triangles[triangle[on]]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return (points_on_planes(camera, pixels[on], corner[:, 0], normal) - p) @ R, descriptors[on]
