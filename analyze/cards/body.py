"""Drawing of the object: shaded faces from back to front, edges, and tags with their true patterns."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from analyze.cards.drawn_shape import DrawnShape
from analyze.cards.ink import INK, polygon, polyline
from analyze.cards.view import View
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.rotations import apply
from analyze.tags import families
from analyze.types import Array
from schemas.object_spec import MarkerSpec, ObjectSpec

DARK, LIGHT = np.array([150.0, 160.0, 172.0]), np.array([243.0, 245.0, 248.0])
"""Colours (red, green, blue, each 0 to 255) of faces turned away from and towards the light."""
LAMP = np.array([0.25, -0.55, 0.8]) / np.linalg.norm([0.25, -0.55, 0.8])
"""Unit vector towards the light in W."""
SHADES = 28
"""Steps of brightness between `DARK` and `LIGHT`."""
CARD_CELLS = 10
"""Width of a tag as drawn, white rim included, in cells of its pattern."""


@dataclass(frozen=True)
class PlacedObject:
    """Object with its shape and tags, placed in the world frame W of a strike.

    W has z up and the table at z = 0; O is the object frame (the shape file's).
    """

    shape: DrawnShape
    """Faces and edges to draw, in O."""
    spec: ObjectSpec
    """Object file, with the tags."""
    R: Array
    """(3, 3) rotation R_world_object from O to W."""
    p: Array
    """(3,) translation p_world_object from O to W [m]."""

    def world(self, points: Array) -> Array:
        """Positions (..., 3) [m] in the world frame of `points` (..., 3) [m] in the object frame."""
        return points @ self.R.T + self.p

    @property
    def corners(self) -> Array:
        """Corners (n, 3) [m] of the object's convex hull, in the strike's world frame (table at z = 0)."""
        return self.world(self.shape.hull)

    def tipped(self, theta: float) -> PlacedObject:
        """Copy of the object tipped by `theta` [rad] about the world frame's y axis, the pivot line.

        Positive angles tip it towards +x.
        """
        turn = np.array([[np.cos(theta), 0, np.sin(theta)], [0, 1, 0], [-np.sin(theta), 0, np.cos(theta)]])
        return PlacedObject(self.shape, self.spec, turn @ self.R, turn @ self.p)

    def tag_corners(self, marker: MarkerSpec, half: float) -> Array:
        """Corners (4, 3) [m] of a square about a tag's centre and in its plane, in the world frame.

        The order is upper left, upper right, lower right, lower left of the tag.

        Args:
            marker: Tag; its pose on the object must be given.
            half: Half the edge of the square [m].
        """
        square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        return self.world(apply(np.array(marker.T_object_marker), square))

    def tag_centre(self, name: int | str) -> Array | None:
        """Centre (3,) [m] of the tag `name`, in the world frame.

        None if there is no such tag, or its place on the object is not given.
        """
        for marker in self.spec.marker:
            if marker.name == name and marker.T_object_marker is not None:
                return self.world(np.array(marker.T_object_marker)[:3, 3])
        return None


def draw_body(
    view: View, body: PlacedObject, highlighted: tuple[int | str, ...] = (), ring: str = INK
) -> list[str]:
    """SVG elements of the object's visible faces, edges and tags, farthest first.

    Args:
        view: Projection to the picture.
        body: Object, placed in the world frame.
        highlighted: Names of tags that get a frame of the colour `ring`.
        ring: Colour of these frames.
    """
    items: list[tuple[float, str, str]] = [
        *_faces(view, body),
        *_edges(view, body),
        *_tags(view, body, highlighted, ring),
    ]
    elements: list[str] = []
    # Successive faces of one tone become one element, which halves the size of a picture of a fine mesh.
    for tone, same in groupby(sorted(items, key=lambda item: item[0]), key=lambda item: item[1]):
        drawn = "".join(content for _, _, content in same)
        elements.append(
            f'<path d="{drawn}" fill="{tone}" stroke="{tone}" stroke-width="1.2"/>' if tone else drawn
        )
    return elements


def _faces(view: View, body: PlacedObject) -> list[tuple[float, str, str]]:
    """Faces turned towards the eye, each as a tuple of nearness [m], colour and SVG path data.

    Nearness is the distance of the face's centre from the point at which the eye looks, along the direction
    to the eye; greater is nearer. The colour (#rrggbb) follows the light.
    """
    triangles, normals = body.world(body.shape.triangles), body.shape.normals @ body.R.T
    middles = triangles.mean(axis=1)
    seen = np.einsum("ti,ti->t", normals, view.towards_eye(middles)) > 0
    triangles, normals, middles = triangles[seen], normals[seen], middles[seen]
    light = np.round(SHADES * np.clip(0.5 + 0.5 * normals @ LAMP, 0, 1)) / SHADES
    colours = DARK + light[:, None] * (LIGHT - DARK)
    flat = view.project(triangles.reshape(-1, 3)).reshape(-1, 3, 2)
    near = view.nearness(middles)
    found: list[tuple[float, str, str]] = []
    for points, colour, depth in zip(flat, colours, near, strict=True):
        tone = "#{:02x}{:02x}{:02x}".format(*(round(float(each)) for each in colour))
        found.append((float(depth), tone, "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z"))
    return found


def _edges(view: View, body: PlacedObject) -> list[tuple[float, str, str]]:
    """Outline and visible sharp edges of the object: tuples of nearness [m], "" and SVG element.

    Nearness is how far the edge's middle lies towards the eye from the point looked at, plus a small length
    by which an edge is drawn after its face. The "" stands in place of a fill colour, as a line has none.
    Edges of a shape that is not convex are cut into pieces, one tuple each.
    """
    shape = body.shape
    ends, sides = body.world(shape.edges), shape.edge_normals @ body.R.T
    towards = view.towards_eye(ends.mean(axis=1))
    facing = np.einsum("esi,ei->es", sides, towards) > 0
    outline = facing[:, 0] != facing[:, 1]
    shown = outline | (facing.any(axis=1) & np.array(shape.creases, dtype=bool))
    pieces = 1 if shape.convex else 6
    found: list[tuple[float, str, str]] = []
    for (start, end), is_outline in zip(ends[shown], outline[shown], strict=True):
        stops = start + np.linspace(0, 1, pieces + 1)[:, None] * (end - start)
        flat, near = view.project(stops), view.nearness(stops)
        for i in range(pieces):
            depth = (near[i] + near[i + 1]) / 2 + _decoration_lead(shape)
            found.append((float(depth), "", polyline(flat[i : i + 2], INK, 2.2 if is_outline else 1.4)))
    return found


def _tags(
    view: View, body: PlacedObject, highlighted: tuple[int | str, ...], ring: str
) -> list[tuple[float, str, str]]:
    """Tags with a known pose that face the eye, each as a tuple of nearness [m], "" and SVG elements.

    Nearness is measured from the point at which the eye looks, along the direction to the eye; added is a
    length that draws a tag after its face and the edges.

    Args:
        view: Projection to the picture.
        body: Object, placed in the world frame.
        highlighted: Names of tags that get a thick frame.
        ring: Colour of that frame.
    """
    found: list[tuple[float, str, str]] = []
    for marker in body.spec.marker:
        if marker.T_object_marker is None:
            continue
        code = families.cells(marker.family, marker.id)
        half = marker.size_m / 2 * CARD_CELLS / len(code)
        card = body.tag_corners(marker, half)
        normal = body.R @ np.array(marker.T_object_marker)[:3, 2]
        if normal @ view.towards_eye(card.mean(axis=0))[0] <= 0:
            continue
        lit = marker.name in highlighted
        near = float(view.nearness(card).mean()) + 1.01 * _decoration_lead(body.shape)
        parts = [polygon(view.project(card), "#fff", ring if lit else "#8a939c", 5 if lit else 0.8)]
        parts.append(f'<path d="{_black(view, body, marker, code)}" fill="#111"/>')
        found.append((near, "", "".join(parts)))
    return found


def _black(view: View, body: PlacedObject, marker: MarkerSpec, code: BoolArray) -> str:
    """SVG path data of a tag's black cells, as one quadrilateral for each run of cells in a row.

    Cells are the squares of the tag's pattern.

    Args:
        view: Projection to the picture.
        body: Object, placed in the world frame.
        marker: Tag; its pose on the object must be given.
        code: (c, c) cells of the tag, from the upper left; False for a black one.
    """
    many = len(code)
    upper_left, upper_right, _, lower_left = body.tag_corners(marker, marker.size_m / 2)
    across, down = (upper_right - upper_left) / many, (lower_left - upper_left) / many
    runs: list[Array] = []
    for row in range(many):
        # Where the colour changes between white margins: the start and the end of each black run.
        changes = np.flatnonzero(np.diff(code[row], prepend=True, append=True))
        for start, end in changes.reshape(-1, 2):
            corners = ((start, row), (end, row), (end, row + 1), (start, row + 1))
            runs += [upper_left + i * across + j * down for i, j in corners]
    flat = view.project(np.array(runs)).reshape(-1, 4, 2)
    return "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in run) + "Z" for run in flat)


def _decoration_lead(shape: DrawnShape) -> float:
    """Length [m] added to the nearness to the eye of edges and tags, so that they are drawn last.

    Parts are drawn from far to near. Without it, edges and tags could be drawn before the triangles of their
    face, whose centres may be nearer to the eye.
    """
    return 10.0 if shape.convex else shape.size / 7
