"""Dynamixel striker compared with the virtual world's ground truth: `make bench-striker`.

Swings at several speeds on objects placed with a hand's accuracy, without a camera. Prints the errors of
contact time, tip speed and impulse, their stated sd, and the CPU load of the control loop. Three lines leave
out swings that this computer disturbed: those in which the physics fell behind, so that the virtual servo
reported outdated states; of the rest, those not sampled at 1 kHz over the whole swing; and those with a gap
between reads around the contact, from which its time is determined.
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
from acquire.striker.dynamixel import DynamixelStriker
from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.station import ARM_INERTIA_KG_M2, ARM_LENGTH_M
from acquire.virtual.truth_file import read_truth_file
from schemas.proto import percuss_pb2 as pb
from schemas.rig import StrikerConfig
from tests.acquire.virtual.world_link import WorldLink

STAND_SD_M = 0.0003
IMPACT_HEIGHT = 0.75
"""height of the strike, as a fraction of the object's height"""
AT_1_KHZ = 900.0
"""reads per second, of 1000 requested, above which a swing counts as sampled at 1 kHz"""
WINDOW_S = (-0.02, 0.01)
"""time around the contact, from whose reads the contact time is determined [s]"""
MAX_GAP_S = 0.002
"""longest gap between two reads [s]: 1 kHz with its deliberate spread of 0.6 ms gives 1.6 ms plus one read"""


@dataclass(frozen=True)
class Swing:
    """One strike compared with ground truth."""

    speed: float
    time_error_ms: float
    time_sd_ms: float
    speed_error: float
    """relative error of the tip speed"""
    impulse_ratio: float
    """stated over true impulse; NaN if not measured"""
    impulse_sd: float
    """relative stated sd of the impulse"""
    contacts: int
    true_contacts: int
    reads_hz: float
    gap_s: float
    """longest time between two reads around the contact [s]"""
    cpu: float
    """load of one core while the arm swings"""
    stale_ms: float
    """delay of the states that the virtual servo reported, because the physics fell behind [ms]"""


class Rig:
    """Virtual world without camera, and a striker in it."""

    def __init__(self, name: str, seed: int, folder: Path) -> None:
        self.thing = load_object(name, seed)
        command = [
            sys.executable,
            "-m",
            "acquire.virtual.world_process",
            "--object",
            name,
            "--seed",
            str(seed),
            "--dir",
            str(folder),
        ]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        self._process.stdout.readline()
        self.link = WorldLink(folder / "world.sock")
        self.samples: list[pb.StrikerSample] = []
        config = StrikerConfig.model_validate(
            {
                "port": str(folder / "ttyDXL"),
                "effective_mass_kg": ARM_INERTIA_KG_M2 / ARM_LENGTH_M**2,
                "effective_mass_sd_kg": 0.005,
            }
        )
        self.striker = DynamixelStriker(
            config, self.samples.append, lambda _event: None, lambda _clock: None, SystemClock()
        )
        self.striker.open()
        self.striker.home()

    def close(self) -> None:
        """Stop striker and world."""
        self.striker.close()
        self.link.quit()
        self.link.close()
        self._process.wait(10)

    def truth(self) -> list[Any]:
        """Ground truth that the world has logged so far."""
        return list(read_truth_file(Path(self.link.truth())))

    def place(self, rng: np.random.Generator) -> None:
        """Place the object upright, with the tip just in front of its face."""
        low, high = self.thing.hull_vertices.min(axis=0), self.thing.hull_vertices.max(axis=0)
        height = IMPACT_HEIGHT * (high[2] - low[2])
        x = _face(self.thing, low[2] + height) - abs(rng.normal(0.0, STAND_SD_M))
        self.link.place(np.eye(3), [0.0, 0.0, -low[2]], [x, 0.0, height])
        time.sleep(0.5)


def _face(thing: VirtualObject, z: float) -> float:
    """Coordinate x [m, in O] at which the line y = 0 at height z enters the object along +x."""
    planes = ConvexHull(thing.hull_vertices).equations
    facing = planes[planes[:, 0] < -1e-9]
    return float(np.max(-(facing[:, 2] * z + facing[:, 3]) / facing[:, 0]))


def strike(rig: Rig, speed: float, rng: np.random.Generator) -> Swing:
    """Make one strike and compare it with ground truth."""
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
        return Swing(
            speed,
            np.nan,
            np.nan,
            np.nan,
            np.nan,
            np.nan,
            outcome.contacts,
            len(contacts),
            np.nan,
            np.nan,
            cpu,
            stale_ms,
        )
    first = contacts[0]
    before = [
        m
        for m in truth
        if isinstance(m, pb.TruthPose) and outcome.released_ns < m.world_time_ns <= first.world_time_ns
    ]
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
        _longest_gap(rig.samples, first.world_time_ns),
        cpu,
        stale_ms,
    )


def _longest_gap(samples: list[pb.StrikerSample], touch_ns: int) -> float:
    """Longest time [s] between the middles of consecutive reads, or to either end of WINDOW_S."""
    begin, end = WINDOW_S
    taken = np.array([0.5 * (s.host_before_ns + s.host_after_ns) - touch_ns for s in samples]) * 1e-9
    return float(np.max(np.diff([begin, *taken[(taken > begin) & (taken < end)], end])))


@click.command()
@click.option("--objects", default="carton,juice", help="Comma-separated.")
@click.option("--speeds", default="0.25,0.36,0.5", help="Comma-separated, m/s.")
@click.option("--swings", default=12, help="Swings per object and speed.")
@click.option("--seed", default=1)
def main(objects: str, speeds: str, swings: int, seed: int) -> None:
    """Make the strikes and print the table."""
    rng = np.random.default_rng(seed)
    result = Table(title="striker compared with ground truth", title_justify="left")
    for heading in (
        "object", "m/s", "time error [ms]", "rms", "worst", "stated sd", "error / sd, rms",
        "tip speed error [%]", "impulse / truth",
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
        result.add_row("physics on time", "", *_cells(in_time))
    if sampled := [row for row in in_time if row.reads_hz >= AT_1_KHZ]:
        result.add_row("at 1 kHz", "", *_cells(sampled))
    if whole := [row for row in in_time if row.gap_s <= MAX_GAP_S]:
        result.add_row("no gap at contact", "", *_cells(whole))
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
        (
            f"{100 * np.nanmean([row.speed_error for row in rows]):+.2f} ± "
            f"{100 * np.nanstd([row.speed_error for row in rows]):.2f}"
        ),
        f"{np.nanmean(ratio):.2f} ± {np.nanstd(ratio):.2f}",
        f"{np.nanmean([row.impulse_sd for row in rows]):.2f}",
        f"{sum(row.contacts == 1 == row.true_contacts for row in rows)}/{len(rows)}",
        f"{np.nanmedian([row.reads_hz for row in rows]):.0f}",
        f"{100 * np.mean([row.cpu for row in rows]):.0f} %",
    ]


if __name__ == "__main__":
    main()
