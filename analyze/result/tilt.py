"""Tilt of the table against gravity in the Result document: measured, read from a level, or assumed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.merge import levelling_indices
from schemas.quantity import Quantity
from schemas.result import Result, TableTilt

if TYPE_CHECKING:
    from analyze.estimation.mass_properties import CentreOfMass
    from analyze.pipeline.evidence import Evidence

MEASURED_FRACTION = 0.5
"""fraction of its prior sd below which the sd of a table tilt counts as measured by the strikes"""
TILT_REMEDY = (
    "strike one edge again with the object turned by 180° (`analyze plan --gravity`), hang a plumb line in"
    " view (`analyze gravity`), or write what a level shows into the rig file's [level]"
)


def table_tilts(com: CentreOfMass, evidence: Evidence) -> list[TableTilt]:
    """Tilts of the table against gravity [rad] towards the world's x and y, one entry per levelling.

    A levelling is a set-up of the table whose recordings share one tilt. A tilt towards x (or y) is positive
    if the table is higher on the side of positive x (or y). It has a 95 % interval and a source: measured by
    the strikes, given by the reading of a level (the instrument), or the prior (assumed). Each entry lists
    the numbers of the levelling's recordings, from 1.

    Args:
        com: estimated centre of mass, which holds the estimated tilts; no entries if it holds none.
        evidence: recordings, whose manifests (metadata) hold the readings of a level.
    """
    levels = levelling_indices(evidence.recordings)
    found: list[TableTilt] = []
    for level, tilt in enumerate(com.tilts):
        parts = [
            Quantity(
                value=float(value),
                sd=float(sd),
                unit="rad",
                interval95=[float(value - SIGMAS_95 * sd), float(value + SIGMAS_95 * sd)],
                frame="W",
                observed=source != "prior",
                source=source,
            )
            for value, sd, source in zip(tilt.lean, tilt.sd, _sources(com, evidence, level), strict=True)
        ]
        numbers = [number for number, own in enumerate(levels, 1) if own == level]
        found.append(TableTilt(recordings=numbers, towards_x=parts[0], towards_y=parts[1]))
    return found


def assumed_tilt(com: CentreOfMass, evidence: Evidence) -> float:
    """Largest prior sd [rad] of the table tilts towards the world's x that are only assumed to be 0.

    Each levelling (set-up of the table) has one tilt. Those that the strikes measured, or that were read from
    a level, are left out; if none remains the result is 0.
    """
    assumed = [
        float(tilt.prior_sd[0])
        for level, tilt in enumerate(com.tilts)
        if _sources(com, evidence, level)[0] == "prior"
    ]
    return max(assumed, default=0.0)


def _sources(
    com: CentreOfMass, evidence: Evidence, level: int
) -> list[Literal["measured", "given", "prior"]]:
    """Sources of a levelling's table tilts towards the world's x and y: "measured", "given" or "prior".

    The first is that of the tilt towards x. A levelling is a set-up of the table. "measured": the strikes
    reduced the tilt's sd below `MEASURED_FRACTION` of the prior's; otherwise "given": the manifest holds the
    reading of a level (for y: one with an sd for y); otherwise "prior": the tilt is only assumed.

    Args:
        com: estimated centre of mass with the tilts of all levellings.
        evidence: recordings with their manifests (metadata).
        level: index of the levelling, from 0.
    """
    tilt = com.tilts[level]
    read = evidence.recordings[levelling_indices(evidence.recordings).index(level)].manifest.level
    given = [read is not None, read is not None and read.towards_y_sd_rad is not None]
    return [
        "measured" if sd < MEASURED_FRACTION * before else "given" if stated else "prior"
        for sd, before, stated in zip(tilt.sd, tilt.prior_sd, given, strict=True)
    ]


def tilt_lines(result: Result) -> list[str]:
    """Lines of text on the table's tilt towards the world's x [°], one per levelling; empty without tilts.

    A levelling is a set-up of the table; with several of them each line names its recordings.
    """
    tilts = result.table_tilt or []
    return [
        _line(
            tilt,
            f"table tilt, recording {', '.join(map(str, tilt.recordings))}"
            if len(tilts) > 1
            else "table tilt",
        )
        for tilt in tilts
    ]


def _line(tilt: TableTilt, name: str) -> str:
    """Line of text on a table's tilt towards the world's x [°], with its 95 % range and source.

    It begins with `name`.
    """
    origin = {
        "measured": "measured by the strikes",
        "given": "by the rig file's level reading",
        "prior": "not measured",
    }
    x = tilt.towards_x
    value, sd = (float(np.degrees(each)) if isinstance(each, float) else 0.0 for each in (x.value, x.sd))
    return f"{name}: {value:+.3f} ± {SIGMAS_95 * sd:.3f}° up towards +x (95 % interval), {origin[x.source]}"
