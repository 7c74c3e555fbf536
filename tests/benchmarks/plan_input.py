"""Input of planning: edges of noisy clouds against the raw hull's (paper, Fig. 10), planes, times.

python -m tests.benchmarks.plan_input noise [--seeds 5]
python -m tests.benchmarks.plan_input poses FOLDER     (FOLDER/*/mesh.ply in mm, with inertia.yaml)
python -m tests.benchmarks.plan_input speed [MESH.ply]
"""

from __future__ import annotations

import argparse
import io
import re
import resource
import subprocess
import sys
import tempfile
import time
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
from analyze.planning.stable_planes import (
    COPLANAR_FRACTION,
    MIN_AREA_FRACTION,
    RestingPlane,
    resting_planes,
    stable_planes,
)
from analyze.verbs.plan.plan_object import PlanOptions, plan_object
from tests.analyze.geometry.shapes import spec_of
from tests.places import CARTON

BODIES = {
    "box 60 x 200 x 50": lambda: trimesh.creation.box([60.0, 200.0, 50.0]),
    "hexagonal prism 80 x 120": lambda: trimesh.creation.cylinder(40.0, 120.0, sections=6),
    "cylinder 72 x 150": lambda: trimesh.creation.cylinder(36.0, 150.0, sections=256),
}
NOISE_MM = (0.1, 1.0, 5.0, 10.0, 15.0)
POINTS = 20_000
SAME_POSE = np.radians(1.0)


# --- noise
# ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class EdgeErrors:
    """Errors of the edges from one cloud, in mm."""

    fitted: np.ndarray
    """distance of each true edge from the edge found for it"""
    sd: np.ndarray
    """sd that the plan would state"""
    edges: int
    """number of true edges"""
    raw_found: int
    """true edges that the raw hull's planes have"""
    raw_shift: float
    """mean distance of the raw hull outside the true faces, times root 2 for an edge of two such faces"""


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
            best = _nearest(mine[0], plane.outward()[i], (start[i] + end[i]) / 2) if mine else None
            if best is not None:
                k, distance = best
                ends = np.array([mine[0].polygon[k], np.roll(mine[0].polygon, -1, axis=0)[k]])
                found.append((1000 * distance, 1000 * model.edge_sd(ends)))
    return found, edges


def _nearest(plane: RestingPlane, out: np.ndarray, middle: np.ndarray) -> tuple[int, float] | None:
    start, end = plane.edges
    alike = plane.outward() @ out
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


# --- stable planes
# ---------------------------------------------------------------------------------------------------


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
        margin = plane.margin(com[None])
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


# --- speed
# -----------------------------------------------------------------------------------------------------------


ROUND = np.array([[0, 0], [30, 0], [34, 4], [34, 90], [14, 120], [14, 150], [0, 150]])
"""radius and height [mm] of a bottle's outline"""
SPEED_BODIES = {
    "box 80 x 60 x 150": lambda: trimesh.creation.box([80.0, 60.0, 150.0]),
    "cylinder 72 x 150": lambda: trimesh.creation.cylinder(36.0, 150.0, sections=128),
    "bottle 68 x 150": lambda: trimesh.creation.revolve(ROUND, sections=96),
}
SPEED_NOISE_MM = (0.1, 1.0, 5.0)
SPEED_RUNS = 5


