"""The Dynamixel striker against the virtual world's truth: `make bench-striker` (about three minutes).

Swings on objects at speeds, each placed with a hand's accuracy, without a camera. Prints how far contact time,
tip speed and impulse are from the truth, what the striker itself stated, and what its loop costs. Three lines leave out what this computer
spoilt: swings in which it had no time for the physics, so that the virtual servo told of the past; of the rest, those that it did not let
sample at 1 kHz over the whole swing; and those in which it left a hole between reads around the touch, which alone tell of its time.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import ConvexHull

from acquire.clock.clock import SystemClock
from acquire.config import StrikerConfig
from acquire.striker.dynamixel import DynamixelStriker
from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.station import ARM_INERTIA_KG_M2, ARM_LENGTH_M
from acquire.virtual.truth_file import read_truth_file
from schemas.proto import percuss_pb2 as pb

STAND_SD_M = 0.0003
IMPACT_HEIGHT = 0.75
"""of the object's"""
AT_1_KHZ = 900.0
"""reads per second, of 1000 asked for, from which on a swing counts as sampled at 1 kHz"""
WINDOW_S = (-0.02, 0.01)
"""around the touch: the reads that its time is found from"""
HOLE_S = 0.002
"""between two reads: 1 kHz, spread over 0.6 ms on purpose, leaves 1.6 ms and the read's own length"""


@dataclass(frozen=True)
class Swing:
    """One strike beside the truth."""

    speed: float
    time_error_ms: float
    time_sd_ms: float
    speed_error: float
    """relative"""
    impulse_ratio: float
    """stated over true; NaN: not measured"""
    impulse_sd: float
    """relative"""
    contacts: int
    true_contacts: int
    reads_hz: float
    hole_s: float
    """the longest time between two reads around the touch"""
    cpu: float
    """of one core, while the arm swings"""
    stale_ms: float
    """by how much the virtual servo told older news than a servo does, because this computer had no time for the physics"""


