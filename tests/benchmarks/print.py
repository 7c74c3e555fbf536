"""Strikes by an object's print beside the same strikes by tags: `make bench-print`.

    python -m tests.benchmarks.print --seeds 2 --objects carton --strikes 3
    python -m tests.benchmarks.print --disturbed --seeds 1

Objects of the virtual rig are struck in its physics, put down by hand (1 degree and 2 mm off, 1 sd), and
filmed with tags on blank faces, and without tags with strong, light and no print. theta is compared with the
truth from the contact to the landing, phi and k with the body's, and c of the session by the joint estimate.
A blank object must be refused; those that are not are counted, and those called good that are wrong.
With --disturbed single strikes are filmed under disturbances.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from acquire.virtual.objects import OBJECT_NAMES
from tests.benchmarks.print_disturbances import DISTURBANCES, DisturbedRow, run_disturbed
from tests.benchmarks.print_sessions import ROADS, SessionRow, StrikeRow, run_session

WRONG_Z = 3.0
"""error over its standard deviation from which on a good strike is wrong"""
WRONG_RAD = np.radians(0.1)
"""error of phi from which on a good strike is wrong, if it is beyond `WRONG_Z` too [rad]"""
WRONG_K = 0.01
"""the same for k, relative"""
_STRIKES = (
    "strikes", "refused", "good [%]", "frames seen [%]", "theta rms [deg]", "95 %", "|bias| [deg]", "95 %",
    "|phi| [deg]", "95 %", "|k| [%]", "95 %", "z theta", "z phi", "in [%]", "z k", "in [%]", "wrong good",
    "s/strike",
)  # fmt: skip
"""columns of the table of strikes"""
_SESSIONS = (
    "sessions", "answered", "good of strikes", "c [mm]", "largest", "z c", "in [%]", "tensor [%]", "z tensor",
    "in [%]",
)  # fmt: skip
"""columns of the table of sessions"""
Row = TypeVar("Row", StrikeRow, SessionRow)


def strike_table(rows: Sequence[StrikeRow], title: str) -> Table:
    """Errors of theta, phi and k by object and road."""
    return _by_object_and_road(rows, title, _STRIKES, _strike_cells)


def _strike_cells(rows: Sequence[StrikeRow]) -> list[str]:
    good = [row for row in rows if row.usable]
    refused = sum(row.verdict == "refused" for row in rows)
    head = [str(len(rows)), str(refused), f"{100 * len(good) / len(rows):.0f}"]
    if not good:
        return [*head, *[""] * 16]
    frames = sum(row.frames for row in good)
    return [
        *head,
        f"{100 * sum(row.seen for row in good) / max(frames, 1):.0f}",
        *_spread([np.degrees(row.rms) for row in good], 3),
        *_spread([abs(np.degrees(row.bias)) for row in good], 3),
        *_spread([abs(np.degrees(row.phi)) for row in good], 3),
        *_spread([100 * abs(row.k) for row in good], 2),
        f"{_rms(row.z_theta for row in good):.2f}",
        *_intervals([row.phi_z for row in good]),
        *_intervals([row.k_z for row in good]),
        str(sum(is_wrong(row) for row in good)),
        f"{np.mean([row.seconds for row in rows]):.1f}",
    ]


def is_wrong(row: StrikeRow) -> bool:
    """True if a good strike's phi or k is wrong by far more than it states."""
    wrong_phi = abs(row.phi_z) > WRONG_Z and abs(row.phi) > WRONG_RAD
    return wrong_phi or (abs(row.k_z) > WRONG_Z and abs(row.k) > WRONG_K)


def session_table(rows: Sequence[SessionRow], title: str) -> Table:
    """Errors of c and of the tensor by object and road."""
    return _by_object_and_road(rows, title, _SESSIONS, _session_cells)


def _by_object_and_road(
    rows: Sequence[Row], title: str, headings: Sequence[str], cells: Callable[[Sequence[Row]], list[str]]
) -> Table:
    """Table with a row for each object and road, and for all objects together."""
    table = Table(title=title, title_justify="left")
    for heading in ("object", "road", *headings):
        table.add_column(heading, justify="left" if heading in {"object", "road"} else "right")
    for name in (*dict.fromkeys(row.name for row in rows), "all"):
        for road in dict.fromkeys(row.road for row in rows):
            some = [row for row in rows if name in (row.name, "all") and row.road == road]
            if some:
                table.add_row(name, road, *cells(some))
    return table


def _session_cells(rows: Sequence[SessionRow]) -> list[str]:
    answered = [row for row in rows if row.com]
    strikes = f"{sum(row.good for row in rows)} of {sum(row.struck for row in rows)}"
    head = [str(len(rows)), str(len(answered)), strikes]
    if not answered:
        return [*head, *[""] * 7]
    com = [1e3 * float(np.linalg.norm(row.com)) for row in answered]
    return [
        *head,
        f"{np.median(com):.3f}",
        f"{max(com):.3f}",
        *_intervals([z for row in answered for z in row.com_z]),
        f"{100 * np.median([row.tensor for row in answered]):.2f}",
        *_intervals([z for row in answered for z in row.tensor_z]),
    ]


