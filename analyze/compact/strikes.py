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
    from analyze.types import TipMotion

MAX_CHANGE_SD = 0.5
"""largest change of phi and k over their standard deviations"""

_REMEDY = "it stays as it is; compact it without --near-lossless and --crop"


def strike_motions(path: Path, progress: Progress) -> dict[str, TipMotion]:
    """Motion of each strike of a recording, by its id.

    Raises:
        CompactError: the recording has tosses, which are not compared.
        AnalyzeError: the recording cannot be read, or no strike can.
    """
    head = read_head(path)
    if head.toss_ids:
        raise CompactError(f"{path}: has tosses, on which a loss is not judged: {_REMEDY}")
    return {each.strike_id: each for each in read_evidence(head, progress=progress).motions}


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
    before: dict[str, TipMotion], after: dict[str, TipMotion], path: Path
) -> list[StrikeChange]:
    """Difference of each usable strike's phi and k.

    Raises:
        CompactError: a strike has another verdict, or changed by more than `MAX_CHANGE_SD`; or none is good.
    """
    found: list[StrikeChange] = []
    for name, one in before.items():
        other = after.get(name)
        if other is None or other.verdict is not one.verdict:
            now = "not read" if other is None else other.verdict.value
            raise CompactError(f"{path}: strike {name} is {one.verdict.value}, and would be {now}: {_REMEDY}")
        if one.verdict not in USABLE_VERDICTS or one.fit is None:
            continue
        if other.fit is None or (one.fit.k is None) != (other.fit.k is None):
            raise CompactError(f"{path}: strike {name} would be fitted otherwise: {_REMEDY}")
        phi, k = other.fit.phi - one.fit.phi, None
        sds = [abs(phi) / math.sqrt(one.fit.covariance[0, 0])]
        if one.fit.k is not None and other.fit.k is not None:
            k = other.fit.k / one.fit.k - 1.0
            sds.append(abs(k) * one.fit.k / math.sqrt(one.fit.covariance[1, 1]))
        if not all(sd <= MAX_CHANGE_SD for sd in sds):
            raise CompactError(
                f"{path}: strike {name} would change by {max(sds):.1f} standard deviations: {_REMEDY}"
            )
        found.append(StrikeChange(strike_id=name, phi_rad=float(phi), k_relative=k))
    if not found:
        raise CompactError(f"{path}: has no good strike by which a loss could be judged: {_REMEDY}")
    return found
