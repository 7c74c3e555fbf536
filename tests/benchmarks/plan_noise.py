"""Edges of noisy clouds compared with the raw hull's (VISAPP 2013, Fig. 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table
from scipy.spatial import ConvexHull

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.stable_planes import (
    RestingPlane,
    resting_planes,
)
from tests.analyze.geometry.shapes import spec_of

BODIES = {
    "box 60 x 200 x 50": lambda: trimesh.creation.box([60.0, 200.0, 50.0]),
    "hexagonal prism 80 x 120": lambda: trimesh.creation.cylinder(40.0, 120.0, sections=6),
    "cylinder 72 x 150": lambda: trimesh.creation.cylinder(36.0, 150.0, sections=256),
}
NOISE_MM = (0.1, 1.0, 5.0, 10.0, 15.0)
POINTS = 20_000


@dataclass(frozen=True)
class EdgeErrors:
    """Errors [mm] of the edges that were found in one noisy point cloud of a known body."""

    fitted: np.ndarray
    """(n,) distance of each true edge from the edge found for it [mm]"""
    sd: np.ndarray
    """(n,) sd that the plan would state [mm]"""
    edges: int
    """number of true edges"""
    raw_found: int
    """number of true edges that the raw hull's planes have"""
    raw_shift: float
    """mean distance of the raw hull outside the true faces [mm], times root 2 for an edge of two such
    faces"""


def noisy_cloud(mesh: trimesh.Trimesh, noise_mm: float, seed: int, outward: bool) -> np.ndarray:
    """Points (n, 3) [mm], each moved by up to `noise_mm` in a random direction, or outwards."""
    points, face = trimesh.sample.sample_surface(mesh, POINTS, seed=seed)
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=points.shape)
    direction = (
        np.asarray(mesh.face_normals)[face]
        if outward
        else direction / np.linalg.norm(direction, axis=1, keepdims=True)
    )
    return np.asarray(points) + direction * rng.uniform(0, noise_mm, len(points))[:, None]


def model_of_cloud(points: np.ndarray, surface_sd_mm: float = 0.0) -> ObjectModel:
    """Model from a cloud, as from a user's PLY file."""
    data = trimesh.PointCloud(points).export(file_type="ply")
    spec = spec_of({"file": "cloud.ply", "unit": "mm", "surface_sd_m": surface_sd_mm / 1000}, 0.05)
    return load_object_model(spec, data, "cloud.ply")


def model_of_mesh(mesh: trimesh.Trimesh, mass: float = 0.05) -> ObjectModel:
    """Model from a mesh, as from a user's STL file in mm."""
    return load_object_model(
        spec_of({"file": "m.stl", "unit": "mm"}, mass), mesh.export(file_type="stl"), "m.stl"
    )


def edge_errors(
    mesh: trimesh.Trimesh, noise_mm: float, seed: int, outward: bool, surface_sd_mm: float = 0.0
) -> EdgeErrors:
    """Errors of the edges of the fitted planes, and of the raw hull."""
    truth = model_of_mesh(mesh)
    points = noisy_cloud(mesh, noise_mm, seed, outward)
    model = model_of_cloud(points, surface_sd_mm)
    raw_hull = ConvexHull(points)
    used, faces = np.unique(raw_hull.simplices, return_inverse=True)
    raw = trimesh.Trimesh(points[used], faces.reshape(-1, 3), process=False)
    raw.fix_normals()
    found, edges = _across(truth, model)
    raw_found, _ = _across(truth, model_of_mesh(raw))
    # Facets of a tessellated flank do not count as faces; the ends of a cylinder do.
    large = [plane for plane in resting_planes(truth) if plane.area > 0.02 * mesh.area * 1e-6]
    shift = [float((points @ -plane.up).max() + 1000 * plane.level) for plane in large]
    return EdgeErrors(
        np.array([error for error, _ in found]),
        np.array([sd for _, sd in found]),
        edges,
        len(raw_found),
        float(np.sqrt(2) * np.mean(shift)),
    )


def _across(truth: ObjectModel, model: ObjectModel) -> tuple[list[tuple[float, float]], int]:
    """Distance and sd [mm] of the true edges that the model has, and the number of true edges."""
    planes = resting_planes(model)
    found: list[tuple[float, float]] = []
    edges = 0
    area = ConvexHull(truth.hull_vertices).area
    for plane in (plane for plane in resting_planes(truth) if plane.area > 0.02 * area):
        mine = [each for each in planes if each.up @ plane.up > np.cos(np.radians(5))]
        start, end = plane.edges
        # For a finely tessellated rim every eighth tangent is enough.
        for i in range(0, len(start), 8 if len(start) > 32 else 1):
            edges += 1
            best = _nearest(mine[0], plane.outward[i], (start[i] + end[i]) / 2) if mine else None
            if best is not None:
                k, distance = best
                ends = np.array([mine[0].polygon[k], np.roll(mine[0].polygon, -1, axis=0)[k]])
                found.append((1000 * distance, 1000 * model.edge_sd(ends)))
    return found, edges


def _nearest(plane: RestingPlane, out: np.ndarray, middle: np.ndarray) -> tuple[int, float] | None:
    start, end = plane.edges
    alike = plane.outward @ out
    k = int(np.argmax(alike))
    if alike[k] < np.cos(np.radians(15)):
        return None
    along = (end[k] - start[k]) / np.linalg.norm(end[k] - start[k])
    gap = middle - start[k]
    return k, float(np.linalg.norm(gap - along * (along @ gap)))


def noise_table(console: Console, seeds: int) -> None:
    """Print the errors of the edges' position over the noise (paper, Fig. 10)."""
    for name, make in BODIES.items():
        table = Table(
            title=f"{name} mm, {POINTS} points, {seeds} seeds: error of the edges' position [mm]",
            title_justify="left",
        )
        for heading in (
            "noise up to",
            "direction",
            "edges",
            "fitted: found",
            "median",
            "largest",
            "sd carried",
            "raw hull: found",
            "raw hull: outside by",
        ):
            table.add_column(heading, justify="right")
        for outward in (False, True):
            for noise in NOISE_MM:
                runs = [
                    edge_errors(make(), noise, seed, outward, noise / 2 if outward else 0.0)
                    for seed in range(1, seeds + 1)
                ]
                error = np.concatenate([run.fitted for run in runs])
                sd = np.concatenate([run.sd for run in runs])
                edges = sum(run.edges for run in runs)
                table.add_row(
                    f"{noise:g} mm",
                    "outwards" if outward else "any",
                    str(edges),
                    f"{100 * len(error) / edges:.0f} %",
                    f"{np.median(error):.3f}" if len(error) else "-",
                    f"{error.max():.2f}" if len(error) else "-",
                    f"{np.median(sd):.3f}" if len(sd) else "-",
                    f"{100 * sum(run.raw_found for run in runs) / edges:.0f} %",
                    f"{np.mean([run.raw_shift for run in runs]):.2f}",
                )
        console.print(table)
    console.print(
        "outwards: all shifts point outwards, by half the noise on average, which no fit detects; "
        "surface_sd_m states half of it"
    )