def disturbed_table(rows: Sequence[DisturbedRow]) -> Table:
    """Errors by disturbance and road, over the objects."""
    table = Table(title="disturbed strikes", title_justify="left")
    for heading in ("disturbance", "road", *_DISTURBED):
        table.add_column(heading, justify="left" if heading in {"disturbance", "road"} else "right")
    for name in dict.fromkeys(row.disturbance for row in rows):
        for road in dict.fromkeys(row.strike.road for row in rows):
            some = [row.strike for row in rows if row.disturbance == name and row.strike.road == road]
            good = [row for row in some if row.usable]
            verdicts: dict[str, int] = {}
            for row in some:
                verdicts[row.verdict] = verdicts.get(row.verdict, 0) + 1
            cells = [str(len(some)), ", ".join(f"{many} {word}" for word, many in verdicts.items())]
            measured = [row for row in some if np.isfinite(row.rms)]
            if measured:
                cells += _spread([np.degrees(row.rms) for row in measured], 3)
                cells += _spread([abs(np.degrees(row.bias)) for row in measured], 3)
            if measured and good:
                cells += _spread([abs(np.degrees(row.phi)) for row in good], 3)
                cells += _spread([100 * abs(row.k) for row in good], 2)
                cells += [f"{_rms(row.phi_z for row in good):.2f}", f"{_rms(row.k_z for row in good):.2f}"]
                cells += [str(sum(is_wrong(row) for row in good))]
            table.add_row(name, road, *cells)
    return table


_DISTURBED = (
    "strikes", "verdicts", "theta rms [deg]", "95 %", "|bias|", "95 %", "|phi| [deg]", "95 %", "|k| [%]",
    "95 %", "z phi", "z k", "wrong good",
)  # fmt: skip


def _spread(values: list[float], digits: int) -> list[str]:
    finite = [value for value in values if np.isfinite(value)]
    if not finite:
        return ["", ""]
    return [f"{np.median(finite):.{digits}f}", f"{np.quantile(finite, 0.95):.{digits}f}"]


def _rms(values: Iterable[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.sqrt(np.mean(np.square(finite)))) if finite else float("nan")


def _intervals(z: list[float]) -> list[str]:
    finite = np.array([value for value in z if np.isfinite(value)])
    if not len(finite):
        return ["", ""]
    return [f"{_rms(finite):.2f}", f"{100 * np.mean(np.abs(finite) < 1.96):.0f}"]


def _run(run: Callable[[Any], Any], cases: Sequence[Any], title: str, workers: int) -> Iterator[Any]:
    """Yield the results of cases as they end."""
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(run, case) for case in cases]
        console = Console(stderr=True)
        for done in track(as_completed(futures), title, len(futures), console=console, transient=True):
            yield done.result()


def _keep(path: Path | None, rows: Iterable[StrikeRow | SessionRow | DisturbedRow]) -> None:
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps({"kind": type(row).__name__, **asdict(row)}) + "\n" for row in rows)


@click.command()
@click.option("--seeds", default=10, show_default=True, help="Seeds of each object.")
@click.option("--first", default=1, show_default=True, help="First seed.")
@click.option("--objects", default=",".join(OBJECT_NAMES), show_default=True, help="Comma-separated.")
@click.option("--roads", default=",".join(ROADS), show_default=True, help="Comma-separated.")
@click.option("--strikes", default=9, show_default=True, help="Most strikes of a session.")
@click.option("--errors", type=click.Choice(["none", "drawn", "both"]), default="both", show_default=True)
@click.option("--disturbed", is_flag=True, help="Single strikes under disturbances instead.")
@click.option("--only", default=",".join(DISTURBANCES), help="Disturbances, comma-separated.")
@click.option("--workers", default=2, show_default=True)
@click.option("--json", "path", type=click.Path(path_type=Path), help="Also append every row to this file.")
def main(**options: Any) -> None:
    """Run sessions, or disturbed strikes, and print the tables."""
    console = Console(width=220, highlight=False)
    names, roads = options["objects"].split(","), tuple(options["roads"].split(","))
    numbers = range(options["first"], options["first"] + options["seeds"])
    workers, path = options["workers"], options["path"]
    if options["disturbed"]:
        listed = tuple(each for each in roads if each in {"tags", "print"})
        found: list[DisturbedRow] = []
        cases = list(product(names, numbers, (listed,), options["only"].split(",")))
        for rows in _run(run_disturbed, cases, "disturbed", workers):
            found += rows
            _keep(path, rows)
        order = list(DISTURBANCES)
        console.print(disturbed_table(sorted(found, key=lambda row: order.index(row.disturbance))))
        return
    for drawn in {"none": (False,), "drawn": (True,), "both": (False, True)}[options["errors"]]:
        title = "calibrations with errors drawn" if drawn else "as calibrated"
        sessions: list[SessionRow] = []
        struck: list[StrikeRow] = []
        cases = list(product(names, numbers, (drawn,), (roads,), (options["strikes"],)))
        for rows, ended in _run(run_session, cases, title, workers):
            struck += rows
            sessions += ended
            _keep(path, [*rows, *ended])
        struck.sort(key=lambda row: (names.index(row.name), row.seed))
        sessions.sort(key=lambda row: (names.index(row.name), row.seed))
        console.print(strike_table(struck, f"strikes, {title}"))
        console.print(session_table(sessions, f"sessions, {title}"))
        for reason in sorted({row.reason for row in struck if not row.usable}):
            many = [row.road for row in struck if row.reason == reason and not row.usable]
            console.print(f"{len(many)} {', '.join(sorted(set(many)))}: {reason}")


if __name__ == "__main__":
    main()
