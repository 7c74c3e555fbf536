"""Whole sessions on the virtual rig, scored: `make bench-sessions` (90 seconds per session).

A session is scored while the next one runs, at low priority. Prints, for each object, median and worst over
the seeds of the errors that `analyze score` reports, and the frames lost. Recordings are deleted once they
are scored, unless --keep names a folder.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

OBJECTS = ("carton", "spray", "juice", "salt")


@click.command()
@click.option("--objects", default=",".join(OBJECTS), help="Comma-separated.")
@click.option("--seeds", default="1,2,3,4,5", help="Comma-separated.")
@click.option("--keep", type=click.Path(path_type=Path), help="Keep the recordings in this folder.")
@click.option(
    "--json",
    "json_path",
    type=click.Path(path_type=Path),
    help="Also write every session's figures as JSON lines.",
)
def main(objects: str, seeds: str, keep: Path | None, json_path: Path | None) -> None:
    """Run the sessions, score them and print the table."""
    console = Console(width=150)
    rows = []
    with tempfile.TemporaryDirectory(prefix="percuss-bench-") as folder, ThreadPoolExecutor(1) as scorer:

        def scored(row: dict, path: Path) -> None:
            rows.append(row if "error" in row else row | score(path))
            if json_path is not None:
                with json_path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
            console.print(_line(rows[-1]), highlight=False)
            if keep is None:
                for part in path.parent.glob(f"{path.stem}*.mcap"):
                    part.unlink()

        for name in objects.split(","):
            for seed in seeds.split(","):
                path = (keep or Path(folder)) / f"{name}-{seed}.mcap"
                path.parent.mkdir(parents=True, exist_ok=True)
                scorer.submit(scored, session(name, int(seed), path), path)
    console.print(table(rows))


def session(name: str, seed: int, path: Path) -> dict:
    """Run one demo session; return its report or error, ready for JSON."""
    start = time.monotonic()
    demo = _run(
        "acquire", "demo", "--object", name, "--seed", str(seed), "-o", str(path), "--force", "--json"
    )
    row = {"object": name, "seed": seed, "seconds": time.monotonic() - start}
    if not demo.stdout.strip():
        return {**row, "error": demo.stderr.strip().splitlines()[-1]}
    return row | json.loads(demo.stdout)


def score(path: Path) -> dict:
    """Score of a recording or the error, ready for JSON."""
    found = _run("analyze", "score", str(path), "--json", nice=10)
    return {"error": found.stderr.strip().splitlines()[-1]} if found.returncode else json.loads(found.stdout)


def table(rows: list[dict]) -> Table:
    """Table of median and worst errors over the seeds, by object."""
    result = Table(title="median (worst) over seeds", title_justify="left")
    for heading in (
        "object",
        "sessions",
        "used/struck",
        "centre of mass [mm]",
        "phi [deg]",
        "I_edge [%]",
        "regions [% of M]",
        "naive best",
        "lost",
    ):
        result.add_column(heading)
    for name in dict.fromkeys(row["object"] for row in rows):
        mine = [row for row in rows if row["object"] == name]
        good = [row for row in mine if "error" not in row]
        if not good:
            result.add_row(name, f"0/{len(mine)}")
            continue
        com = [1e3 * row["centre_of_mass_error_m"] for row in good]
        phi = [abs(np.degrees(e)) for row in good for e in row["phi_error_rad"]]
        edge = [100 * abs(e) for row in good for e in row["i_edge_relative_error"] if e is not None]
        regions = [100 * row["region_mass_error_relative"] for row in good]
        naive = [100 * min(row["region_mass_error_relative_baselines"].values()) for row in good]
        used, struck = sum(len(row["strike_ids"]) for row in good), sum(row["strikes"] for row in good)
        result.add_row(
            name,
            f"{len(good)}/{len(mine)}",
            f"{used}/{struck}",
            _both(com, 2),
            _both(phi, 3),
            _both(edge, 2),
            _both(regions, 1),
            f"{statistics.median(naive):.1f}",
            str(sum(row["lost"] for row in good)),
        )
    return result


def _both(values: list[float], digits: int) -> str:
    return f"{statistics.median(values):.{digits}f} ({max(values):.{digits}f})"


def _line(row: dict) -> str:
    head = f"{row['object']:7} {row['seed']:3} {row['seconds']:5.0f} s"
    if "error" in row:
        return f"{head}  {row['error']}"
    return (
        f"{head}  {len(row['strike_ids'])}/{row['strikes']} strikes, {row['frames']} frames, {row['lost']} "
        f"lost, centre of mass {1e3 * row['centre_of_mass_error_m']:.2f} mm, regions "
        f"{100 * row['region_mass_error_relative']:.1f} %"
    )


def _run(*command: str, nice: int = 0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["nice", "-n", str(nice), sys.executable, "-m", *command], capture_output=True, text=True, check=False
    )


if __name__ == "__main__":
    main()
