"""Bodies of `make bench-honesty`: true shape as contact spheres, true masses, and what a user states of them.

Lengths are in metres in O, the frame of the shape file; the shape files are in millimetres. Masses are
points spread evenly, not the estimator's cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from scipy.spatial import ConvexHull
from scipy.stats.qmc import Sobol

from analyze.geometry.object_model import load_object_model
from schemas.object_spec import MarkerSpec, ObjectSpec, Shape
from tests.analyze.geometry.shapes import box_triangles, obj, stl
from tests.analyze.planning.random_bodies import convex_triangles

RIM_SIDES = 72
"""number of contact spheres per rim of a round body"""
MASS_SD = 1e-4
"""stated sd of the mass [kg]"""
RADIUS_SD = 1e-4
"""stated sd of the edges' radius [m], where a single radius describes them"""


@dataclass(frozen=True, eq=False)
class TrueBody:
    """True exterior of one kind of body, and the description of it that a careful user gives."""

    name: str
    centres: np.ndarray
    """(n, 3) centres of the contact spheres [m]"""
    radii: np.ndarray
    """(n,) their radii [m]"""
    mass: float
    """mass of the body [kg]"""
    shape: dict
    """`shape` entry of the object file; it states that the shape is exact"""
    shape_bytes: bytes | None
    """content of the shape file; None for a primitive"""
    pieces: tuple[np.ndarray, ...]
    """triangles (f, 3, 3) [mm] of each closed surface of the exterior"""
    stated_radius: tuple[float, float]
    """radius of the edges and its sd [m], as a careful user states them"""
    filling: str = "two parts"
    """"two parts" (uniform, inside a wall), "lump" (inside a wall) or "parts" (one density per piece)"""
    wall: float = 0.003
    """true thickness of the wall [m]"""
    wall_stated: bool = True
    """True if the object file states the thickness"""
    labels: tuple[str, ...] = ()
    """names of the parts that the object file labels, one per piece"""
    settles: bool = False
    """True if the body, put down as planned, settles on the nearest face that holds its centre of mass"""
    struck_beside: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """(3,) point in O beside which strikes are aimed [m]"""

    def spec(self, **changes: object) -> ObjectSpec:
        """Object file of a careful user; `changes` replace entries."""
        radius, radius_sd = self.stated_radius
        data: dict[str, object] = {
            "name": self.name,
            "mass_kg": self.mass,
            "mass_sd_kg": MASS_SD,
            "shape": Shape.model_validate(self.shape),
            "edge_radius_m": radius,
            "edge_radius_sd_m": radius_sd,
            "marker": [MarkerSpec(id=0, size_m=0.03)],
        }
        if self.wall_stated and not self.labels:
            data["shell_thickness_m"] = self.wall
        if self.labels:
            data["labels"] = [{"name": name, "bodies": [i + 1]} for i, name in enumerate(self.labels)]
        return ObjectSpec.model_validate({**data, **changes})


@dataclass(frozen=True)
class Specimen:
    """One specimen of a body: its masses, and the table on which it is struck."""

    body: TrueBody
    number: int
    points: np.ndarray
    """(n, 3) mass points [m]"""
    masses: np.ndarray
    """(n,) [kg]"""
    in_shell: np.ndarray
    """(n,) True for points of the wall"""
    com: np.ndarray
    inertia: np.ndarray
    """(3, 3) about c [kg m^2]"""
    parts: dict[str, float]
    """true masses of labelled parts [kg]"""
    friction: float
    plate: tuple[float, float, float]
    """mass [kg], natural frequency [rad/s] and damping ratio of the springy table top"""
    lean: np.ndarray
    """(2,) tilt of the table towards x and y, in units of the tilt's sd"""


