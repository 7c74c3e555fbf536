"""Strikes by print in a path tracer's films, beside the truth: `make bench-print-traced`.

    python -m tests.benchmarks.print_traced --strikes 1 --objects carton --styles photo,blank

Bodies are struck in the virtual rig's physics; a path tracer that shares nothing with the rig's renderer or
the tracker films them (tests/benchmarks/traced_films.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import click
import cv2
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.transform import Rotation

from acquire.virtual.world import World
from analyze.types import CameraModel, ImageFrame
from tests.benchmarks.honesty.observed import T0
from tests.benchmarks.print_sessions import (
    SHIFT_SD,
    STRAIN_SD,
    YAW_SD,
    StrikeRow,
    analyse,
    chosen,
    scene,
)
from tests.benchmarks.print_strikes import RATE_HZ, USUAL_EXPOSURE_US, FilmPath, Placement, struck
from tests.benchmarks.traced_films import STYLES, SUBEXPOSURES, Tracer

WIDTH, HEIGHT, FOCAL = 656, 492, 1430.0
REST_S = 0.12
"""time filmed before the push [s]"""
_COLUMNS = (
    "object",
    "print",
    "strike",
    "verdict",
    "theta rms [deg]",
    "bias [deg]",
    "phi [deg]",
    "z",
    "k [%]",
    "z",
)


def filmed(name: str, style: str, seed: int, strikes: int) -> Iterator[StrikeRow]:
    """Strike, trace and analyse an object's first strikes, each about an axis of its own."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, 0x7ACED, *name.encode()))
    on = scene(name, seed, False, rng)
    K = np.array([[FOCAL, 0, WIDTH / 2 - 0.5], [0, FOCAL, HEIGHT / 2 - 0.5], [0, 0, 1]])
    camera = CameraModel(WIDTH, HEIGHT, K, np.zeros(5), on.place.T_world_camera, strain_sd=STRAIN_SD)
    on = replace(on, camera=camera)
    world = World(on.thing, lambda *_: 0.0, table_tilt=(0.0, on.tilt), arm_angle=-2.5)
    for planned in chosen(on.plan, strikes):
        placed = Placement(*rng.normal(0, (YAW_SD, SHIFT_SD, SHIFT_SD)))
        motion = struck(world, on.thing, planned, placed, (float(rng.uniform(1.05, 1.3)), 0.003))
        times = np.arange(-round(REST_S * RATE_HZ), int(motion.time[-1] * RATE_HZ)) / RATE_HZ
        times = times + rng.random() / RATE_HZ
        path = FilmPath(motion, planned.heading_rad)
        tracer = Tracer(camera, on.model.vertices, on.model.faces, style, seed)
        frames: list[ImageFrame] = []
        for number, time in enumerate(times[times < motion.time[-1] - 0.01]):
            steps = (np.arange(SUBEXPOSURES) + 0.5) / SUBEXPOSURES - 0.5
            p, q, _, _ = path.at(time + steps * 1e-6 * USUAL_EXPOSURE_US)
            R = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
            frames.append(
                ImageFrame(T0 + round(1e9 * time), number, tracer.image(R, p, at_rest=time < -1e-3))
            )
        row, _ = analyse(on, "print", planned, motion, frames)
        yield replace(row, name=name, seed=seed, road=style)


@click.command()
@click.option(
    "--objects", default="carton,spray,juice,salt,parcel", show_default=True, help="Comma-separated."
)
@click.option("--styles", default=",".join(STYLES), show_default=True, help="Comma-separated.")
@click.option("--strikes", default=1, show_default=True, help="Strikes of each object and print.")
@click.option("--seed", default=1, show_default=True)
def main(objects: str, styles: str, strikes: int, seed: int) -> None:
    """Trace and analyse the strikes, and print the table."""
    table = Table(*_COLUMNS, title="strikes by print in a path tracer's films")
    cases = list(product(objects.split(","), styles.split(",")))
    console = Console(width=150, highlight=False)
    for name, style in track(cases, "films", console=Console(stderr=True)):
        for row in filmed(name, style, seed, strikes):
            numbers = [f"{math.degrees(row.rms):.4f}", f"{math.degrees(row.bias):+.4f}"]
            numbers += [
                f"{math.degrees(row.phi):+.4f}",
                f"{row.phi_z:+.2f}",
                f"{100 * row.k:+.3f}",
                f"{row.k_z:+.2f}",
            ]
            table.add_row(name, style, row.strike, row.verdict, *(numbers if row.usable else [""] * 6))
    console.print(table)


if __name__ == "__main__":
    main()
