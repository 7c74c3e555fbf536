"""The energy loop in the virtual rig's physics: `make bench-energy` (ten minutes).

Sessions of nine planned strikes, from the hypothesis only, without images or hardware (see
tests/acquire/simulated_rig.py). The striker's stated mass and restitution are wrong by as much as the rig
file allows. The energy ratio E is the true energy of the object on its way up, over the energy needed to tip.
Prints for each object the number of strikes that an axis takes to its first tip, the range of E after that,
and every strike with a too large E.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from acquire.session import machine as s
from acquire.virtual.objects import load_object
from tests.acquire.simulated_rig import SimulatedRig, plan_for, wrong_striker_prior

OBJECTS = ("carton", "spray", "juice", "salt")
LOW, HIGH, NEVER = 1.02, 1.4, 3.0
MAX_STRIKES = 3


@dataclass(frozen=True)
class Struck:
    """Command, true and measured energy ratio, and verdict of one simulated strike."""

    axis_id: str
    command_m_s: float
    energy: float
    measured_energy: float | None
    verdict: str


@dataclass(frozen=True)
class Session:
    """Strikes of one simulated session, with the stated restitution and the one learned from them."""

    object: str
    seed: int
    strikes: tuple[Struck, ...]
    restitution_stated: float
    restitution_learned: float

    def first_tips(self) -> list[int]:
        """Number of the first strike that tips, for each axis; one more than were made if none does."""
        found: list[int] = []
        for axis in dict.fromkeys(each.axis_id for each in self.strikes):
            over = [each.energy > 1 for each in self.strikes if each.axis_id == axis]
            found.append(1 + (over.index(True) if True in over else len(over)))
        return found

    def afterwards(self) -> list[float]:
        """Energy ratio E of every strike on an axis that has tipped before."""
        tipped: set[str] = set()
        found: list[float] = []
        for each in self.strikes:
            if each.axis_id in tipped:
                found.append(each.energy)
            if each.energy > 1:
                tipped.add(each.axis_id)
        return found


def session(name: str, seed: int, strikes: int) -> Session:
    """Run one whole session."""
    rng = np.random.default_rng((seed, 0xE4E))
    striker = wrong_striker_prior(rng)
    rig = SimulatedRig(load_object(name, seed), rng)
    machine = s.SessionMachine(plan_for(name, strikes, striker))
    attempts = rig.run(machine)
    rows = (
        Struck(a.axis_id, a.command_m_s, a.energy, a.verdict.energy_ratio, a.verdict.code.value)
        for a in attempts
    )
    return Session(name, seed, tuple(rows), striker.restitution, machine.learner.striker.restitution)


@click.command()
@click.option("--objects", default=",".join(OBJECTS), show_default=True)
@click.option("--seeds", default=20, show_default=True, help="Number of seeds, from 1.")
@click.option("--strikes", default=9, show_default=True, help="Number of planned strikes.")
@click.option(
    "--json", "json_path", type=click.Path(path_type=Path), help="Also write every session as a JSON line."
)
def main(objects: str, seeds: int, strikes: int, json_path: Path | None) -> None:
    """Run the sessions and print the table."""
    console = Console(width=150)
    wanted = [(name, seed) for name in objects.split(",") for seed in range(1, seeds + 1)]
    sessions: list[Session] = []
    for name, seed in track(wanted, description="sessions", console=Console(stderr=True), transient=True):
        sessions.append(session(name, seed, strikes))
        if json_path is not None:
            with json_path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(sessions[-1])) + "\n")
    console.print(table(sessions))
    for each in sessions:
        for struck in each.strikes:
            if struck.energy > HIGH:
                console.print(f"{each.object} {each.seed}: {struck}", highlight=False)


def table(sessions: list[Session]) -> Table:
    """Table with one row per object, and one for all."""
    result = Table(title=f"the energy loop: {len(sessions)} sessions", title_justify="left")
    for heading in (
        "object", "axes", f"first tip within {MAX_STRIKES}", "mean", "largest",
        "strikes after it", f"E in {LOW}-{HIGH}", "median E", "E of all tips: 5-95 %", "largest E",
        "strikes per session",
    ):  # fmt: skip
        result.add_column(heading, justify="left" if heading == "object" else "right")
    for name in dict.fromkeys(each.object for each in sessions):
        result.add_row(name, *_cells([each for each in sessions if each.object == name]))
    result.add_section()
    result.add_row("all", *_cells(sessions))
    return result


def _cells(sessions: list[Session]) -> list[str]:
    first = np.array([many for each in sessions for many in each.first_tips()])
    after = np.array([energy for each in sessions for energy in each.afterwards()])
    energies = np.array([struck.energy for each in sessions for struck in each.strikes])
    inside = (after >= LOW) & (after <= HIGH)
    low, high = np.quantile(energies[energies > 1], [0.05, 0.95])
    return [
        str(len(first)),
        f"{np.count_nonzero(first <= MAX_STRIKES)}/{len(first)}",
        f"{first.mean():.2f}",
        str(first.max()),
        str(len(after)),
        f"{100 * inside.mean():.1f} %",
        f"{np.median(after):.2f}",
        f"{low:.2f}-{high:.2f}",
        f"{energies.max():.2f}",
        f"{np.mean([len(each.strikes) for each in sessions]):.1f}",
    ]


if __name__ == "__main__":
    main()
