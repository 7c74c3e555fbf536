"""Fixtures that the tests of the analysis share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from markupsafe import Markup

from tests.analyze.coarse_regions import coarse_region_masses
from tests.places import RECORDINGS


@pytest.fixture(scope="session", autouse=True)
def samples_are_tracked_once() -> Iterator[None]:
    """Track a strike of the committed sample once for the same markers and object; many tests read it.

    A copy of the sample elsewhere is tracked each time.
    """
    from analyze.pipeline import read_evidence as evidence

    track, known = evidence._strike, {}

    def remembered(recording, struck, markers, record):
        if recording.path.resolve().parent != RECORDINGS:
            return track(recording, struck, markers, record)
        places = tuple(
            (m.id, m.size, None if m.T_object_marker is None else m.T_object_marker.tobytes())
            for m in markers
        )
        key = (recording.path.name, record.strike_id, places, struck.sha256, struck.overridden)
        if key not in known:
            known[key] = track(recording, struck, markers, record)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evidence, "_strike", remembered)
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the plots of a report empty, for tests of its texts: plots take nine tenths of its time."""
    for figure in ("regions", "moments", "sources", "influence", "strike"):
        monkeypatch.setattr(f"analyze.report.report.{figure}_figure", lambda *_: None)
    monkeypatch.setattr("analyze.report.report.voxel_figures", lambda _: [None] * 4)
    monkeypatch.setattr("analyze.report.report.projection_figures", lambda *_: [None] * 3)
    monkeypatch.setattr("analyze.report.report.prediction_figures", lambda strikes: [None] * len(strikes))
    monkeypatch.setattr("analyze.report.report.figure_element", lambda _: Markup("<svg></svg>"))


@pytest.fixture(scope="module")
def coarse_regions() -> Iterator[None]:
    """Estimate region masses coarsely in a whole file, for tests of anything else."""
    with coarse_region_masses():
        yield


@pytest.fixture
def coarse_regions_here() -> Iterator[None]:
    """Estimate region masses coarsely in one test, where others of its file need them fine."""
    with coarse_region_masses():
        yield
