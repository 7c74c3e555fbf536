"""Table tilt and c with and without a second heading of one edge: `make bench-gravity` (two minutes).

Tips in space on a sloping table (tests/analyze/estimation/tilted_table.py), which shares no code with the
estimators. theta(t) at 120 fps with 0.05 deg noise a frame, edges off by 0.2 mm, edge radius by 0.1 mm,
angles by 0.03 deg from strike to strike. Plumb lines are rendered into images of the rig's camera, whose
rotation against the table is drawn as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from analyze.calibration.plumb import find_plumb_lines, table_lean, upright
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.least_squares.intervals import SIGMAS_95
from analyze.motion.pendulum_fit import pivot_fit
from analyze.types import CameraModel, EquiPlane
from tests.analyze.calibration.plumb_scenes import LENS, WORLD_CAMERA, Scene, photograph, turned
from tests.analyze.estimation.bodies import Body, box_body, planned_strike
from tests.analyze.estimation.tilted_table import (
    ErrorSds,
    PlacedStrike,
    measured_tips,
    placed_session,
    reversed_strike,
)

SIZE = (0.08, 0.06, 0.15)
NOISE = math.radians(0.05)
DESIGNS = {
    "3 of one face": ((2, -1, 1, 1), (2, -1, 1, -1), (2, -1, 0, 1)),
    "3, upside down too": ((2, -1, 1, 1), (2, 1, 1, 1), (0, -1, 2, 1)),
    "6 of 4 faces": (
        (2, -1, 1, 1),
        (2, -1, 0, 1),
        (2, -1, 1, -1),
        (0, -1, 1, 1),
        (1, -1, 2, 1),
        (1, 1, 0, 1),
    ),
}
PRIOR_SD = math.radians(0.2)
CAMERA = CameraModel(
    LENS.width,
    LENS.height,
    np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1]]),
    np.array(LENS.k),
    WORLD_CAMERA,
)
TURNED = 2
"""largest number of strikes with the object turned by 180 degrees"""


@dataclass(frozen=True)
class Sessions:
    """Objects and equi-planes of many sessions.

    Each has `many` planned strikes, one more strike of that kind, and strikes with the object turned by 180
    degrees.
    """

    bodies: list[Body]
    planes: list[list[EquiPlane]]
    rise: list[float]
    """slope of the table towards +x in each session [rad]"""
    many: int

    def parts(self) -> dict[str, Callable[[list[EquiPlane]], list[EquiPlane]]]:
        """Selections of a session's equi-planes, by name."""
        many = self.many
        return {
            f"{many}": lambda planes: planes[:many],
            f"{many} + 1 as before": lambda planes: planes[: many + 1],
            f"{many} + 1 turned": lambda planes: planes[:many] + planes[many + 1 : many + 2],
            f"{many} + {TURNED} turned": lambda planes: planes[:many] + planes[many + 1 :],
        }


