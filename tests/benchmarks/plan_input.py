"""Benchmarks of planning's input: edges of noisy clouds, stable planes, and time of planning.

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
from pathlib import Path

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table

from analyze.verbs.plan.plan_object import PlanOptions, plan_object
from tests.benchmarks.plan_noise import POINTS, noise_table, noisy_cloud
from tests.benchmarks.plan_poses import poses_table
from tests.places import CARTON

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
