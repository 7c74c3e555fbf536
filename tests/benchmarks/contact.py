"""Friction and restitution against truth on tables of several kinds: `make bench-contact`.

Sessions of virtual objects in the virtual rig's physics (contact_session.py). Printed per table: sessions
with a value of friction, its error, how often the 95 % interval holds the truth, and how often a bound holds;
for landings the error of the restitution against that of the true poses. Then `analyze predict`'s question:
some strikes are left out, and simulated in MuJoCo with the exported body as the other strikes estimate it,
with a uniform density, and as a shell.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table as RichTable
from scipy.spatial.transform import Rotation

from analyze.errors import AnalyzeError
from analyze.pipeline.contact_properties import with_contact_properties
from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.sections import strike_supports
from analyze.pipeline.solved import EstimateOptions
from analyze.predict.predict import ASSETS, predict_left_out
from schemas.strike_result import Verdict
from tests.benchmarks.contact_session import ContactSession, StruckStrike, Table, contact_session

OBJECTS = ("carton", "juice", "spray", "parcel", "salt")
FRICTIONS = (0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
RESTITUTIONS = (0.0, 0.3, 0.5)
TRUE_AFTER = 25
"""milliseconds after a landing from which the true speed is taken, three frames: the other edge trembles"""
PREDICTED = 2
"""strikes of a session that are left out and predicted"""


@dataclass(frozen=True)
class Row:
    """One session."""

    object: str
    seed: int
    friction: float
    value: float | None
    low: float | None
    high: float | None
    bound: float | None
    slid: int
    """strikes whose edge slid by more than 0.5 mm"""
    landings: tuple[tuple[float, float, float, float], ...]
    """value, sd, upper limit (nan where the rebound is resolved), truth"""
    predicted: tuple[tuple[float, float, float], ...] = ()
    """rms error [rad] of the tipping angle with the estimated, the uniform and the shell body, by strike"""
    refusal: str = ""


def run(name: str, seed: int, table: Table, rate: float, strikes: int) -> Row:
    """Simulate and estimate one session, and predict some of its strikes."""
    empty = Row(name, seed, table.friction, None, None, None, None, 0, ())
    made = contact_session(name, seed, table, rate or None, strikes)
    if made is None:
        return Row(**{**asdict(empty), "refusal": "no plan"})
    try:
        found = with_contact_properties(estimate_evidence(made.evidence)).contact
    except AnalyzeError as error:
        return Row(**{**asdict(empty), "refusal": str(error)})
    friction = found.friction if found else None
    restitution = found.restitution if found else None
    truths = {each.motion.strike_id: each for each in made.strikes}
    landings = []
    for each in restitution.landings if restitution else ():
        true = true_restitution(made, truths[each.strike_id])
        if true is not None:
            landings.append((each.value, each.sd, each.upper or math.nan, true))
    low, high = (friction.interval if friction else None) or (None, None)
    return Row(
        name, seed, table.friction,
        friction.value if friction else None, low, high, friction.bound if friction else None,
        sum(each.slid > 5e-4 for each in friction.strikes) if friction else 0,
        tuple(landings), predicted_errors(made, seed),
    )  # fmt: skip


def predicted_errors(made: ContactSession, seed: int) -> tuple[tuple[float, float, float], ...]:
    """Rms errors [rad] of some strikes that the estimate left out, by body."""
    over = [each.motion.strike_id for each in made.strikes if each.motion.verdict is Verdict.GOOD]
    rng = np.random.default_rng([seed, 0x9E])
    wanted = tuple(rng.permutation(over)[:PREDICTED].tolist())
    try:
        found = predict_left_out(made.evidence, EstimateOptions(), wanted) if wanted else None
    except AnalyzeError:
        return ()
    strikes = found.strikes if found else ()
    return tuple((*(each.error(name).rms for name in ASSETS),) for each in strikes)


def true_restitution(made: ContactSession, strike: StruckStrike) -> float | None:
    """Speed of the line that lands, after over before, by the true poses; None if none lands in time."""
    if not strike.truth.over:
        return None
    lines = strike_supports(made.evidence.model, strike.planned)
    if lines is None or len(lines) < 2:
        return None
    R0, pivot = np.array(strike.planned.R_world_object), np.array(strike.planned.pivot.point)
    first, second = lines[0], lines[1]
    far = pivot + R0.T @ np.array([second.along_m - first.along_m, 0.0, second.up_m - first.up_m])
    path = Rotation.from_quat(strike.truth.quaternion).apply(far) + strike.truth.position
    height, time = path[:, 2] - strike.planned.pivot.radius_m, strike.truth.time
    down = np.flatnonzero((height < 5e-4) & (time > 0.1))
    if not len(down) or down[0] + 8 + TRUE_AFTER >= len(time) or down[0] < 12:
        return None
    at = int(down[0])
    fall = np.polyfit(time[at - 10 : at], height[at - 10 : at], 2)
    turned = at + int(np.argmin(height[at : at + 8]))
    late = slice(turned + 2, turned + TRUE_AFTER)
    rise = np.polyfit(time[late], height[late], 2)
    before, after = np.polyval(np.polyder(fall), time[turned]), np.polyval(np.polyder(rise), time[turned])
    return max(0.0, float(-after / before))


def sessions(
    objects: tuple[str, ...], frictions: tuple[float, ...], seeds: int
) -> Iterator[tuple[str, int, Table]]:
    """Objects, seeds and tables, the kinds of restitution in turn."""
    for seed in range(1, seeds + 1):
        for i, friction in enumerate(frictions):
            for j, name in enumerate(objects):
                yield name, seed, Table(friction, RESTITUTIONS[(i + j + seed) % len(RESTITUTIONS)])


@click.command()
@click.option("--objects", default=",".join(OBJECTS), show_default=True)
@click.option("--frictions", default=",".join(map(str, FRICTIONS)), show_default=True)
@click.option("--seeds", default=3, show_default=True)
@click.option("--strikes", default=6, show_default=True, help="Planned strikes of a session.")
@click.option("--rate", default=120.0, show_default=True, help="Frames per second; 0 to draw 120 or 240.")
@click.option("--workers", default=2, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Also write the rows.")
def main(
    objects: str,
    frictions: str,
    seeds: int,
    strikes: int,
    rate: float,
    workers: int,
    json_path: Path | None,
) -> None:
    """Run the sessions and print the tables."""
    console = Console(width=150)
    wanted = list(
        sessions(tuple(objects.split(",")), tuple(float(each) for each in frictions.split(",")), seeds)
    )
    rows: list[Row] = []
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(run, *each, rate, strikes) for each in wanted]
        for future in track(
            as_completed(futures), total=len(futures), console=Console(stderr=True), transient=True
        ):
            rows.append(future.result())
            if json_path is not None:
                with json_path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(rows[-1])) + "\n")
    console.print(friction_table(rows))
    console.print(restitution_table(rows))
    console.print(prediction_table(rows))


def friction_table(rows: list[Row]) -> RichTable:
    """Errors of friction by table, and of all."""
    table = RichTable(title=f"friction: {len(rows)} sessions", title_justify="left")
    for heading in (
        "table", "sessions", "no answer", "value given", "median |error|", "largest", "in 95 %", "half-width",
        "bound holds", "median bound",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for friction in (*sorted({row.friction for row in rows}), None):
        some = [row for row in rows if friction is None or row.friction == friction]
        answered = [row for row in some if row.bound is not None]
        valued = [
            row for row in answered if row.value is not None and row.low is not None and row.high is not None
        ]
        error = np.array([abs((row.value or 0) - row.friction) for row in valued])
        inside = [(row.low or 0) <= row.friction <= (row.high or 0) for row in valued]
        width = [((row.high or 0) - (row.low or 0)) / 2 for row in valued]
        bounds = [row for row in answered if row.value is None]
        table.add_row(
            "all" if friction is None else f"{friction:g}", str(len(some)), str(len(some) - len(answered)),
            str(len(valued)),
            *((f"{np.median(error):.3f}", f"{error.max():.3f}", f"{100 * np.mean(inside):.0f} %",
               f"{np.median(width):.3f}") if len(error) else ("", "", "", "")),
            f"{sum((row.bound or 0) <= row.friction for row in bounds)} of {len(bounds)}",
            f"{np.median([row.bound or 0 for row in bounds]):.2f}" if bounds else "",
        )  # fmt: skip
    return table


def restitution_table(rows: list[Row]) -> RichTable:
    """Errors of the restitution per landing."""
    table = RichTable(title="restitution, each landing", title_justify="left")
    for heading in ("object", "landings", "resolved", "median |error|", "rms", "in 95 %", "limit holds"):
        table.add_column(heading, justify="right")
    for name in (*sorted({row.object for row in rows}), None):
        all_of = [each for row in rows for each in row.landings if name is None or row.object == name]
        seen = np.array([each for each in all_of if math.isnan(each[2])]).reshape(-1, 4)
        limits = [each[3] <= each[2] for each in all_of if not math.isnan(each[2])]
        error = seen[:, 0] - seen[:, 3]
        table.add_row(
            name or "all", str(len(all_of)), str(len(seen)),
            *((f"{np.median(np.abs(error)):.4f}", f"{np.sqrt(np.mean(error**2)):.4f}",
               f"{100 * np.mean(np.abs(error) < 1.96 * seen[:, 1]):.0f} %") if len(seen) else ("", "", "")),
            f"{sum(limits)} of {len(limits)}",
        )  # fmt: skip
    return table


def prediction_table(rows: list[Row]) -> RichTable:
    """Errors of predicted strikes by body."""
    table = RichTable(
        title="left-out strikes simulated: rms error of the tipping angle", title_justify="left"
    )
    for heading in (
        "object",
        "strikes",
        "estimated",
        "uniform",
        "shell",
        "uniform / estimated",
        "estimated better",
    ):
        table.add_column(heading, justify="right")
    for name in (*sorted({row.object for row in rows}), None):
        errors = np.array([e for row in rows if name is None or row.object == name for e in row.predicted])
        if not len(errors):
            continue
        medians = np.median(errors, axis=0)
        table.add_row(
            name or "all", str(len(errors)), *(f"{math.degrees(each):.2f}°" for each in medians),
            f"{medians[1] / medians[0]:.1f}", f"{100 * np.mean(errors[:, 0] < errors[:, 1]):.0f} %",
        )  # fmt: skip
    return table


if __name__ == "__main__":
    main()
