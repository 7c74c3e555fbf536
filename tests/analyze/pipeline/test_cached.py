"""Strikes and estimates from the cache equal those computed, and nothing that has changed since is used."""

from __future__ import annotations

import dataclasses
import os
import shutil
import types
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any, Union, get_args, get_origin

import numpy as np
import pytest

from analyze.cache import decoding
from analyze.cache.encoding import encode
from analyze.cache.folder import CacheFolder
from analyze.cache.results import ResultCache
from analyze.errors import TrackingError
from analyze.pipeline import cached
from analyze.pipeline.cached import KeptEstimate, KeptReading, cached_strike_reader, estimate_with_cache
from analyze.pipeline.contact_properties import with_contact_properties
from analyze.pipeline.estimate import Estimate, EstimateOptions
from analyze.pipeline.estimate_recordings import estimate_recordings
from analyze.pipeline.evidence import Evidence, RecordingHead, StrikeReading
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.read_evidence import struck_object
from analyze.reading.recording import Recording, open_recording
from analyze.result.answer import Answer
from schemas.document import Document
from schemas.strike_result import Verdict
from tests.places import SAMPLE

pytestmark = pytest.mark.usefixtures("coarse_regions")


class Session:
    """Estimates of the sample and of its copies with one cache; the work that is done is counted.

    Strikes and estimate are computed once, and afterwards come from memory.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.warnings = CacheFolder(folder), []
        self.cache = ResultCache(self.folder, self.warnings.append)
        self.readings: dict[str, StrikeReading] = {}
        self.estimate: Estimate | None = None
        self.read: list[str] = []
        self.estimated = 0
        self._read, self._estimate = cached.read_strike, cached.estimate_evidence

    def read_strike(self, recording: Any, struck: Any, markers: Any, record: Any) -> StrikeReading:
        self.read.append(record.strike_id)
        if record.strike_id not in self.readings:
            self.readings[record.strike_id] = self._read(recording, struck, markers, record)
        return self.readings[record.strike_id]

    def estimate_evidence(self, evidence: Evidence, options: EstimateOptions) -> Estimate:
        self.estimated += 1
        if self.estimate is None:
            self.estimate = self._estimate(evidence, options)
        return self.estimate

    def work(self, path: Path = SAMPLE, options: EstimateOptions | None = None) -> tuple[int, int]:
        """Numbers of strikes read and estimates made for an estimate of the recording."""
        self.read, self.estimated = [], 0
        estimate_recordings([path], options, cache=self.cache)
        return len(self.read), self.estimated


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    made = Session(tmp_path_factory.mktemp("cache"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cached, "read_strike", made.read_strike)
        patch.setattr(cached, "estimate_evidence", made.estimate_evidence)
        assert made.work() == (4, 1)
        yield made


@pytest.fixture(scope="module")
def sample() -> Iterator[Recording]:
    with open_recording(SAMPLE) as recording:
        yield recording


def test_the_second_estimate_computes_nothing_and_is_the_same(session):
    fresh = with_contact_properties(session.estimate)
    kept = estimate_recordings([SAMPLE], cache=session.cache)
    assert session.work() == (0, 0)
    assert session.warnings == []
    assert Answer.from_estimate(kept).json() == Answer.from_estimate(fresh).json()
    given = (Evidence, EstimateOptions)
    assert encode(kept, given) == encode(fresh, given)
    for field in dataclasses.fields(Evidence):
        if field.name != "recordings":
            assert encode(getattr(kept.evidence, field.name)) == encode(
                getattr(fresh.evidence, field.name)
            ), field.name


def test_a_moved_recording_is_known_and_a_changed_file_is_not(session, tmp_path):
    moved = tmp_path / "moved.mcap"
    shutil.copy2(SAMPLE, moved)
    assert session.work(moved) == (0, 0)
    state = moved.stat()
    os.utime(moved, ns=(state.st_atime_ns, state.st_mtime_ns + 1))
    assert session.work(moved) == (4, 0), "strikes that are read as before give the same estimate"


def test_another_object_file_is_computed_anew(session, sample, tmp_path):
    own = sample.attachments["object.toml"].decode()
    path, options = tmp_path / "o.toml", EstimateOptions(object_path=tmp_path / "o.toml")
    for mass in ("0.045", "0.046"):
        text = "\n".join(f"mass_kg = {mass}" if s.startswith("mass_kg") else s for s in own.splitlines())
        path.write_text(text, encoding="utf-8")
        assert session.work(options=options) == (4, 1)
        assert session.work(options=options) == (0, 0)


def _changed_plan(struck: Any) -> Any:
    first, *others = struck.plan.strikes
    heading = first.model_copy(update={"heading_rad": first.heading_rad + 1e-9})
    return dataclasses.replace(struck, plan=struck.plan.model_copy(update={"strikes": [heading, *others]}))


def _changed_record(record: Any) -> Any:
    other = type(record)()
    other.CopyFrom(record)
    other.contact_time_ns += 1
    return other


CHANGES = {
    "plan": lambda struck, markers, record: (_changed_plan(struck), markers, record),
    "object": lambda struck, markers, record: (
        dataclasses.replace(struck, spec=struck.spec.model_copy(update={"mass_sd_kg": 0.002})),
        markers,
        record,
    ),
    "shape": lambda struck, markers, record: (dataclasses.replace(struck, sha256="0"), markers, record),
    "marker": lambda struck, markers, record: (
        struck,
        [dataclasses.replace(marker, size=np.nextafter(marker.size, 1)) for marker in markers],
        record,
    ),
    "markers without places": lambda struck, markers, record: (
        struck,
        [dataclasses.replace(marker, T_object_marker=None) for marker in markers],
        record,
    ),
    "record": lambda struck, markers, record: (struck, markers, _changed_record(record)),
}


def _read(session: Session, recording: Recording, change: str = "") -> StrikeReading:
    struck = struck_object(recording)
    inputs = (struck, placed_markers(struck.spec), recording.strikes[0])
    inputs = CHANGES[change](*inputs) if change else inputs
    session.read = []
    return cached_strike_reader(session.cache)(recording, *inputs)


@pytest.mark.parametrize("change", CHANGES)
def test_a_strike_is_read_anew_if_anything_differs(session, sample, change):
    _read(session, sample)
    assert session.read == []
    _read(session, sample, change)
    assert len(session.read) == 1


@pytest.mark.parametrize("change", ["content", "manifest", "part"])
def test_a_strike_of_another_recording_is_read_anew(session, change, monkeypatch):
    with open_recording(SAMPLE) as other:
        if change == "content":
            other.parts = tuple(dataclasses.replace(part, content_id="0") for part in other.parts)
        elif change == "manifest":
            other.manifest = other.manifest.model_copy(update={"g_m_s2": 9.82})
        else:
            other.missing_parts = (2,)
        _read(session, other)
        assert len(session.read) == 1


@pytest.mark.parametrize("change", ["content_id", "damaged_chunks"])
def test_a_recording_without_seal_or_with_damage_is_not_kept(session, change):
    with open_recording(SAMPLE) as other:
        setattr(other, change, None if change == "content_id" else 1)
        for _ in range(2):
            _read(session, other)
            assert len(session.read) == 1


def test_a_strike_without_marker_is_kept_with_its_reason(session, sample, monkeypatch):
    struck = dataclasses.replace(struck_object(sample), sha256="unreadable")
    record, reason = sample.strikes[0], "marker 7 is in view"
    motion = dataclasses.replace(session.readings[record.strike_id].motion, verdict=Verdict.UNREADABLE)
    unread = StrikeReading(record, motion, None, TrackingError(reason), 3)
    monkeypatch.setattr(cached, "read_strike", lambda *_: unread)
    first = cached_strike_reader(session.cache)(sample, struck, [], record)
    monkeypatch.setattr(cached, "read_strike", None)
    again = cached_strike_reader(session.cache)(sample, struck, [], record)
    for each in (first, again):
        assert isinstance(each.problem, TrackingError)
        assert (str(each.problem), each.report, each.frames_lost) == (reason, None, 3)


@pytest.mark.parametrize(
    "options", [{"seed": 1}, {"estimator": "pivot_fit"}, {"exclude": frozenset({"s1.1"})}], ids=str
)
def test_other_options_are_estimated_anew(session, options):
    for expected in (1, 0):
        assert session.work(options=EstimateOptions(**options)) == (0, expected)


def test_other_evidence_is_estimated_anew(session):
    evidence = dataclasses.replace(session.estimate.evidence)
    head = evidence.recordings[0]
    motion = evidence.motions[0]
    fit = dataclasses.replace(motion.fit, phi=np.nextafter(motion.fit.phi, 1))
    warmer = head.manifest.model_copy(update={"g_sd_m_s2": 0.5})
    estimate_with_cache(session.cache, evidence)
    session.estimated = 0
    for changes in (
        {"motions": (dataclasses.replace(motion, fit=fit), *evidence.motions[1:])},
        {"spec": evidence.spec.model_copy(update={"mass_sd_kg": 0.002})},
        {"recordings": (dataclasses.replace(head, manifest=warmer),)},
        {"model": dataclasses.replace(evidence.model, surface_sd=1e-5)},
        {"object_path_used": True},
    ):
        estimate_with_cache(session.cache, dataclasses.replace(evidence, **changes))
    assert session.estimated == 5
    renamed = dataclasses.replace(head, path=Path("other.mcap"), files=("other.mcap",))
    estimate_with_cache(session.cache, dataclasses.replace(evidence, recordings=(renamed,)))
    assert session.estimated == 5


@pytest.mark.parametrize("kind", [KeptReading, KeptEstimate, Evidence])
def test_every_field_can_be_encoded_and_decoded(kind):
    """Results with a new field of another type would not be kept."""
    seen: set[Any] = {Evidence, EstimateOptions, RecordingHead} - {kind}
    waiting: list[Any] = [kind]
    while waiting:
        each = waiting.pop()
        origin = get_origin(each)
        if each is Ellipsis or each in seen:
            continue
        if origin in {Union, types.UnionType} or origin in decoding._READERS:
            waiting += [] if origin is np.ndarray else get_args(each)
            continue
        seen.add(each)
        if dataclasses.is_dataclass(each):
            waiting += decoding.field_types(each).values()
        else:
            assert each in decoding._PLAIN or issubclass(each, Enum | Document), each
    assert len(seen) > 10
