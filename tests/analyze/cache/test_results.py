"""A result is computed once for the same inputs and code, and again whenever one of them differs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from analyze.cache import code_version, results
from analyze.cache.encoding import encode
from analyze.cache.folder import CacheFolder
from analyze.cache.results import ResultCache, user_cache


@dataclass(frozen=True)
class Number:
    value: float


class Cached:
    """A cache that counts computations and keeps its warnings."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.computed, self.warnings = CacheFolder(folder), 0, []

    def get(self, inputs: object, value: float = 1.0) -> float:
        def compute() -> Number:
            self.computed += 1
            return Number(value)

        cache = ResultCache(self.folder, self.warnings.append)
        return cache.get(Number, inputs, "a number", compute).value


@pytest.fixture
def cached(tmp_path: Path) -> Cached:
    return Cached(tmp_path)


def test_the_same_inputs_are_computed_once(cached):
    assert [cached.get((1, "x"), 5.0), cached.get((1, "x"), 6.0)] == [5.0, 5.0]
    assert (cached.computed, cached.warnings) == (1, [])


def test_other_inputs_are_computed(cached):
    for inputs in ((1, "x"), (2, "x"), (1, "y"), (1.0, "x"), ([1], "x"), (1, "x", None), Number(1)):
        cached.get(inputs)
    assert cached.computed == 7


def test_another_version_of_the_code_computes_anew(cached, monkeypatch):
    cached.get(1)
    monkeypatch.setattr(results, "analysis_version", lambda: "another")
    monkeypatch.setattr(results, "hash_of_code", lambda: "another")
    assert cached.get(1, 7.0) == 7.0
    assert cached.computed == 2


def test_code_that_changes_meanwhile_keeps_nothing(cached, monkeypatch):
    """The program may have loaded some modules before the change and others after it."""
    monkeypatch.setattr(results, "hash_of_code", lambda: "changed")
    cached.get(1)
    assert cached.folder.entries() == []


def test_the_codes_version_is_that_of_files_and_libraries(monkeypatch, tmp_path):
    for package in ("analyze", "schemas"):
        (tmp_path / package).mkdir()
    (tmp_path / "analyze" / "verbs").mkdir()
    monkeypatch.setattr(code_version, "_ROOT", tmp_path)
    found = [code_version.hash_of_code()]
    (tmp_path / "analyze" / "verbs" / "shows.py").write_text("pass")
    assert code_version.hash_of_code() == found[0]
    for package, text in (("analyze", "a = 1"), ("analyze", "a = 2"), ("schemas", "a = 2")):
        (tmp_path / package / "numbers.py").write_text(text)
        found.append(code_version.hash_of_code())
    monkeypatch.setattr(code_version, "version", lambda name: "0")
    found.append(code_version.hash_of_code())
    assert len(set(found)) == len(found)


@pytest.mark.parametrize("foreign", [None, encode("no number"), b"", encode(Number(1.0))[:-3]])
def test_an_entry_that_cannot_be_used_is_named_and_replaced(cached, foreign):
    cached.get(1)
    (entry,) = cached.folder.entries()
    if foreign is None:
        entry.path.write_bytes(entry.path.read_bytes()[:-1])
    else:
        cached.folder.write(entry.path.stem, entry.label, foreign)
    assert [cached.get(1, 8.0), cached.get(1, 9.0)] == [8.0, 8.0]
    (warning,) = cached.warnings
    assert warning.startswith(str(cached.folder.path))
    assert warning.endswith("it is computed again")
    assert "\n" not in warning


def test_an_error_is_not_kept(cached):
    cache = ResultCache(cached.folder, cached.warnings.append)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            cache.get(Number, 1, "a number", lambda: Number(1 / 0))
    assert cached.folder.entries() == []


@dataclass(frozen=True)
class Wrong:
    value: float = "no number"


def test_what_would_not_come_back_is_not_kept(cached):
    cache = ResultCache(cached.folder, cached.warnings.append)
    assert cache.get(Wrong, 1, "a text", Wrong) == Wrong()
    assert cache.get(Number, object(), "a number", lambda: Number(2.0)) == Number(2.0)
    assert cached.folder.entries() == cached.warnings == []


def test_a_user_may_switch_it_off(monkeypatch):
    monkeypatch.setenv("PERCUSS_CACHE", "")
    assert user_cache(print) is None
