"""Dimensioned drawing of a part, at a scale of 1:1 in SVG: seen from above and from the front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from analyze.fixture.solid import Mesh
from analyze.geometry import polyhedron
from analyze.geometry.polyhedron import BoolArray
from analyze.rig_parts.solids import Dimension, RigPart
from analyze.types import Array

SHARP = np.cos(np.radians(20.0))
"""Cosine of the angle between two faces above which their common edge is drawn."""
SKIN = 1e-2
"""Distance from an edge at which it is tested whether the part hides it [mm]."""
FLAT_MM2 = 1e-9
"""Twice the area of a face's picture below which it is seen edge-on [mm^2]."""
CHUNK = 200
"""Number of points that are compared with all faces at once."""
MARGIN, GAP, TITLE = 24.0, 34.0, 16.0
"""Space around the views, between them, and for the title [mm]."""
TEXT_MM = 3.2
VIEWS: dict[str, tuple[tuple[int, int], tuple[float, float, float]]] = {
    "top": ((0, 1), (0.0, 0.0, 1.0)),
    "front": ((0, 2), (0.0, -1.0, 0.0)),
}
"""Axes to the right and up of each view, and direction towards the eye."""
STYLE = (
    "path{fill:none;stroke-linecap:round}.seen{stroke:#1a1a1a;stroke-width:.35}"
    ".hidden{stroke:#9aa5b1;stroke-width:.18;stroke-dasharray:1.2 .9}.axis{stroke:#b3261e;stroke-width:.15;"
    "stroke-dasharray:5 1 1 1}.size{stroke:#1d5a96;stroke-width:.18}text{font-family:DejaVu Sans,Helvetica,"
    f"Arial,sans-serif;font-size:{TEXT_MM}px;fill:#1d5a96;text-anchor:middle}}"
    ".title{fill:#1a1a1a;font-size:4.2px;text-anchor:start}.note{fill:#5b6670;text-anchor:start}"
)

ARROW = (
    '<defs><marker id="a" viewBox="0 0 6 4" refX="6" refY="2" markerWidth="6" markerHeight="4" '
    'orient="auto-start-reverse" markerUnits="userSpaceOnUse"><path d="M0 .6 6 2 0 3.4z" '
    'style="fill:#1d5a96" transform="scale(.6) translate(4 1.33)"/></marker></defs>'
)
"""Arrow head of the dimension lines."""


def drawing_svg(part: RigPart) -> str:
    """Text of an SVG file with two views of a part, its dimensions [mm], name and screws."""
    boxes = {name: _extent(part, name) for name in VIEWS}
    left, right = min(box[0] for box in boxes.values()), max(box[2] for box in boxes.values())
    title, note = f"{part.name}: {part.purpose}", f"{part.fasteners}; scale 1:1, mm"
    width = max(right - left + 2 * MARGIN, 20.0 + 2.4 * len(title), 20.0 + 1.85 * len(note))
    height = sum(box[3] - box[1] for box in boxes.values()) + GAP + 2 * MARGIN + TITLE
    size = f'width="{width:.1f}mm" height="{height:.1f}mm"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {width:.1f} {height:.1f}">',
        f"<title>{escape(part.name)}</title><style>{STYLE}</style>",
        f'<rect {size} fill="#fff"/>',
        ARROW,
        f'<text class="title" x="10" y="11">{escape(title)}</text>',
        f'<text class="note" x="10" y="17">{escape(note)}</text>',
    ]
    top = TITLE + MARGIN
    for name, box in boxes.items():
        lines += _view(part, name, np.array([(width - left - right) / 2, top + box[3]]))
        top += box[3] - box[1] + GAP
    return "\n".join([*lines, "</svg>", ""])


def _extent(part: RigPart, name: str) -> tuple[float, float, float, float]:
    """Least and greatest coordinates (x0, y0, x1, y1) [mm] of a view, with its dimension lines."""
    axes, _ = VIEWS[name]
    points = [part.mesh.vertices[:, list(axes)]]
    points += [np.array(_dimension_line(each)) for each in part.dimensions if each.view == name]
    every = np.vstack(points)
    low, high = every.min(axis=0), every.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _view(part: RigPart, name: str, origin: Array) -> list[str]:
    """Lines of SVG with one view: hidden edges, visible edges, dimensions.

    Args:
        part: the part.
        name: name of the view.
        origin: (2,) place of the part's origin on the page [mm].
    """
    axes, eye = VIEWS[name]
    edges, seen = _edges(part.mesh, np.array(eye))
    flat = edges[:, :, list(axes)]
    lines = []
    for kind, mask in (("hidden", ~seen), ("seen", seen)):
        paths = [f"M{_point(a, origin)}L{_point(b, origin)}" for a, b in flat[mask]]
        lines.append(f'<path class="{kind}" d="{"".join(paths)}"/>')
    for each in part.dimensions:
        if each.view == name:
            lines += _dimension(each, origin)
    return lines


