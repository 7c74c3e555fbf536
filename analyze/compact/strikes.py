"""Strikes of a recording by its recoded images beside those by the original ones."""

from __future__ import annotations

import math
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from analyze.errors import CompactError
from analyze.pipeline.read_evidence import read_evidence, read_head
from schemas.compaction import StrikeChange
from schemas.strike_result import USABLE_VERDICTS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from analyze.progress import Progress
    from analyze.types import MotionFit, TipMotion

MAX_CHANGE_SDS = 0.5
"""largest change of phi and k over their standard deviations"""
MAX_SD_CHANGE = 0.1
"""largest relative change of these standard deviations"""
AIMED_PHI, AIMED_K = math.radians(0.01), 5e-4
"""change of phi [rad] and relative change of k at which no other coding is tried"""

_REMEDY = "it stays as it is; compact it without --near-lossless and --crop"


def strike_motions(path: Path, progress: Progress) -> dict[str, TipMotion]:
    """Motion of each strike of a recording, by its id.

    Raises:
        AnalyzeError: the recording cannot be read, or no strike can.
    """
    return {each.strike_id: each for each in read_evidence(read_head(path), progress=progress).motions}


def judged_motions(path: Path, progress: Progress) -> dict[str, TipMotion]:
    """Motion of each strike of a recording, by its id, by which a loss can be judged.

    Raises:
        CompactError: the recording has tosses, which are not compared, or no good strike.
        AnalyzeError: the recording cannot be read, or no strike can.
    """
    if read_head(path).toss_ids:
        raise CompactError(f"{path}: has tosses, on which a loss is not judged: {_REMEDY}")
    found = strike_motions(path, progress)
    if not any(each.verdict in USABLE_VERDICTS and each.fit is not None for each in found.values()):
        raise CompactError(f"{path}: has no good strike by which a loss could be judged: {_REMEDY}")
    return found


@contextmanager
def under_final_names(files: Mapping[Path, Path]) -> Iterator[Path]:
    """A folder in which unfinished files stand under their final names; yields the first one's path.

    Args:
        files: final path -> path of the unfinished file.
    """
    with TemporaryDirectory(prefix="percuss-compact-") as folder:
        for final, part in files.items():
            (Path(folder) / final.name).symlink_to(part.resolve())
        yield Path(folder) / next(iter(files)).name


def compare_motions(
    original: dict[str, TipMotion], recoded: dict[str, TipMotion], path: Path
) -> list[StrikeChange]:
    """Difference of each usable strike's phi and k, and of their standard deviations.

    Raises:
        CompactError: a strike has another verdict, changed by more than `MAX_CHANGE_SDS`, or its standard
            deviations by more than `MAX_SD_CHANGE`.
    """
    found: list[StrikeChange] = []
    for name, one in original.items():
        other = recoded.get(name)
        if other is None or other.verdict is not one.verdict:
            now = "not read" if other is None else other.verdict.value
            raise CompactError(f"{path}: strike {name} is {one.verdict.value}, and would be {now}: {_REMEDY}")
        if one.verdict not in USABLE_VERDICTS or one.fit is None:
            continue
        if other.fit is None or (one.fit.k is None) != (other.fit.k is None):
            raise CompactError(f"{path}: strike {name} would be fitted otherwise: {_REMEDY}")
        found.append(_change(name, one.fit, other.fit, path))
    return found


def _change(name: str, one: MotionFit, other: MotionFit, path: Path) -> StrikeChange:
    """Difference of a strike's fit by recoded images from that by the original ones.

    Raises:
        CompactError: it is too large.
    """
    changes = [other.phi - one.phi]
    if one.k is not None and other.k is not None:
        changes.append(other.k - one.k)
    sds, other_sds = (
        [math.sqrt(fit.covariance[number, number]) for number in range(len(changes))] for fit in (one, other)
    )
    largest = max(abs(change) / sd for change, sd in zip(changes, sds, strict=True))
    if not largest <= MAX_CHANGE_SDS:
        raise CompactError(
            f"{path}: strike {name} would change by {largest:.1f} standard deviations: {_REMEDY}"
        )
    ratios = [new / old - 1.0 for new, old in zip(other_sds, sds, strict=True)]
    if not max(abs(ratio) for ratio in ratios) <= MAX_SD_CHANGE:
        worst = max(ratios, key=abs)
        raise CompactError(
            f"{path}: standard deviations of strike {name} would change by {100 * worst:+.0f} %: {_REMEDY}"
        )
    k = None if one.k is None else float(changes[1] / one.k)
    return StrikeChange(
        strike_id=name,
        phi_rad=float(changes[0]),
        k_relative=k,
        phi_sd_relative=float(ratios[0]),
        k_sd_relative=None if k is None else float(ratios[1]),
    )


def is_as_aimed(change: StrikeChange) -> bool:
    """True if a strike changed so little that no other coding need be tried."""
    return abs(change.phi_rad or 0.0) <= AIMED_PHI and abs(change.k_relative or 0.0) <= AIMED_K