def corner_spheres(corners: np.ndarray, radii: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 3) and radii (n,) of spheres that touch the faces at each corner of a convex hull.

    Args:
        corners: (m, 3) points [m].
        radii: radius at each point [m], or one for all.
    """
    hull = ConvexHull(corners)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(corners))
    centres = []
    for vertex in hull.vertices:
        planes = hull.equations[(hull.simplices == vertex).any(axis=1)]
        planes = planes[np.unique(np.round(planes, 6), axis=0, return_index=True)[1]]
        centre = np.linalg.lstsq(planes[:, :3], -planes[:, 3] - radii[vertex], rcond=None)[0]
        centres.append(centre)
    return np.array(centres), np.asarray(radii[hull.vertices])


def box_corners(size: np.ndarray) -> np.ndarray:
    """Corners (8, 3) of a box centred on the origin."""
    return np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size


def _rings(outline: list[tuple[float, float]], sides: int) -> np.ndarray:
    """Points of a body of revolution about z; `outline` holds radius and height of each ring."""
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    return np.concatenate(
        [np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(sides, z)]) for r, z in outline]
    )


def _mesh_body(
    name: str, corners_mm: np.ndarray, radii_mm: np.ndarray | float, mass: float, **more
) -> TrueBody:
    triangles = convex_triangles(np.asarray(corners_mm, dtype=float))
    centres, radii = corner_spheres(1e-3 * corners_mm, 1e-3 * np.asarray(radii_mm))
    stated = more.pop("stated_radius", (1e-3 * float(np.max(radii_mm)), RADIUS_SD))
    return TrueBody(
        name,
        centres,
        radii,
        mass,
        {"file": "b.stl", "unit": "mm", "surface_sd_m": 0.0},
        stl(triangles),
        (triangles,),
        stated,
        **more,
    )


def _box(
    name: str, size: tuple[float, float, float], radii: np.ndarray | float, mass: float, **more
) -> TrueBody:
    return _mesh_body(name, box_corners(np.array(size)), radii, mass, **more)


def _mixed() -> TrueBody:
    """Box with 2 mm corners at its foot and 0.3 mm ones at its top."""
    size = (80.0, 65.0, 140.0)
    radii = np.where(box_corners(np.array(size))[:, 2] < 0, 2.0, 0.3)
    return _box("mixed", size, radii, 0.16, stated_radius=(1.15e-3, 0.85e-3))


def _foot() -> TrueBody:
    """Box whose ends are 4 mm narrower all round and 1 mm high: the chamfer lands before balance."""
    body = box_corners(np.array([90.0, 70.0, 140.0]))
    end = np.sign(body)
    corners = np.concatenate([body - end * [0, 0, 1.0], body - end * [4, 4, 0]])
    return _mesh_body("foot", corners, 0.3, 0.18)


def _ring() -> TrueBody:
    """Round jar on a foot ring of 30 mm whose belly of 34 mm lands after 17 degrees."""
    return _mesh_body(
        "ring", _rings([(30, 0), (34, 1.2), (36, 30), (36, 90), (28, 112)], 36), 0.5, 0.15, wall_stated=False
    )


def _can() -> TrueBody:
    """Cylinder, described as such, with rims of 1 mm."""
    radius, height, rho = 0.036, 0.11, 0.001
    # The polygon of spheres has the circle's perimeter.
    half = np.pi / RIM_SIDES
    ring = (radius - rho) * half / math.sin(half)
    centres = _rings([(ring, rho - height / 2), (ring, height / 2 - rho)], RIM_SIDES)
    surface = convex_triangles(1e3 * _rings([(radius, -height / 2), (radius, height / 2)], RIM_SIDES))
    shape = {"cylinder": {"radius_m": radius, "height_m": height}, "surface_sd_m": 0.0}
    return TrueBody(
        "can", centres, np.full(len(centres), rho), 0.2, shape, None, (surface,), (rho, RADIUS_SD)
    )


def _hammer() -> TrueBody:
    """Two touching boxes, a head and a handle, whose meshes share corners; each of one density."""
    head = box_triangles((84, 36, 34), (0, 0, 72))
    handle = box_triangles((30, 36, 110), (-27, 0, 0))
    pieces = (head, handle)
    spheres = [corner_spheres(1e-3 * np.unique(each.reshape(-1, 3), axis=0), 3e-4) for each in pieces]
    # Each box keeps vertex numbers of its own, as an exporter of assemblies writes them.
    corners, number = [], []
    for piece in pieces:
        unique, index = np.unique(piece.reshape(-1, 3), axis=0, return_inverse=True)
        number.append(index.reshape(-1, 3) + sum(len(each) for each in corners))
        corners.append(unique)
    return TrueBody(
        "hammer",
        np.concatenate([centres for centres, _ in spheres]),
        np.concatenate([radii for _, radii in spheres]),
        0.25,
        {"file": "b.obj", "unit": "mm", "surface_sd_m": 0.0},
        obj(np.concatenate(corners), np.concatenate(number)),
        pieces,
        (3e-4, RADIUS_SD),
        filling="parts",
        labels=("handle", "head"),
    )


MAKERS = {
    "sharp": lambda: _box("sharp", (80, 60, 150), 0.3, 0.18),
    "rounded": lambda: _box("rounded", (90, 70, 120), 1.0, 0.2, wall_stated=False),
    "mixed": _mixed,
    "foot": _foot,
    "ring": _ring,
    "can": _can,
    "lump": lambda: _box("lump", (100, 60, 140), 0.5, 0.2, filling="lump", wall_stated=False),
    "hammer": _hammer,
}
"""functions that make each body, by its name"""


@cache
def true_body(name: str) -> TrueBody:
    """Body of one kind, by the name of its maker in `MAKERS`; each is made once."""
    return MAKERS[name]()


@lru_cache(maxsize=8)
def _mass_points(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) [m] uniform in a body, the depth (n,) [m] of each, and the piece (n,) that holds it."""
    body = true_body(name)
    found, depths, owners = [], [], []
    extents = [1e-3 * np.array([piece.min(axis=(0, 1)), piece.max(axis=(0, 1))]) for piece in body.pieces]
    boxes = np.array([np.prod(high - low) for low, high in extents])
    for number, (piece, (low, high)) in enumerate(zip(body.pieces, extents, strict=True)):
        planes = ConvexHull(1e-3 * piece.reshape(-1, 3)).equations
        # Evenly spread: the centroid of random points would be 0.3 mm off that of a uniform part.
        cubes = Sobol(3, seed=number).random(1 << 15)[: round((1 << 15) * boxes[number] / boxes.max())]
        points = low + (high - low) * cubes
        depth = -(points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        found.append(points[depth > 0])
        depths.append(depth[depth > 0])
        owners.append(np.full(len(found[-1]), number))
    return np.concatenate(found), np.concatenate(depths), np.concatenate(owners)


def draw_specimen(name: str, number: int, attempt: int = 0) -> Specimen:
    """Specimen `number` of a body; `attempt` numbers the fillings tried for it."""
    body = true_body(name)
    rng = np.random.default_rng((0x5BEC, number, attempt, *name.encode()))
    points, depth, owner = _mass_points(name)
    in_shell = depth < body.wall
    parts: dict[str, float] = {}
    if body.filling == "parts":
        # The labels' bodies are numbered by size.
        sizes = [ConvexHull(piece.reshape(-1, 3)).volume for piece in body.pieces]
        order = np.argsort(sizes)[::-1]
        density = np.array([rng.uniform(0.4, 1.0), rng.uniform(1.5, 5.0)])[rng.permutation(2)]
        masses = density[owner]
        masses *= body.mass / masses.sum()
        for label, piece in zip(body.labels, order, strict=True):
            parts[label] = float(masses[owner == piece].sum())
    elif body.filling == "lump":
        centre = points[rng.choice(np.flatnonzero(~in_shell))]
        away = np.sum((points - centre) ** 2, axis=1)
        lump = np.exp(-away / (2 * rng.uniform(0.008, 0.02) ** 2)) * ~in_shell
        share = rng.uniform(0.3, 0.8)
        masses = body.mass * (share * in_shell / in_shell.sum() + (1 - share) * lump / lump.sum())
    else:
        masses = _two_parts(body, points, in_shell, rng)
    com = masses @ points / masses.sum()
    arm = points - com
    second = (arm * masses[:, None]).T @ arm
    return Specimen(
        body,
        number,
        points,
        masses,
        in_shell,
        com,
        np.trace(second) * np.eye(3) - second,
        parts,
        friction=rng.uniform(0.3, 0.8),
        plate=(rng.uniform(0.2, 0.4), rng.uniform(700, 1500), rng.uniform(0.1, 0.35)),
        lean=rng.standard_normal(2),
    )


def _two_parts(
    body: TrueBody, points: np.ndarray, in_shell: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Masses (n,) [kg] of the points of a wall and of two uniform parts on either side of a random plane."""
    wall, upper = rng.uniform(0.15, 0.7), rng.uniform(0.15, 0.85)
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    heights = points @ normal
    above = ~in_shell & (heights > np.quantile(heights[~in_shell], rng.uniform(0.3, 0.7)))
    parts = (in_shell, above, ~in_shell & ~above)
    regions = body.mass * np.array([wall, (1 - wall) * upper, (1 - wall) * (1 - upper)])
    return np.asarray(sum(m * p / p.sum() for m, p in zip(regions, parts, strict=True)))


def load_model(body: TrueBody, spec: ObjectSpec, data: bytes | None):
    """Exterior of a description, as the estimator reads it."""
    return load_object_model(spec, data, str(spec.shape.file or body.name))