def _edges(mesh: Mesh, eye: Array) -> tuple[Array, BoolArray]:
    """Edges to draw, and whether each can be seen.

    Drawn are edges between faces that meet at an angle, and those at which the surface turns away.

    Args:
        mesh: surface of the part [mm].
        eye: (3,) unit direction towards the eye.

    Returns:
        Ends (e, 2, 3) of the edges [mm], and a flag (e,) for each that is visible.
    """
    normals = polyhedron.area_vectors(mesh.vertices[mesh.faces])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    faces_of: dict[tuple[int, int], list[int]] = {}
    for number, face in enumerate(mesh.faces.tolist()):
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            faces_of.setdefault((min(a, b), max(a, b)), []).append(number)
    chosen: list[tuple[int, int]] = []
    outward: list[Array] = []
    for ends, owners in faces_of.items():
        first, second = normals[owners[0]], normals[owners[-1]]
        turns_away = (float(first @ eye) > 1e-6) != (float(second @ eye) > 1e-6)
        if float(first @ second) < SHARP or (turns_away and abs(float((first + second) @ eye)) < 0.2):
            chosen.append(ends)
            outward.append(first + second)
    edges = mesh.vertices[np.array(chosen, dtype=np.int64)]
    away = np.array(outward)
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    starts = edges.mean(axis=1) + SKIN * away + SKIN * eye
    return edges, ~_hidden(mesh, starts, eye)


def _hidden(mesh: Mesh, points: Array, eye: Array) -> BoolArray:
    """Whether a face of the surface lies between each point and the eye, which looks along a line.

    Args:
        mesh: surface of the part [mm].
        points: (n, 3) points [mm].
        eye: (3,) unit direction towards the eye.
    """
    right = np.array([1.0, 0.0, 0.0])
    flat = np.stack([right, np.cross(eye, right)], axis=1)
    corners = mesh.vertices[mesh.faces]
    places, depths = corners @ flat, corners @ eye
    a, to_b, to_c = places[:, 0], places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    double = to_b[:, 0] * to_c[:, 1] - to_b[:, 1] * to_c[:, 0]
    faced = np.abs(double) > FLAT_MM2
    a, to_b, to_c, double, depths = a[faced], to_b[faced], to_c[faced], double[faced], depths[faced]
    found: list[BoolArray] = []
    for some in np.array_split(points, max(1, len(points) // CHUNK)):
        away = (some @ flat)[:, None, :] - a
        u = (away[..., 0] * to_c[:, 1] - away[..., 1] * to_c[:, 0]) / double
        v = (to_b[:, 0] * away[..., 1] - to_b[:, 1] * away[..., 0]) / double
        above = depths[:, 0] + u * (depths[:, 1] - depths[:, 0]) + v * (depths[:, 2] - depths[:, 0])
        within = (u >= 0) & (v >= 0) & (u + v <= 1)
        found.append(np.any(within & (above > (some @ eye)[:, None]), axis=1))
    return np.concatenate(found)


def _dimension_line(dimension: Dimension) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of the dimension line [mm], in the view's coordinates, at its offset from the points."""
    (x0, y0), (x1, y1) = dimension.start, dimension.end
    length = math.hypot(x1 - x0, y1 - y0)
    left = (-(y1 - y0) / length * dimension.offset, (x1 - x0) / length * dimension.offset)
    return (x0 + left[0], y0 + left[1]), (x1 + left[0], y1 + left[1])


def _dimension(dimension: Dimension, origin: Array) -> list[str]:
    """Lines of SVG of a dimension: two thin lines from the points, a line with arrows, and the text."""
    start, end = _dimension_line(dimension)
    length = math.dist(dimension.start, dimension.end)
    text = dimension.text or f"{length:.4g}"
    a, b = np.array(start), np.array(end)
    along = (b - a) / length
    angle = -math.degrees(math.atan2(along[1], along[0]))
    if angle >= 90 or angle < -90:
        angle -= math.copysign(180, angle)
    inside = length > 11.0
    middle = (a + b) / 2 if inside else b + along * 7.0
    up = np.array([-along[1], along[0]])
    if up[1] < 0 or (up[1] == 0 and up[0] > 0):
        up = -up
    place = middle + 1.2 * up
    x, y = origin[0] + place[0], origin[1] - place[1]
    beyond = math.copysign(1.0, dimension.offset) * np.array([-along[1], along[0]])
    ends = [
        (_point(point, origin), _point(line + beyond, origin))
        for point, line in ((dimension.start, a), (dimension.end, b))
    ]
    near, far = _point(a, origin), _point(b, origin)
    if inside:
        arrows = f'<path class="size" marker-start="url(#a)" marker-end="url(#a)" d="M{near}L{far}"/>'
    else:
        tail = _point(a - along * 4.0, origin)
        head = _point(b + along * (4.0 + 2.2 * len(text)), origin)
        arrows = (
            f'<path class="size" marker-end="url(#a)" d="M{tail}L{near}"/>'
            f'<path class="size" marker-end="url(#a)" d="M{head}L{far}"/>'
        )
    return [
        *(f'<path class="size" d="M{start}L{end}"/>' for start, end in ends),
        arrows,
        f'<text transform="translate({x:.2f} {y:.2f}) rotate({angle:.1f})">{escape(text)}</text>',
    ]


def _point(point: Sequence[float] | Array, origin: Array) -> str:
    """Text of a point of a view on the page, whose y axis is downwards."""
    return f"{origin[0] + point[0]:.2f} {origin[1] - point[1]:.2f}"
