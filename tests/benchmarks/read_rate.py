"""Error of a contact's time at several delays of the servo's adapter: ten strikes each on a simulated box."""

from __future__ import annotations

from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

from acquire.preflight.servo import contact_time_sd_s
from tests.acquire.striker.conftest import Heard
from tests.acquire.striker.plant import Plant

DELAYS_MS = (0.2, 1.0, 2.0, 3.0, 5.0, 8.0, 16.0)
STRIKES = 10
GAPS_M = (0.0003, -0.0005, 0.0006, 0.0, 0.0002)
"""distances of the box's face from the hanging tip"""
RUN_UP_READS = 40


def measure(delay_ms: float) -> tuple[float, list[float], list[float]]:
    """Strike with a delay of the adapter [ms].

    Returns:
        Readings per second; errors of the contacts' times [ms]; stated standard deviations [ms].
    """
    errors: list[float] = []
    stated: list[float] = []
    rates: list[float] = []
    with TemporaryDirectory() as folder, Plant(Path(folder), gap=GAPS_M[0]) as plant:
        plant.answers_come_late(1e-3 * delay_ms)
        heard = Heard()
        with heard.opened(plant.config()) as striker:
            striker.home()
            for number, gap in enumerate(islice(cycle(GAPS_M), STRIKES)):
                plant.restore(gap)
                striker.arm()
                striker.cock()
                heard.samples.clear()
                outcome = striker.strike(f"s{number}", 0.25 + 0.02 * number)
                times = [sample.host_before_ns for sample in heard.samples[:RUN_UP_READS]]
                rates.append(1e9 / float(np.median(np.diff(times))))
                if outcome.contact_time_ns is not None:
                    errors.append(1e-6 * (outcome.contact_time_ns - plant.touches[0].time_ns))
                    stated.append(1e-6 * outcome.contact_time_sd_ns)
    return float(np.median(rates)), errors, stated


def main() -> None:
    """Print a row per delay."""
    table = Table(
        "adapter [ms]", "readings/s", "contacts", "error, rms [ms]", "stated sd [ms]", "by the check [ms]"
    )
    for delay_ms in DELAYS_MS:
        rate, errors, stated = measure(delay_ms)
        rms = float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")
        told = 1e3 * contact_time_sd_s(rate)
        numbers = (f"{rms:.2f}", f"{np.mean(stated):.2f}" if stated else "", f"{told:.2f}")
        table.add_row(f"{delay_ms:g}", f"{rate:.0f}", str(len(errors)), *numbers)
    Console().print(table)


if __name__ == "__main__":
    main()
