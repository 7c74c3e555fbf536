"""Stable planes compared with the stable poses that trimesh finds."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table
from scipy.spatial import ConvexHull

from analyze.errors import ShapeError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.hypothesis import Region
from analyze.planning.stable_planes import COPLANAR_FRACTION, MIN_AREA_FRACTION, resting_planes
from tests.analyze.geometry.shapes import spec_of
from tests.analyze.planning.planned import stable_planes
from tests.benchmarks.plan_noise import model_of_mesh

SAME_POSE = np.radians(1.0)


@dataclass(frozen=True)
class PoseComparison:
    """Our stable planes for one point c, compared with `trimesh.poses.compute_stable_poses`."""

    agreed: int
    explained: tuple[str, ...]
    """a reason for each pose that only one of the two has"""
    unexplained: tuple[str, ...]


def compare_poses(model: ObjectModel, com: np.ndarray) -> PoseComparison:
    """Disagreements between trimesh and our stable planes, each with its reason.

    trimesh considers single facets; our faces are merged from the facets of one plane, without those below
    `MIN_AREA_FRACTION` of the hull. Therefore only trimesh has poses on facets too small to stand on, and two
    poses for one face that is flat within `COPLANAR_FRACTION`. Only we have a pose where the projection of c
    lies on the boundary of two facets of a face, which trimesh lets topple for ever, or where it merges
    normals equal to three decimals.
    """
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    transforms, probabilities = trimesh.poses.compute_stable_poses(mesh, center_mass=com, threshold=0.0)
    theirs = transforms[:, 2, :3]
    planes = resting_planes(model)
    ours = stable_planes(planes, Region(com, np.eye(3), np.zeros(3)))
    hull = ConvexHull(model.hull_vertices)
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    tolerance = COPLANAR_FRACTION * float(model.extent.max())
    agreed, explained, unexplained = 0, [], []
    for up, probability in zip(theirs, probabilities, strict=True):
        if any(up @ plane.up > np.cos(SAME_POSE) for plane in ours):
            agreed += 1
            continue
        same = -hull.equations[:, :3] @ up > 1 - 1e-6
        facet = hull.equations[same][0] if same.any() else None
        fraction = float(areas[same].sum()) / float(hull.area)
        if facet is None:
            unexplained.append(f"only trimesh: p = {probability:.4f}, no such facet")
        elif fraction < MIN_AREA_FRACTION:
            explained.append("only trimesh: a facet below 0.1 % of the hull")
        elif any(np.abs(plane.polygon @ facet[:3] + facet[3]).max() < 2 * tolerance for plane in planes):
            explained.append(
                "only trimesh: part of a face that is flat within 0.02 %, whose own normal lets c fall "
                "outside"
            )
        else:
            unexplained.append(f"only trimesh: p = {probability:.4f}, {100 * fraction:.2f} % of the hull")
    for plane in ours:
        if any(up @ plane.up > np.cos(SAME_POSE) for up in theirs):
            continue
        margin = plane.margin(com[None])[0]
        heights = np.abs(hull.points @ plane.up - plane.level)
        facets = int(np.sum((heights < tolerance)[hull.simplices].all(axis=1)))
        if margin < 5 * tolerance:
            explained.append("only ours: c is within 0.1 % of the face's boundary")
        elif facets != 1:
            explained.append("only ours: a face of facets that are not exactly in one plane")
        else:
            unexplained.append(f"only ours: {plane.id}, margin {1000 * margin:.3f} mm")
    return PoseComparison(agreed, tuple(explained), tuple(unexplained))


def generated_bodies(many: int, seed: int) -> Iterator[tuple[str, trimesh.Trimesh]]:
    """Boxes, prisms, frustums, random hulls and L-shapes [mm] in random orientations."""
    rng = np.random.default_rng(seed)
    for index in range(many):
        size = rng.uniform(30, 150, 3)
        kind = index % 5
        if kind == 0:
            mesh = trimesh.creation.box(size)
        elif kind == 1:
            mesh = trimesh.creation.cylinder(size[0] / 2, size[1], sections=int(rng.integers(3, 12)))
        elif kind == 2:
            mesh = trimesh.creation.box(size)
            mesh.vertices[mesh.vertices[:, 2] > 0, :2] *= rng.uniform(0.3, 0.9)
        elif kind == 3:
            mesh = trimesh.convex.convex_hull(rng.normal(size=(14, 3)) * size / 3)
        else:
            block = trimesh.creation.box(size)
            mesh = trimesh.boolean.difference(
                [block, trimesh.creation.box(size).apply_translation(size * [0.4, 0.5, 0.0])]
            )
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.uniform(size=3)))
        yield ("box", "prism", "frustum", "hull of points", "L")[kind], mesh


def poses_table(console: Console, folder: Path) -> int:
    """Print the comparison for a folder's meshes and 200 generated bodies; number of unexplained ones."""
    table = Table(
        title="stable planes compared with trimesh.poses.compute_stable_poses, no noise", title_justify="left"
    )
    for heading in ("body", "agreed", "explained", "unexplained", "reasons, notes"):
        table.add_column(heading)
    wrong = 0
    for path in sorted(folder.glob("*/mesh.ply")):
        text = (path.parent / "inertia.yaml").read_text(encoding="utf-8")
        mass = float(re.findall(r"MASS: ([\d.]+)", text)[0])
        com = np.array(re.findall(r"COM_WRT_MESH: \[(.*?)\]", text)[0].split(","), dtype=float)
        try:
            model = load_object_model(
                spec_of({"file": "mesh.ply", "unit": "mm"}, mass), path.read_bytes(), "mesh.ply"
            )
        except ShapeError as error:
            table.add_row(path.parent.name, "-", "-", "-", f"refused: {error}")
            continue
        result = compare_poses(model, com)
        wrong += len(result.unexplained)
        reasons = [
            f"{many} x {text}" for text, many in Counter([*result.explained, *result.unexplained]).items()
        ]
        table.add_row(
            path.parent.name,
            str(result.agreed),
            str(len(result.explained)),
            str(len(result.unexplained)),
            "; ".join(reasons),
        )
    total = Counter()
    for kind, mesh in generated_bodies(200, 1):
        model = model_of_mesh(mesh, 0.2)
        result = compare_poses(model, model.centroid)
        wrong += len(result.unexplained)
        total.update(
            {
                (kind, "agreed"): result.agreed,
                (kind, "explained"): len(result.explained),
                (kind, "un"): len(result.unexplained),
            }
        )
    for kind in dict.fromkeys(kind for kind, _ in total):
        table.add_row(
            f"40 x {kind}", *(str(total[kind, column]) for column in ("agreed", "explained", "un")), ""
        )
    console.print(table)
    return wrong
