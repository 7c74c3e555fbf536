"""Rows of results of weekly sessions of two objects on one rig, with errors of known size.

The values are drawn, not measured: what each session states, what varies between sessions, and what every
session of an object shares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from analyze.batch.ledger import Entry, Ledger
from analyze.batch.result_rows import SCHEMA, write_row

START = datetime(2025, 9, 1, 8, tzinfo=UTC)
OBJECTS = ("tea [box]", "salt")
OWN_SD_M, SHARED_SD_M, BETWEEN_SD_M = 8e-5, 2e-4, 1.5e-4
"""sds [m] of c: new in each session and stated, shared by all sessions and stated, and between sessions"""
TRUE_COM_M = np.array([0.012, -0.008, 0.071])
TILT_SD, RANGE_SD, SPEED_SD, RATE_SD = 2e-4, 6e-4, 4e-3, 2e-6
Change = Callable[[dict[str, Any], int], Mapping[str, Any]]
"""function of a row and its week, which gives the columns to change"""


def drawn_rows(weeks: int, change: Change | None = None, seed: int = 5) -> list[dict[str, Any]]:
    """Rows of a session of each object per week.

    Args:
        weeks: number of weeks.
        change: what is different in a row; None for a rig in control.
        seed: seed of the random errors.
    """
    rng = np.random.default_rng(seed)
    shared = SHARED_SD_M * rng.normal(size=(len(OBJECTS), 3))
    rows: list[dict[str, Any]] = []
    for week in range(weeks):
        for number, name in enumerate(OBJECTS):
            row = _row(rng, name, number, week, TRUE_COM_M + shared[number])
            rows.append(row | ({} if change is None else dict(change(row, week))))
    return rows


def drawn_table(weeks: int, change: Change | None = None) -> pa.Table:
    """Rows of `drawn_rows` as a table of results."""
    return pa.Table.from_pylist(drawn_rows(weeks, change), schema=SCHEMA)


def write_sessions(output: Path, weeks: int, change: Change | None = None) -> None:
    """Write the rows of `drawn_rows`, and their ledger, into a new folder of results."""
    (output / "recordings").mkdir(parents=True)
    (output / "failures").mkdir()
    with Ledger(output, (1, 1), 1) as ledger:
        for row in drawn_rows(weeks, change):
            write_row(row, output / "recordings" / f"{row['key']}.parquet")
            ledger.add([Entry(row["url"], row["key"], "", "", row["key"], "", "", [])])


def ageing_rig(row: dict[str, Any], week: int) -> dict[str, Any]:
    """A table that tilts, a striker that slows, a new camera, one odd session, one without a start time."""
    new: dict[str, Any] = {}
    if week >= 12:
        new["tilt_x_rad"] = row["tilt_x_rad"] + TILT_SD * 0.23 * (week - 11)
    if week >= 25:
        new["striker_speed_ratio"] = row["striker_speed_ratio"] - 0.03
    if week >= 30:
        new["camera_serial"] = "CAM-2"
    if week == 22 and row["object"] == "salt":
        new["com_z_m"] = row["com_z_m"] + 0.003
    if week == 5 and row["object"] == "salt":
        new["created"] = None
    return new


def _row(rng: np.random.Generator, name: str, number: int, week: int, com: np.ndarray) -> dict[str, Any]:
    created = START + timedelta(days=7 * week, hours=2 * number)
    scatter = np.hypot(OWN_SD_M, BETWEEN_SD_M)
    inertia = np.array([3.1e-4, 2.4e-4, 1.2e-4])
    key = f"{number}-{week:03d}"
    return {
        "status": "ok",
        "key": key,
        "url": f"/runs/{key}.mcap",
        "recording_id": key,
        "object": name,
        "object_sha256": "ab"[number] * 64,
        "created": created.isoformat(),
        "analysed_at": "2026-11-30T08:00:00+00:00",
        "rig": "bench-a",
        "camera_serial": "CAM-1",
        "striker": "dynamixel, XL430-W250, id 1, arm 120 mm",
        "com_observed": True,
        "strikes_recorded": 9,
        "strikes_used": 8,
        "time_source": "device_mapped",
        **dict(zip(("com_x_m", "com_y_m", "com_z_m"), com + rng.normal(0, scatter, 3), strict=True)),
        **{f"com_sd_{axis}_m": float(np.hypot(OWN_SD_M, SHARED_SD_M)) for axis in "xyz"},
        **{f"com_shared_sd_{axis}_m": SHARED_SD_M for axis in "xyz"},
        "com_own_covariance_m2": (OWN_SD_M**2 * np.eye(3)).ravel().tolist(),
        **{
            f"{entry}_kg_m2": value * (1 + rng.normal(0, 0.006))
            for entry, value in zip(("ixx", "iyy", "izz"), inertia, strict=True)
        },
        **{
            f"{entry}_sd_kg_m2": value * 0.008
            for entry, value in zip(("ixx", "iyy", "izz"), inertia, strict=True)
        },
        **{f"{entry}_measured": True for entry in ("ixx", "iyy", "izz")},
        "range_ratio": 1.0006 + rng.normal(0, RANGE_SD),
        "range_ratio_sd": 5e-4,
        "rest_turn_rad": 1e-4 + rng.normal(0, 5e-5),
        "rest_turn_sd_rad": 3e-5,
        "tilt_x_rad": 1.2e-3 + rng.normal(0, TILT_SD),
        "tilt_x_sd_rad": TILT_SD,
        "striker_speed_ratio": 0.997 + rng.normal(0, SPEED_SD),
        "striker_speed_ratio_sd": SPEED_SD,
        "frame_rate_ratio": 1.00007 + rng.normal(0, RATE_SD),
        "frame_rate_ratio_sd": RATE_SD,
    }
