"""Random bodies, convex and not, with random fillings, to test the planner; reproducible by seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from analyze.estimation.cells import cells_from_voxels
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.voxels import voxelise
from schemas.document import validate
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.shapes import box_triangles, stl

KINDS = ("box", "hull", "prism", "bottle", "angle")
CELLS = 800
FAR_TAG = {"id": 0, "size_m": 0.03}
"""marker without a pose, so that the planner does not check its visibility"""


@dataclass(frozen=True)
class RandomBody:
    """Random body with its shape, object file and true mass properties."""

    kind: str
    spec: ObjectSpec
    model: ObjectModel
    com: np.ndarray
    unit_inertia: np.ndarray
    """(3, 3) inertia about c per kilogram [m^2]"""


def random_body(seed: int, kind: str | None = None) -> RandomBody:
    """Random body of a kind, or of the kind that the seed selects in turn."""
    rng = np.random.default_rng((seed, 0xB0D1))
    kind = kind or KINDS[seed % len(KINDS)]
    triangles = shape_of(kind, rng)
    spec = spec_for(triangles)
    model = load_object_model(spec, stl(triangles), "b.stl")
    com, unit_inertia = random_filling(model, rng)
    return RandomBody(kind, spec, model, com, unit_inertia)


def shape_of(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Triangles (f, 3, 3) [mm] of a random body of a kind."""
    return {"box": _box, "hull": _hull, "prism": _prism, "bottle": _bottle, "angle": _angle}[kind](rng)


def spec_for(triangles: np.ndarray, markers: list | None = None, **more: object) -> ObjectSpec:
    """Object of 300 kg/m^3 with the shape of `triangles` (f, 3, 3) [mm]."""
    volume = (
        float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum()) / 6e9
    )
    data = {
        "name": "body",
        "mass_kg": 300 * abs(volume),
        "mass_sd_kg": 0.3 * abs(volume),
        "shape": {"file": "b.stl", "unit": "mm"},
        "edge_radius_m": 0.0005,
        "edge_radius_sd_m": 0.0001,
        "marker": markers or [FAR_TAG],
        **more,
    }
    return validate(ObjectSpec, data, "b.toml")


def random_filling(model: ObjectModel, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """c (3,) and inertia per kilogram (3, 3) of a shell and two parts inside with random masses.

    The parts lie on either side of a random plane.
    """
    cells = cells_from_voxels(
        voxelise(model, (model.volume / CELLS) ** (1 / 3), 0.025 * model.volume ** (1 / 3))
    )
    surface, upper = rng.uniform(0.1, 0.7), rng.uniform(0.1, 0.9)
    normal = rng.standard_normal(3)
    heights = (cells.points - cells.centroid) @ (normal / np.linalg.norm(normal))
    above = cells.interior * (heights > np.quantile(heights, rng.uniform(0.3, 0.7)))
    below = cells.interior - above
    parts = [(cells.shell, surface), (above, (1 - surface) * upper), (below, (1 - surface) * (1 - upper))]
    masses = sum(share * part / max(part.sum(), 1e-18) for part, share in parts)
    masses = masses / masses.sum()
    com = masses @ cells.points
    arm = cells.points - com
    second = (arm * masses[:, None]).T @ arm
    return com, (np.trace(second) + masses @ cells.own_inertia) * np.eye(3) - second


def _box(rng: np.random.Generator) -> np.ndarray:
    return box_triangles(np.sort(rng.uniform(40, 220, 3))[[1, 0, 2]])


def _hull(rng: np.random.Generator) -> np.ndarray:
    points = rng.standard_normal((int(rng.integers(8, 14)), 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * rng.uniform(30, 110, 3)
    return convex_triangles(points)


def convex_triangles(points: np.ndarray) -> np.ndarray:
    """Outward triangles (f, 3, 3) of the hull of points (n, 3)."""
    hull = ConvexHull(points)
    triangles = points[hull.simplices]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    turned = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles


def _prism(rng: np.random.Generator) -> np.ndarray:
    """Leaning, tapered prism on a convex polygon."""
    n = int(rng.integers(3, 7))
    angle = np.sort(2 * np.pi * (np.arange(n) + rng.uniform(-0.25, 0.25, n)) / n)
    outline = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(30, 70, 2)
    return _drawn(outline, rng)


def _angle(rng: np.random.Generator) -> np.ndarray:
    """Leaning, tapered prism on an L, T or U: not convex."""
    w, h, t = rng.uniform(60, 130), rng.uniform(60, 130), rng.uniform(0.25, 0.4)
    a, b = t * w, t * h
    outlines = {
        "L": [(0, 0), (w, 0), (w, b), (a, b), (a, h), (0, h)],
        "T": [
            (0, 0),
            (w, 0),
            (w, b),
            ((w + a) / 2, b),
            ((w + a) / 2, h),
            ((w - a) / 2, h),
            ((w - a) / 2, b),
            (0, b),
        ],
        "U": [(0, 0), (w, 0), (w, h), (w - a, h), (w - a, b), (a, b), (a, h), (0, h)],
    }
    outline = np.array(outlines[str(rng.choice(list(outlines)))])
    return _drawn(outline - outline.mean(axis=0), rng)


def _drawn(outline: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    height, taper, lean = rng.uniform(40, 200), rng.uniform(0.75, 1.0), rng.uniform(-0.1, 0.1, 2)
    low = np.column_stack([outline, np.zeros(len(outline))])
    high = np.column_stack([taper * outline + height * lean, np.full(len(outline), height)])
    cap = _triangulated(outline)
    n = len(outline)
    i = np.arange(n)
    j = (i + 1) % n
    points = np.vstack([low, high])
    faces = np.vstack(
        [cap[:, ::-1], cap + n, np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])]
    )
    return points[faces]


def _triangulated(outline: np.ndarray) -> np.ndarray:
    """Triangles of a simple polygon, counter-clockwise, by ear clipping (Meisters 1975)."""
    left = list(range(len(outline)))
    triangles = []

    def turn(a: int, b: int, c: int) -> float:
        u, v = outline[b] - outline[a], outline[c] - outline[b]
        return float(u[0] * v[1] - u[1] * v[0])

    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            inside = [
                p
                for p in left
                if p not in {a, b, c} and min(turn(a, b, p), turn(b, c, p), turn(c, a, p)) >= 0
            ]
            if turn(a, b, c) > 0 and not inside:
                triangles.append((a, b, c))
                left.pop(k)
                break
        else:
            raise ValueError("outline is not simple")
    return np.array([*triangles, tuple(left)])


def _bottle(rng: np.random.Generator) -> np.ndarray:
    """Many-sided body of revolution with foot, waist, shoulder and neck."""
    n = int(rng.integers(4, 9))
    height = rng.uniform(100, 220)
    foot = rng.uniform(28, 45)
    profile = [
        (0, foot),
        (0.25, foot * rng.uniform(0.6, 1.0)),
        (0.7, foot * rng.uniform(0.8, 1.15)),
        (1.0, foot * rng.uniform(0.4, 0.8)),
    ]
    flat = rng.uniform(0.7, 1.0)
    angle = 2 * np.pi * np.arange(n) / n
    rings = [
        np.column_stack([r * np.cos(angle), flat * r * np.sin(angle), np.full(n, z * height)])
        for z, r in profile
    ]
    points = np.vstack(rings)
    i = np.arange(n)
    j = (i + 1) % n
    faces = []
    for k in range(len(rings) - 1):
        a, b = k * n, (k + 1) * n
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
    return points[np.vstack([*faces, fan[:, ::-1], fan + (len(rings) - 1) * n])]
