"""Efficiency of two workers over one on Slurm, by dask-jobqueue as docs/how-to/cluster.md has it.

A private Slurm cluster of two nodes runs on this machine. Each turn times `analyze batch` on one worker and
on two, which are connected before. The ratio is divided by that of a spin loop in one process and in two,
measured before, between and after in the same turn, since two cores of one machine share clock, cache and
memory.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import click
import dask
from distributed.security import Security
from rich.console import Console

from tests.benchmarks.archive import batch, numbers, spin_gain
from tests.benchmarks.archive_files import make_archive
from tests.places import ROOT
from tests.slurm import missing, slurm

EFFICIENCY = 0.95
"""smallest median that is asked for"""
CONNECT_S = 120
console = Console(highlight=False)


def recipe() -> ModuleType:
    """The documented script as a module."""
    spec = importlib.util.spec_from_file_location("slurm_dask", ROOT / "docs/examples/cluster/slurm_dask.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    dask.config.set({"jobqueue.slurm.interface": "lo"})
    return module


@contextmanager
def workers(number: int, folder: Path) -> Iterator[str]:
    """Run workers as Slurm jobs; yields the scheduler's address once they are connected."""
    script, keys = recipe(), Security.temporary()
    os.environ.update(script.client_environment(keys))
    with contextlib.chdir(folder), script.slurm_cluster(keys) as cluster:
        cluster.scale(jobs=number)
        cluster.wait_for_workers(number, timeout=CONNECT_S)
        assert cluster.scheduler_address.startswith("tls://127.0.0.1:")
        yield cluster.scheduler_address


def timed_run(number: int, archive: Path, output: Path) -> float:
    """Time [s] of a run over the archive on so many workers."""
    output.parent.mkdir(exist_ok=True)
    with workers(number, output.parent) as address:
        taken, _ = batch(str(archive), output, "--scheduler", address)
    return taken


def turn(number: int, archive: Path, folder: Path) -> float:
    """Efficiency of two workers over one, divided by that of a spin loop."""
    gains = [spin_gain()]
    one = timed_run(1, archive, folder / f"turn-{number}" / "one")
    gains.append(spin_gain())
    two = timed_run(2, archive, folder / f"turn-{number}" / "two")
    spin = statistics.mean([*gains, spin_gain()])
    console.print(
        f"turn {number}: 1 worker {one:.1f} s, 2 workers {two:.1f} s: {one / two:.3f} times as fast, "
        f"a spin loop {spin:.3f}; efficiency {one / two / spin:.3f}",
        soft_wrap=True,
    )
    return one / two / spin


@click.command()
@click.option("--sessions", default=200, show_default=True, help="Recordings in the archive.")
@click.option("--turns", default=5, show_default=True)
@click.option("--keep", type=click.Path(path_type=Path), help="Folder of the archive, made if it is missing.")
def main(sessions: int, turns: int, keep: Path | None) -> None:
    """Make an archive, analyse it on one worker and on two, and print their efficiency.

    Raises:
        click.ClickException: Slurm is missing.
    """
    if missing():
        raise click.ClickException(missing())
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="percuss-cluster-") as name:
        folder = Path(name)
        archive = keep or folder / "archive"
        make_archive(archive, sessions, 0)
        with slurm(folder / "slurm") as cluster:
            os.environ.update(cluster.environment | {"PYTHONPATH": str(ROOT)})
            efficiencies = [turn(number, archive, folder) for number in range(1, turns + 1)]
        tables = [
            numbers(output) for output in sorted(folder.glob("turn-*/*/")) if output.name in {"one", "two"}
        ]
    same = all(table == tables[0] for table in tables)
    console.print(
        f"{sessions} recordings, {turns} turns, {time.monotonic() - start:.0f} s: efficiency of two workers "
        f"over one, over a spin loop's: median {statistics.median(efficiencies):.3f} (must {EFFICIENCY}), "
        f"{min(efficiencies):.3f} to {max(efficiencies):.3f}; results {'the same' if same else 'DIFFER'}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    main()
