"""Coverage and width of the 95 % intervals: `make coverage` (300 sessions, ten to twenty minutes).

Random boxes and meshes with random masses inside, from theta(t) of nine planned strikes to the whole answer
(simulated_tips.py describes what is simulated and drawn). "Width" is the median half width of an interval
over twice the rms error, "scatter" the rms error over the stated sd; both are ideally 1. Bodies of a shell
and two uniform parts are judged separately from bodies with lumps inside. For lumps, the estimated masses are
compared with the true masses on either side of the estimated dividing plane, and separately where the answer
itself reports that no dividing plane explains the moments.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from analyze.errors import EstimationError
from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.estimate import Estimate, estimate_evidence
from analyze.pipeline.evidence import Evidence
from analyze.result.document import regions_document
from tests.benchmarks.simulated_tips import Truth, session

EMPTY_REGION_FRACTION = 0.01
"""fraction of the mass below which a region counts as empty: its mass is at its bound"""
PER_SHAPE = 3


@dataclass
class Rows:
    """Errors, stated sd and whether the interval held, by quantity."""

    error: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    sd: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    held: dict[str, list[bool]] = field(default_factory=lambda: defaultdict(list))
    half: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, name: str, error: float, sd: float, interval: tuple[float, float] | None = None) -> None:
        """Add an error; `interval` (low, high) of the error if it is not 1.96 sd to each side."""
        low, high = (-SIGMAS_95 * sd, SIGMAS_95 * sd) if interval is None else interval
        self.error[name].append(error)
        self.sd[name].append(sd)
        self.held[name].append(low <= error <= high)
        self.half[name].append((high - low) / 2)


def judge(estimate: Estimate, truth: Truth, rows: Rows) -> None:
    """Add the errors of all quantities."""
    com, inertial = estimate.com, estimate.inertial
    off = com.position - truth.com
    sd = np.sqrt(np.diag(com.covariance))
    if com.observed:
        for axis in range(3):
            rows.add(f"c {'xyz'[axis]} (mm)", 1e3 * off[axis], 1e3 * sd[axis])
        _distance(off, com.covariance, rows)
    for axis in inertial.axes:
        about = float(axis.direction @ truth.inertia @ axis.direction)
        rows.add("I_c,l (%)", 100 * (axis.i_com / about - 1), 100 * axis.i_com_sd / about)
        plane = next(plane for plane in estimate.planes if plane.axis_id == axis.axis_id)
        arm = truth.com - plane.point
        R = float(np.linalg.norm(arm - plane.direction * (arm @ plane.direction)))
        # About the planned edge: the error of its position is included, as in the target 2 % + 2 mm/R.
        edge = about + truth.mass * (R + plane.edge_radius) ** 2
        rows.add("I_edge (%)", 100 * (axis.i_edge / edge - 1), 100 * axis.i_edge_sd / edge)
    size = float(np.trace(truth.inertia)) / 3
    for i in range(3):
        for j in range(i, 3):
            source = "measured" if inertial.measured[i, j] else "from the prior"
            name = f"I {'diagonal' if i == j else 'products'}, {source} (%)"
            rows.add(
                name,
                100 * (inertial.inertia[i, j] - truth.inertia[i, j]) / size,
                100 * inertial.inertia_sd[i, j] / size,
            )
    _masses(estimate, truth, rows)


def _distance(off: np.ndarray, covariance: np.ndarray, rows: Rows) -> None:
    """Add the distance of c, held if c lies in the 95 % ellipsoid; its sd is the root of the trace."""
    mahalanobis = float(off @ np.linalg.solve(covariance, off))
    rows.add("c distance (mm)", 1e3 * float(np.linalg.norm(off)), 1e3 * float(np.sqrt(np.trace(covariance))))
    rows.held["c distance (mm)"][-1] = mahalanobis < 7.815


def _masses(estimate: Estimate, truth: Truth, rows: Rows) -> None:
    distribution = estimate.distribution
    if truth.regions is not None:
        same = distribution.dividing_plane_normal @ truth.dividing_plane_normal >= 0
        true, kind = truth.regions if same else truth.regions[[0, 2, 1]], "region masses"
    else:
        height = truth.points @ distribution.dividing_plane_normal - distribution.dividing_plane_offset
        parts = (truth.in_shell, ~truth.in_shell & (height > 0), ~truth.in_shell & (height <= 0))
        true, kind = np.array([truth.masses[part].sum() for part in parts]), "masses of lumps"
    regions = regions_document(estimate.distribution)

    for region, value in zip(regions.regions, true, strict=True):
        found, sd, interval = region.mass.value, region.mass.sd, region.mass.interval95
        assert isinstance(found, float)
        assert isinstance(sd, float)
        assert interval is not None
        low, high = (float(np.array(end)) for end in interval)
        note = ", at the bound" if value < EMPTY_REGION_FRACTION * truth.mass else ""
        if not distribution.explained:
            note += ", reported as unexplained"
        part = 100 / truth.mass
        rows.add(
            f"{kind}{note} (% of m)",
            part * (found - value),
            part * sd,
            (part * (found - high), part * (found - low)),
        )
        low, high = (float(end) for end in region.limits_kg or (0.0, truth.mass))
        rows.add(
            f"{kind}, limits for any inside (% of m)",
            part * (found - value),
            part * sd,
            (part * (found - high), part * (found - low)),
        )
    metric = float(np.abs(distribution.masses - true).mean() / truth.mass)
    naive = min(float(np.abs(other - true).mean() / truth.mass) for other in distribution.baselines.values())
    rows.error[f"{kind}: paper's metric"].append(100 * metric)
    rows.error[f"{kind}: best naive answer's"].append(100 * naive)


def table(rows: Rows, title: str) -> Table:
    """Table with one row per quantity."""
    found = Table(title=title, title_justify="left")
    for heading in (
        "",
        "number",
        "median |error|",
        "rms error",
        "worst",
        "in 95 % interval",
        "width",
        "scatter",
    ):
        found.add_column(heading, justify="right" if heading else "left")
    for name in sorted(rows.error):
        error = np.array(rows.error[name])
        cells = [
            str(len(error)),
            f"{np.median(np.abs(error)):.2f}",
            f"{np.sqrt(np.mean(error**2)):.2f}",
            f"{np.abs(error).max():.2f}",
        ]
        if name in rows.held:
            rms, sd = float(np.sqrt(np.mean(error**2))), np.array(rows.sd[name])
            if "distance" in name:
                # The mean square of a distance is the trace of the covariance.
                width, scatter = float(np.median(sd)) / rms, float(np.sqrt(np.mean((error / sd) ** 2)))
            else:
                width, scatter = (
                    float(np.median(rows.half[name])) / (2 * rms),
                    float(np.sqrt(np.mean((error / np.maximum(sd, 1e-9)) ** 2))),
                )
            cells += [f"{100 * np.mean(rows.held[name]):.1f} %", f"{width:.2f}", f"{scatter:.2f}"]
        found.add_row(name, *cells)
    return found


def sessions(count: int, seed: int) -> Iterator[tuple[Evidence, Truth]]:
    """Iterate over simulated sessions of bodies that can be planned and stand."""
    found = number = 0
    while found < count:
        made = session(1_000_000 * seed + number // PER_SHAPE, number % PER_SHAPE)
        number += 1
        if made is not None:
            found += 1
            yield made


@dataclass
class Tally:
    """Results of all sessions so far."""

    rows: Rows = field(default_factory=Rows)
    refused: int = 0
    open_ones: int = 0
    seconds: list[float] = field(default_factory=list)
    mean: list[float] = field(default_factory=list)

    def add(self, evidence: Evidence, truth: Truth) -> None:
        """Estimate one session and compare it with ground truth."""
        began = time.process_time()
        try:
            estimate = estimate_evidence(evidence)
        except EstimationError:
            self.refused += 1
            return
        self.seconds.append(time.process_time() - began)
        judge(estimate, truth, self.rows)
        self.open_ones += not estimate.com.observed
        self.mean.append(1e3 * float(np.linalg.norm(estimate.com.position - truth.com)))

    def print(self, console: Console, seed: int) -> None:
        """Print the table, the distances of c and the times."""
        many = len(self.mean) + self.refused
        console.print(
            table(
                self.rows,
                f"{many} sessions, seed {seed}: {self.refused} refused, {self.open_ones} with an open "
                "direction",
            )
        )
        mean, seconds = np.array(self.mean), np.array(self.seconds)
        console.print(
            f"c: mean distance {mean.mean():.2f} mm, median {np.median(mean):.2f}, worst {mean.max():.2f}"
        )
        console.print(
            f"from phi and k of nine strikes to all results: median {np.median(seconds):.2f} s of CPU, worst "
            f"{seconds.max():.2f} s"
        )


@click.command()
@click.option("--sessions", "count", default=300, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option(
    "--every",
    default=0,
    show_default=True,
    help="Also print the results so far after every so many sessions (stderr).",
)
def main(count: int, seed: int, every: int) -> None:
    """Simulate sessions, estimate them and compare with ground truth."""
    quiet, tally = Console(stderr=True, width=150), Tally()
    for number, (evidence, truth) in enumerate(
        track(sessions(count, seed), total=count, console=quiet, transient=True), 1
    ):
        tally.add(evidence, truth)
        if every and number % every == 0 and number < count:
            tally.print(quiet, seed)
    tally.print(Console(width=150), seed)


if __name__ == "__main__":
    main()