def speed_table(console: Console, mesh_file: Path | None) -> None:
    """Print the CPU time of `analyze plan` without cards, and of trimesh's load and convex hull."""
    table = Table(title=f"CPU time [s], median and least of {SPEED_RUNS}", title_justify="left")
    for heading in ("input", "load", "plan", "together", "least", "trimesh load + hull", "ratio"):
        table.add_column(heading, justify="right")
    jobs = [
        (
            f"{name}, cloud of {POINTS} points, noise {noise:g} mm",
            "c.ply",
            _ply(noisy_cloud(make(), noise, 1, False)),
            0.1,
        )
        for name, make in SPEED_BODIES.items()
        for noise in SPEED_NOISE_MM
    ]
    fine = flask()
    jobs.append((f"mesh of {len(fine.faces)} faces", "m.stl", fine.export(file_type="stl"), 0.2))
    if mesh_file is not None:
        jobs.append((mesh_file.name, mesh_file.name, mesh_file.read_bytes(), 0.5))
    for text, name, data, mass in jobs:
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, name).write_bytes(data)
            thing = Path(folder, "thing.toml")
            thing.write_text(
                f'name = "thing"\nmass_kg = {mass}\nmass_sd_kg = {mass / 1000}\n'
                f'[shape]\nfile = "{name}"\nunit = "mm"\n'
                "[[marker]]\nid = 0\nsize_m = 0.03\n",
                encoding="utf-8",
            )
            runs = sorted(_planned(thing) for _ in range(SPEED_RUNS))
        (both, load), (least, _) = runs[SPEED_RUNS // 2], runs[0]
        before = time.process_time()
        other = trimesh.load(io.BytesIO(data), file_type=name[-3:])
        assert other.convex_hull.volume > 0
        theirs = time.process_time() - before
        table.add_row(
            text,
            *(f"{each:.2f}" for each in (load, both - load, both, least, theirs)),
            f"{both / theirs:.1f}",
        )
    console.print(table)


def _planned(thing: Path) -> tuple[float, float]:
    """CPU time [s] to plan for an object file, and the part of it until the axes are tried."""
    marks: dict[str, float] = {}
    start = time.process_time()
    plan_object(
        thing, PlanOptions(), lambda text, _done, _total: marks.setdefault(text, time.process_time()) and None
    )
    return time.process_time() - start, marks["trying the axes"] - start


def flask() -> trimesh.Trimesh:
    """Square flask [mm] with a round neck, of 180 224 faces."""
    body, neck = (
        trimesh.creation.box([80.0, 60.0, 150.0]),
        trimesh.creation.cylinder(15.0, 40.0, sections=128),
    )
    for _ in range(6):
        body = body.subdivide()
    for _ in range(4):
        neck = neck.subdivide()
    return trimesh.util.concatenate([body, neck.apply_translation([0.0, 0.0, 80.0])])


def command_table(console: Console) -> None:
    """Print the time of the whole command with cards, and the time to load its libraries."""
    table = Table(
        title="analyze plan OBJECT -o PLAN.json, with cards: CPU and wall time [s], best of 3",
        title_justify="left",
    )
    for heading in ("input", "CPU", "wall"):
        table.add_column(heading, justify="right")
    box, fine = trimesh.creation.box([80.0, 60.0, 150.0]), flask()
    # The tags' places are removed, because they belong to the carton.
    text = re.sub(r"T_object_marker = \[(.|\n)*?\n\]\n", "", CARTON.read_text(encoding="utf-8"))
    libraries = (
        "import numpy, scipy.spatial, scipy.linalg, pydantic, click, rich.table, rich.progress, jinja2, cv2"
    )
    jobs = {"libraries alone": (sys.executable, "-c", libraries)}
    with tempfile.TemporaryDirectory() as folder:
        for what, name, data in (
            (f"cloud of {POINTS} points", "c.ply", _ply(noisy_cloud(box, 1.0, 1, False))),
            (f"mesh of {len(fine.faces)} faces", "m.stl", fine.export(file_type="stl")),
        ):
            (Path(folder) / name).write_bytes(data)
            shape = f'file = "{name}"\nunit = "mm"'
            thing = Path(folder) / f"{name}.toml"
            thing.write_text(re.sub(r"box = .*", shape, text), encoding="utf-8")
            jobs[what] = (
                sys.executable,
                "-m",
                "analyze",
                "plan",
                str(thing),
                "-o",
                str(Path(folder) / "plan.json"),
            )
        for what, command in jobs.items():
            runs = []
            for _ in range(3):
                before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
                runs.append((after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall))
            table.add_row(what, f"{min(cpu for cpu, _ in runs):.2f}", f"{min(wall for _, wall in runs):.2f}")
    console.print(table)


def _ply(points: np.ndarray) -> bytes:
    return trimesh.PointCloud(points).export(file_type="ply")


def main() -> int:
    """Print the chosen tables; returns 1 if a disagreement is unexplained."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("part", choices=("noise", "poses", "speed"))
    parser.add_argument("path", nargs="?", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    console = Console(width=160)
    if given.part == "noise":
        noise_table(console, given.seeds)
    elif given.part == "poses":
        return int(poses_table(console, given.path or Path("no-folder")) > 0)
    else:
        speed_table(console, given.path)
        command_table(console)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
