"""A report's page is made once: the kept one is used only if all that it shows is the same."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from analyze.cache.folder import CacheFolder
from analyze.cache.results import ResultCache
from analyze.report import kept_page, report
from analyze.report.kept_page import write_report_with_cache
from analyze.result.answer import Answer, answer_evidence
from tests.analyze.simulated_session import carton, session
from tests.places import ROOT


@pytest.fixture(scope="module")
def answer() -> Answer:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analyze.pipeline.solved.CELLS", 500)
        return answer_evidence(session(carton(), np.random.default_rng(3), repeats=1))


class Written:
    """Writer of pages that counts the pages made; they show only a number instead of plots."""

    def __init__(self, folder, monkeypatch) -> None:
        self.made, self.warnings, self._folder = 0, [], folder
        self.cache = ResultCache(CacheFolder(folder / "cache"), self.warnings.append)
        monkeypatch.setattr(report, "camera_stills", lambda estimate: [])
        monkeypatch.setattr(report, "render_report", self._render)

    def _render(self, answer, stills, score) -> str:
        self.made += 1
        return f"<p>{self.made}</p>"

    def page(self, answer, score=None) -> str:
        """Text of the page that is written for an answer."""
        write_report_with_cache(answer, self._folder / "page.html", score, self.cache)
        return (self._folder / "page.html").read_text(encoding="utf-8")


@pytest.fixture
def written(tmp_path, monkeypatch) -> Written:
    (tmp_path / "r.mcap").write_bytes(b"recording")
    return Written(tmp_path, monkeypatch)


def at(answer: Answer, folder, **changed) -> Answer:
    """The answer with its recording in `folder`, and fields of the recording's head changed."""
    evidence = answer.estimate.evidence
    head = replace(evidence.recordings[0], path=folder / "r.mcap", **changed)
    estimate = replace(answer.estimate, evidence=replace(evidence, recordings=(head,)))
    return Answer(estimate, answer.result)


def test_the_same_page_is_made_once(written, answer, tmp_path):
    assert [written.page(at(answer, tmp_path)) for _ in range(2)] == ["<p>1</p>"] * 2
    assert written.warnings == []
    assert [entry.label for entry in CacheFolder(tmp_path / "cache").entries()] == [
        "report of test box from 6 strikes"
    ]


@pytest.mark.parametrize("change", ["score", "result", "motion", "name", "file", "templates"])
def test_a_page_that_would_differ_is_made_anew(written, answer, tmp_path, monkeypatch, change):
    here, score = at(answer, tmp_path), {"centre_of_mass_error_m": 1e-5}
    assert written.page(here, score) == "<p>1</p>"
    if change == "score":
        score = {"centre_of_mass_error_m": 2e-5}
    elif change == "result":
        here = Answer(here.estimate, here.result.model_copy(update={"verdict": ["another"]}))
    elif change == "motion":
        evidence = here.estimate.evidence
        here = replace(
            here, estimate=replace(here.estimate, evidence=replace(evidence, motions=evidence.motions[1:]))
        )
    elif change == "name":
        (tmp_path / "s.mcap").write_bytes(b"recording")
        here = at(answer, tmp_path, files=("s.mcap",))
    elif change == "file":
        os.utime(tmp_path / "r.mcap", (1, 1))
    else:
        monkeypatch.setattr(kept_page, "hash_of_pages", lambda: "another")
    assert written.page(here, score) == "<p>2</p>"


def test_templates_that_change_meanwhile_are_not_mixed_with_the_code(written, answer, tmp_path, monkeypatch):
    hashes = iter(["before", "after", "before", "before"])
    monkeypatch.setattr(kept_page, "hash_of_pages", lambda: next(hashes))
    assert [written.page(at(answer, tmp_path)) for _ in range(2)] == ["<p>1</p>", "<p>2</p>"]


@pytest.mark.parametrize("missing", ["seal", "file"])
def test_nothing_is_kept_of_a_recording_that_cannot_be_identified(written, answer, tmp_path, missing):
    changed = {"content_id": ""} if missing == "seal" else {"files": ("removed.mcap",)}
    here = at(answer, tmp_path, **changed)
    assert [written.page(here) for _ in range(2)] == ["<p>1</p>", "<p>2</p>"]
    assert CacheFolder(tmp_path / "cache").entries() == []


def test_a_kept_answer_and_page_need_no_library_of_plots():
    needed = (
        "analyze.verbs.estimate, analyze.verbs.report, analyze.report.csv_table, analyze.report.kept_page"
    )
    needed += ", analyze.report.summary, analyze.result.answer, analyze.result.score"
    code = f"import sys, {needed}; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
