"""Tilt of the table against gravity in the Result document: measured, read from a level, or assumed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.merge import levelling_indices
from schemas.quantity import Quantity
from schemas.result import Result, TableTilt

if TYPE_CHECKING:
    from analyze.pipeline.evidence import Evidence
    from analyze.types import CentreOfMass

MEASURED_FRACTION = 0.5
"""fraction of the prior's sd below which a tilt counts as measured by the strikes"""
TILT_REMEDY = (
    "strike one edge again with the object turned by 180° (`analyze plan --gravity`), hang a plumb line in"
    " view (`analyze gravity`), or write what a level shows into the rig file's [level]"
)


def table_tilts(com: CentreOfMass, evidence: Evidence) -> list[TableTilt]:
    """Tilts of the table against gravity [rad] towards the world's x and y, one pair per levelling.

    A levelling is a set-up of the table with one unknown tilt. Each value has a 95 % interval and its source:
    measured by the strikes, given by a level's reading, or the prior; each pair has the numbers of its
    recordings, from 1.
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
    """Largest sd [rad] of a table tilt towards x of the world frame W that is only assumed.

    0 if the tilts of all levellings were measured by strikes or read from a level.
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
    """Sources of the tilts of one levelling towards x and y, in this order.

    Measured if the strikes reduced the sd below `MEASURED_FRACTION` of the prior's, given if a level's
    reading states it, prior otherwise.
    """
    tilt = com.tilts[level]
    read = evidence.recordings[levelling_indices(evidence.recordings).index(level)].manifest.level
    given = [read is not None, read is not None and read.towards_y_sd_rad is not None]
    return [
        "measured" if sd < MEASURED_FRACTION * before else "given" if stated else "prior"
        for sd, before, stated in zip(tilt.sd, tilt.prior_sd, given, strict=True)
    ]


def tilt_lines(result: Result) -> list[str]:
    """Lines of text on the tilt of the table [°], one per levelling; empty if the result has no tilt.

    With several levellings each line names its recordings.
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
    """Line on a tilt towards the world's x with its 95 % range [°] and source; it begins with `name`."""
    origin = {
        "measured": "measured by the strikes",
        "given": "by the rig file's level reading",
        "prior": "not measured",
    }
    x = tilt.towards_x
    value, sd = (float(np.degrees(each)) if isinstance(each, float) else 0.0 for each in (x.value, x.sd))
    return f"{name}: {value:+.3f} ± {SIGMAS_95 * sd:.3f}° up towards +x (95 % interval), {origin[x.source]}"