class Rig:
    """A virtual world without camera, and a striker on it."""

    def __init__(self, name: str, seed: int, folder: Path) -> None:
        self.thing = load_object(name, seed)
        command = [sys.executable, "-m", "acquire.virtual.world_process", "--object", name, "--seed", str(seed), "--dir", str(folder)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        self._process.stdout.readline()
        self.link = OperatorLink(folder / "world.sock")
        self.samples: list[pb.StrikerSample] = []
        config = StrikerConfig.model_validate(
            {"port": str(folder / "ttyDXL"), "effective_mass_kg": ARM_INERTIA_KG_M2 / ARM_LENGTH_M**2, "effective_mass_sd_kg": 0.005}
        )
        self.striker = DynamixelStriker(config, self.samples.append, lambda _event: None, lambda _clock: None, SystemClock())
        self.striker.open()
        self.striker.home()

    def close(self) -> None:
        """Everything down."""
        self.striker.close()
        self.link.quit()
        self.link.close()
        self._process.wait(10)

    def truth(self) -> list[Any]:
        """The world's log up to now."""
        return list(read_truth_file(Path(self.link.truth())))

    def place(self, rng: np.random.Generator) -> None:
        """The object upright, the tip a hair before its face."""
        low, high = self.thing.hull_vertices.min(axis=0), self.thing.hull_vertices.max(axis=0)
        height = IMPACT_HEIGHT * (high[2] - low[2])
        x = _face(self.thing, low[2] + height) - abs(rng.normal(0.0, STAND_SD_M))
        self.link.place(np.eye(3), [0.0, 0.0, -low[2]], [x, 0.0, height])
        time.sleep(0.5)


def _face(thing: VirtualObject, z: float) -> float:
    """Where the line y = 0 at height z enters the object along +x [m, in O]."""
    planes = ConvexHull(thing.hull_vertices).equations
    facing = planes[planes[:, 0] < -1e-9]
    return float(np.max(-(facing[:, 2] * z + facing[:, 3]) / facing[:, 0]))


def strike(rig: Rig, speed: float, rng: np.random.Generator) -> Swing:
    """One strike, compared."""
    rig.place(rng)
    rig.striker.arm()
    rig.striker.cock()
    rig.samples.clear()
    rig.link.state()
    begin, cpu = time.monotonic(), time.thread_time()
    outcome = rig.striker.strike("bench", speed)
    cpu = (time.thread_time() - cpu) / (time.monotonic() - begin)
    stale_ms = rig.link.state()["stale_ns"] * 1e-6
    time.sleep(0.3)
    truth = rig.truth()
    contacts = [m for m in truth if isinstance(m, pb.TruthContact) and m.world_time_ns > outcome.released_ns]
    if not contacts or outcome.contact_time_ns is None:
        return Swing(speed, np.nan, np.nan, np.nan, np.nan, np.nan, outcome.contacts, len(contacts), np.nan, np.nan, cpu, stale_ms)
    first = contacts[0]
    before = [m for m in truth if isinstance(m, pb.TruthPose) and outcome.released_ns < m.world_time_ns <= first.world_time_ns]
    tip_speed = before[-1].striker_velocity_rad_s * ARM_LENGTH_M if before else speed
    swing = [s for s in rig.samples if outcome.released_ns < s.host_before_ns < first.world_time_ns]
    impulse = outcome.impulse_n_s
    return Swing(
        speed,
        (outcome.contact_time_ns - first.world_time_ns) * 1e-6,
        outcome.contact_time_sd_ns * 1e-6,
        outcome.tip_speed_m_s / tip_speed - 1,
        impulse / first.impulse_n_s if impulse else np.nan,
        outcome.impulse_sd_n_s / impulse if impulse else np.nan,
        outcome.contacts,
        len(contacts),
        len(swing) / ((first.world_time_ns - outcome.released_ns) * 1e-9),
        _longest_hole(rig.samples, first.world_time_ns),
        cpu,
        stale_ms,
    )


def _longest_hole(samples: list[pb.StrikerSample], touch_ns: int) -> float:
    """Between the middles of consecutive reads, and to either end of WINDOW_S [s]."""
    begin, end = WINDOW_S
    taken = np.array([0.5 * (s.host_before_ns + s.host_after_ns) - touch_ns for s in samples]) * 1e-9
    return float(np.max(np.diff([begin, *taken[(taken > begin) & (taken < end)], end])))


@click.command()
@click.option("--objects", default="carton,juice", help="Comma-separated.")
@click.option("--speeds", default="0.25,0.36,0.5", help="Comma-separated, m/s.")
@click.option("--swings", default=12, help="Per object and speed.")
@click.option("--seed", default=1)
def main(objects: str, speeds: str, swings: int, seed: int) -> None:
    """Strike, compare, tabulate."""
    rng = np.random.default_rng(seed)
    result = Table(title="striker against the world's truth", title_justify="left")
    for heading in (
        "object", "m/s", "time error [ms]", "rms", "worst", "stated sd", "error / sd, rms", "tip speed error [%]", "impulse / truth",
        "stated sd", "single", "reads/s", "CPU",
    ):  # fmt: skip
        result.add_column(heading)
    everything: list[Swing] = []
    for name in objects.split(","):
        with tempfile.TemporaryDirectory(prefix="percuss-bench-") as folder:
            rig = Rig(name, seed, Path(folder))
            try:
                for speed in map(float, speeds.split(",")):
                    rows = [strike(rig, speed, rng) for _ in range(swings)]
                    everything += rows
                    result.add_row(name, f"{speed:.2f}", *_cells(rows))
            finally:
                rig.close()
    result.add_section()
    result.add_row("all", "", *_cells(everything))
    if in_time := [row for row in everything if not row.stale_ms]:
        result.add_row("world kept up", "", *_cells(in_time))
    if sampled := [row for row in in_time if row.reads_hz >= AT_1_KHZ]:
        result.add_row("at 1 kHz", "", *_cells(sampled))
    if whole := [row for row in in_time if row.hole_s <= HOLE_S]:
        result.add_row("no hole at touch", "", *_cells(whole))
    Console(width=150).print(result)


def _cells(rows: list[Swing]) -> list[str]:
    error = np.array([row.time_error_ms for row in rows])
    ratio = np.array([row.impulse_ratio for row in rows])
    return [
        f"{np.nanmean(error):+.2f} ± {np.nanstd(error):.2f}",
        f"{np.sqrt(np.nanmean(error**2)):.2f}",
        f"{np.nanmax(np.abs(error)):.2f}",
        f"{np.nanmean([row.time_sd_ms for row in rows]):.2f}",
        f"{np.sqrt(np.nanmean([(row.time_error_ms / row.time_sd_ms) ** 2 for row in rows])):.1f}",
        f"{100 * np.nanmean([row.speed_error for row in rows]):+.2f} ± {100 * np.nanstd([row.speed_error for row in rows]):.2f}",
        f"{np.nanmean(ratio):.2f} ± {np.nanstd(ratio):.2f}",
        f"{np.nanmean([row.impulse_sd for row in rows]):.2f}",
        f"{sum(row.contacts == 1 == row.true_contacts for row in rows)}/{len(rows)}",
        f"{np.nanmedian([row.reads_hz for row in rows]):.0f}",
        f"{100 * np.mean([row.cpu for row in rows]):.0f} %",
    ]


if __name__ == "__main__":
    main()
