"""Seeded attack on everything that is built: `make attack` (three minutes; ATTACK="--minutes 60").

Damaged files of every kind go through every command that reads them, each in a process with limits of time
and memory. Meanwhile a daemon is sent rubbish, and processes of sessions on the virtual rig are killed. Each
failure is printed with its seed; the file that led to it is kept.

Failures are: an exception, a time over 20 s of the processor, memory over 1 GB beside the program's own, a
result that changed without a word, damage that `acquire recover` hides, a changed source, files left behind
by a command that failed, a control character that is passed on, and more than one line of complaint.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from queue import Empty

import click
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.attack.findings import Finding, Tally
from tests.attack.workers import attack_by_files, attack_by_others

SHOWN = 30
"""number of failures that are printed in full"""


@click.command()
@click.option("--minutes", type=click.FloatRange(min=0.1), default=3.0, show_default=True, help="Time.")
@click.option(
    "--seed", type=int, default=1, show_default=True, help="Seed of all damage, requests and kills."
)
@click.option("--keep", type=click.Path(path_type=Path), help="Folder for the files that led to failures.")
@click.option(
    "--only", type=click.Choice(["files", "others"]), help="Only files, or only requests and kills."
)
def main(minutes: float, seed: int, keep: Path | None, only: str | None) -> None:
    """Attack with damaged files, requests and kills; exit with 1 if anything failed."""
    folder = keep or Path(tempfile.mkdtemp(prefix="percuss-attack-"))
    context = multiprocessing.get_context("spawn")
    tallies = context.Queue()
    start = time.monotonic()
    until_s = start + 60.0 * minutes
    first, second = folder / "a", folder / "b"
    for each in (first, second):
        each.mkdir(parents=True, exist_ok=True)
    workers = []
    if only != "others":
        workers.append(context.Process(target=attack_by_files, args=(first, 2 * seed, until_s, tallies)))
    if only != "files":
        arguments = (second, 2 * seed, minutes, until_s, tallies)
        workers.append(context.Process(target=attack_by_others, args=arguments))
    for worker in workers:
        worker.start()
    kinds: dict[str, Tally] = {}
    with Progress() as progress:
        task = progress.add_task("attack", total=60.0 * minutes)
        while any(worker.is_alive() for worker in workers) or not tallies.empty():
            try:
                tally = tallies.get(timeout=0.5)
            except Empty:
                continue
            kinds[tally.kind] = kinds.get(tally.kind, Tally(tally.kind)) + tally
            failures = sum(len(each.findings) for each in kinds.values())
            tries = sum(each.tries for each in kinds.values())
            text = f"{tries} tries, {failures} failures"
            progress.update(task, completed=time.monotonic() - start, description=text)
    crashed = [worker.name for worker in workers if worker.exitcode]
    _print(list(kinds.values()), folder)
    if crashed:
        sys.exit(f"the attack itself broke: {', '.join(crashed)}")
    sys.exit(int(any(each.findings for each in kinds.values())))


def _print(kinds: list[Tally], folder: Path) -> None:
    console = Console()
    table = Table("attack", "tries", "failures", "longest", "memory", title="tries and failures")
    for each in sorted(kinds, key=lambda tally: tally.kind):
        memory = f"{each.memory_bytes / 1e6:.0f} MB"
        table.add_row(each.kind, str(each.tries), str(len(each.findings)), f"{each.longest_s:.1f} s", memory)
    console.print(table)
    failures = [finding for each in kinds for finding in each.findings]
    counts = Counter(finding.kind for finding in failures)
    tries = sum(each.tries for each in kinds)
    largest = max((each.memory_bytes for each in kinds), default=0)
    console.print(f"{tries} tries, {len(failures)} failures, at most {largest / 1e6:.0f} MB")
    for kind, number in counts.most_common():
        console.print(f"  {kind}: {number}")
    for finding in _different(failures)[:SHOWN]:
        console.print(f"{finding.kind}: {finding.what}: {finding.text}", markup=False, highlight=False)
    if failures:
        console.print(f"files that led to failures: {folder}/*/findings")


def _different(failures: list[Finding]) -> list[Finding]:
    """The failures, one of each kind and command."""
    return list({(each.kind, each.what): each for each in failures}.values())


if __name__ == "__main__":
    main()
