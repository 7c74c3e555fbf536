"""phi and k on curved flanks against the Cramer-Rao bound: `make bench-rolling`.

The motion follows Newton's law on the true ellipse or circle (tests/analyze/motion/rolling.py); the fit has
an outline of 24 facets. The energy ratio E (energy after the strike over the energy needed to tip) is 0.8 to
3, noise 0.05 to 0.5 degrees, 120 frames per second. The bound is for those frames with the fit's priors on a
body (c near the section's middle, J within its half), by variation of the simulated bodies. Strikes that
would slide at a friction of 0.8, or lift, are drawn again. Interval columns are for 95 % intervals; "width"
is their median half width over twice the rms error (ideally 1).
"""

from __future__ import annotations

import math
from collections import defaultdict

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from analyze.errors import EstimationError
from analyze.least_squares.intervals import SIGMAS_95
from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.rolling_fit import rolling_fit
from analyze.types import MotionFit
from tests.analyze.motion.rolling import SeenRoll, draw_rolling, section_of_body, seen_roll
from tests.benchmarks.fit_error import MAX_BOUND, NOISES, Error

SECTIONS = ((0.005, 0.005), (0.015, 0.015), (0.04, 0.04), (0.04, 0.02), (0.025, 0.05))
"""half axes [m] along and off the table"""


def draw(rng: np.random.Generator, section: tuple[float, float]) -> tuple[SeenRoll, float]:
    """Random strike with its noise [deg]."""
    while True:
        noise = 0.05 * 10 ** rng.uniform(0, 1)
        found = seen_roll(draw_rolling(rng, *section), rng.uniform(0.8, 3.0), math.radians(noise), rng)
        if found is not None:
            return found, noise


def error(seen: SeenRoll, fit: MotionFit, bound: tuple[float, float]) -> Error:
    k = seen.body.k
    sds = np.sqrt(np.diag(fit.covariance))
    return Error(
        fit.phi - seen.body.phi, (fit.k or math.nan) / k - 1, float(sds[0]), float(sds[1]) / k, *bound
    )


def measured(count: int, seed: int) -> tuple[dict[tuple[int, int, str], list[Error]], int, int]:
    """Errors by section, noise and estimator; number of strikes left out, and of failed fits."""
    errors: dict[tuple[int, int, str], list[Error]] = defaultdict(list)
    vague = failed = 0
    for number, section in enumerate(SECTIONS):
        rng = np.random.default_rng([seed, number])
        for _ in track(range(count), console=Console(stderr=True), transient=True, description=str(section)):
            seen, noise = draw(rng, section)
            flank = section_of_body(seen.body)
            bound = seen.bound(flank.middle_sd)
            if bound[0] > MAX_BOUND:
                vague += 1
                continue
            band = next(i for i, pair in enumerate(NOISES) if noise <= pair[1] + 1e-9)
            for name in ("rolling_fit", "pivot_fit"):
                try:
                    fit = (
                        rolling_fit(seen.angle, seen.window, flank)
                        if name == "rolling_fit"
                        else pivot_fit(seen.angle, seen.window)
                    )
                except EstimationError:
                    failed += name == "rolling_fit"
                    continue
                errors[number, band, name].append(error(seen, fit, bound))
    return errors, vague, failed


def _cells(some: list[Error]) -> list[str]:
    cells: list[str] = []
    for values, sds, bounds, size, unit in (
        (
            [e.phi for e in some],
            [e.sd_phi for e in some],
            [e.bound_phi for e in some],
            math.degrees(1.0),
            "°",
        ),
        ([e.k for e in some], [e.sd_k for e in some], [e.bound_k for e in some], 100.0, " %"),
    ):
        off, sd, bound = np.array(values), np.array(sds), np.array(bounds)
        ratio = float(np.sqrt(np.mean((off / bound) ** 2)))
        cells += [
            f"{size * float(np.median(np.abs(off))):.3f}{unit}",
            f"{ratio:.2f}",
            f"{100 * np.mean(np.abs(off) < SIGMAS_95 * sd):.0f} %",
            f"{float(np.median(SIGMAS_95 * sd / bound)) / (2 * ratio):.2f}",
        ]
    return cells


def table_of(title: str, rows: list[tuple[str, str, list[Error]]]) -> Table:
    table = Table(title=title)
    half = ("median |error|", "rms / bound", "in 95 %", "width")
    for heading in ("", "estimator", "strikes", *(f"phi: {h}" for h in half), *(f"k: {h}" for h in half)):
        table.add_column(heading, justify="left" if heading in ("", "estimator") else "right")
    for first, name, some in rows:
        if some:
            table.add_row(first if name == "rolling_fit" else "", name, str(len(some)), *_cells(some))
    return table


@click.command()
@click.option("--strikes", default=120, show_default=True, help="Strikes on each section.")
@click.option("--seed", default=1, show_default=True)
def main(strikes: int, seed: int) -> None:
    """Simulate strikes over curved flanks, and print the errors of phi and k beside their bound."""
    console = Console(width=190)
    errors, vague, failed = measured(strikes, seed)
    names = ("rolling_fit", "pivot_fit")

    def form(section: tuple[float, float]) -> str:
        a, b = (1000 * axis for axis in section)
        return f"arc of {a:g} mm" if a == b else f"ellipse {a:g} x {b:g} mm"

    by_section = [
        (form(section), name, [e for band in range(len(NOISES)) for e in errors[i, band, name]])
        for i, section in enumerate(SECTIONS)
        for name in names
    ]
    by_noise = [
        (f"{low:g}-{high:g}°", name, [e for i in range(len(SECTIONS)) for e in errors[i, band, name]])
        for band, (low, high) in enumerate(NOISES)
        for name in names
    ]
    console.print(
        table_of(
            f"{strikes} strikes on each section (bound too large {vague}, not fitted {failed})", by_section
        )
    )
    console.print(table_of("the same by noise", by_noise))


if __name__ == "__main__":
    main()
