"""Coarse region masses, for tests of anything else."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def coarse_region_masses() -> Iterator[None]:
    """Estimate region masses coarsely: they take half of an estimate.

    Cells and random planes do not change the centre of mass, its moments or the checks of the strikes.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analyze.pipeline.solved.CELLS", 500)
        patch.setattr("analyze.estimation.plane_chains.CHAINS", 50)
        patch.setattr("analyze.estimation.plane_chains.RANDOM_SURFACES", 600)
        yield