def simulated(axes: Sequence[tuple[int, int, int, int]], drawn: float, count: int, seed: int) -> Sessions:
    """Objects and equi-planes of `count` sessions on tables of random slope.

    Args:
        axes: face, sign, along and side of each pivot edge, as `planned_strike` takes them.
        drawn: 1 sigma of the table's slope [rad].
        count: number of sessions.
        seed: seed of bodies, slopes and noise.
    """
    many = 9 if len(axes) == 3 else 12
    laid: list[list[PlacedStrike]] = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        regions = (0.026, *(rng.dirichlet([2.0, 2.0]) * 0.018).tolist())
        body = box_body(
            SIZE, regions, rng.uniform(-0.01, 0.01), tuple(rng.normal(0, 1, 3).tolist()), pitch=0.01
        )
        planned = [planned_strike(body, *axes[i % len(axes)], i // len(axes)) for i in range(many + 1)]
        planned += [reversed_strike(planned[0], i) for i in range(TURNED)]
        laid.append(placed_session(body, planned, ErrorSds(drawn), rng))
    flat = [each for session in laid for each in session]
    seen = measured_tips(flat, NOISE, np.random.default_rng([seed, count]))
    planes = [
        equiplane_from_fit(each.strike.id, each.strike, pivot_fit(angle, window))
        for each, (angle, window) in zip(flat, seen, strict=True)
    ]
    size = len(laid[0])
    return Sessions(
        [session[0].body for session in laid],
        [planes[i : i + size] for i in range(0, len(planes), size)],
        [float(session[0].slope[0]) for session in laid],
        many,
    )


def heading_table(count: int, seed: int) -> Table:
    table = Table(title=f"{count} sessions each; errors are rms", title_justify="left")
    headings = (
        "edges",
        "strikes",
        "tilt drawn, stated",
        "tilt error",
        "stated sd",
        "in 95 %",
        "c error (mm)",
        "stated sd",
        "in 95 %",
    )
    for heading in headings:
        table.add_column(heading, justify="left" if heading in ("edges", "strikes") else "right")
    half = np.array(SIZE) / 2
    prior = ComPrior.from_bounds(-half, half)
    for name, axes in DESIGNS.items():
        for drawn, stateds in ((0.2, (0.2,)), (0.5, (0.5, 0.2))):
            sessions = simulated(axes, math.radians(drawn), count, seed)
            for stated in stateds:
                systematic = SystematicErrors(math.radians(stated), edge_radius_sd=1e-4)
                for label, chosen in sessions.parts().items():
                    found = [centre_of_mass(chosen(planes), systematic, prior) for planes in sessions.planes]
                    c = np.array(
                        [each.position - body.com for each, body in zip(found, sessions.bodies, strict=True)]
                    )
                    c_sd = np.array([np.sqrt(np.diag(each.covariance)) for each in found])
                    tilt = np.array([each.tilts[0].lean[0] for each in found]) - sessions.rise
                    tilt_sd = np.array([each.tilts[0].sd[0] for each in found])
                    table.add_row(
                        name,
                        label,
                        f"{drawn}°, {stated}°",
                        f"{np.degrees(np.sqrt(np.mean(tilt**2))):.3f}°",
                        f"{np.degrees(np.sqrt(np.mean(tilt_sd**2))):.3f}°",
                        f"{100 * np.mean(np.abs(tilt) < SIGMAS_95 * tilt_sd):.0f} %",
                        f"{1e3 * np.sqrt(np.mean(np.sum(c**2, axis=1))):.2f}",
                        f"{1e3 * np.sqrt(np.mean(np.sum(c_sd**2, axis=1))):.2f}",
                        f"{100 * np.mean(np.abs(c) < SIGMAS_95 * c_sd):.0f} %",
                    )
            table.add_section()
    return table


def plumb_table(count: int, seed: int) -> Table:
    table = Table(
        title=f"plumb lines: {count} rendered images each; slope towards x, y: rms error, sd, coverage",
        title_justify="left",
    )
    for heading in (
        "strings",
        "camera's rotation (°)",
        "x error (°)",
        "x sd",
        "x in 95 %",
        "y error (°)",
        "y sd",
        "y in 95 %",
    ):
        table.add_column(heading, justify="left" if heading == "strings" else "right")
    cases = (
        ("1, in the middle", ((0.03, 0.0),), Scene()),
        ("2, far apart", ((-0.05, -0.1), (0.12, 0.05)), Scene()),
        ("2, thin and pale", ((-0.05, -0.1), (0.12, 0.05)), Scene(width_px=1.0, string=110)),
        ("2, bright, and a box", ((-0.05, -0.1), (0.12, 0.05)), Scene(string=240, ground=110, box=True)),
    )
    for camera_sd in (0.0, 0.05):
        for name, strings, scene in cases:
            off, stated = [], []
            for number in range(count):
                rng = np.random.default_rng([seed, number])
                slope = rng.normal(0, PRIOR_SD, 2)
                real = turned(WORLD_CAMERA, rng.normal(0, math.radians(camera_sd), 3))
                hung = [(x + rng.normal(0, 0.004), y) for x, y in strings]
                lines = find_plumb_lines(photograph(hung, slope, rng, scene, real), CAMERA)
                found = table_lean(
                    upright(lines, CAMERA), CAMERA, PRIOR_SD, max(math.radians(camera_sd), 1e-7)
                )
                off.append(found.lean - slope)
                stated.append(found.sd)
            errors, sds = np.array(off), np.array(stated)
            cells = [
                text
                for i in range(2)
                for text in (
                    f"{np.degrees(np.sqrt(np.mean(errors[:, i] ** 2))):.4f}",
                    f"{np.degrees(np.sqrt(np.mean(sds[:, i] ** 2))):.4f}",
                    f"{100 * np.mean(np.abs(errors[:, i]) < SIGMAS_95 * sds[:, i]):.0f} %",
                )
            ]
            table.add_row(name, f"{camera_sd}", *cells)
    return table


@click.command()
@click.option("--sessions", "count", default=100, show_default=True)
@click.option("--seed", default=20, show_default=True)
def main(count: int, seed: int) -> None:
    """Simulate the sessions and print the tables."""
    console = Console(width=160)
    console.print(heading_table(count, seed))
    console.print(plumb_table(count // 2, seed))


if __name__ == "__main__":
    main()
