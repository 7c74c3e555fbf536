"""`analyze cache` and --no-cache: later commands compute nothing; users see and remove what is kept."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from analyze.cli import main as analyze
from analyze.pipeline import cached
from tests.places import SAMPLE

pytestmark = pytest.mark.usefixtures("coarse_regions")


def run(*arguments: object) -> Result:
    done = CliRunner().invoke(analyze, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("home") / "cache"


@pytest.fixture(scope="module")
def fresh() -> str:
    """The answer without a cache."""
    return run("estimate", SAMPLE, "--json").stdout


@pytest.fixture
def filled(folder, fresh, monkeypatch) -> Path:
    """Folder of the cache with the sample's strikes and estimate."""
    monkeypatch.setenv("PERCUSS_CACHE", str(folder))
    if not folder.exists():
        assert run("estimate", SAMPLE, "--json").stdout == fresh
    return folder


def _refuse(*_: object) -> None:
    raise AssertionError("computed again")


def test_the_same_answer_is_not_computed_again(filled, fresh, monkeypatch):
    monkeypatch.setattr(cached, "read_strike", _refuse)
    monkeypatch.setattr(cached, "estimate_evidence", _refuse)
    again = run("estimate", SAMPLE, "--json")
    assert (again.stdout, again.stderr) == (fresh, "")


@pytest.mark.parametrize(
    "arguments",
    [
        ("score", "--json"),
        ("report", "--json"),
        ("export", "--format", "urdf", "-o", "body.urdf"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_other_commands_use_it(filled, arguments, monkeypatch, tmp_path):
    monkeypatch.setattr(cached, "read_strike", _refuse)
    monkeypatch.setattr(cached, "estimate_evidence", _refuse)
    monkeypatch.chdir(tmp_path)
    run(arguments[0], SAMPLE, *arguments[1:])


@pytest.mark.slow
def test_a_replay_uses_it(filled, monkeypatch, tmp_path):
    monkeypatch.setattr(cached, "read_strike", _refuse)
    monkeypatch.setattr(cached, "estimate_evidence", _refuse)
    run("replay", SAMPLE, "--save", tmp_path / "replay.rrd")


def test_no_cache_neither_reads_nor_writes(filled, monkeypatch, tmp_path):
    monkeypatch.setattr("analyze.cache.results.user_cache", _refuse)
    options = ("--no-cache", "--exclude", "none")
    done = CliRunner().invoke(analyze, ["estimate", str(SAMPLE), *options])
    assert done.exit_code == 1
    assert "none" in done.stderr


def test_a_damaged_entry_is_named_in_one_line_and_replaced(filled, fresh):
    entries = json.loads(run("cache", "--json").stdout)["entries"]
    (name,) = [entry["file"] for entry in entries if entry["content"].startswith("strike s2.2")]
    path = filled / name
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    found = run("estimate", SAMPLE, "--json")
    assert found.stdout == fresh
    (line,) = found.stderr.splitlines()
    assert line == f"analyze: {path}: is damaged: it is computed again"
    assert path.read_bytes() == whole


def test_a_folder_that_cannot_be_used_changes_nothing(fresh, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PERCUSS_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(cached, "estimate_evidence", _refuse)
    with pytest.raises(AssertionError, match="computed again"):  # all is computed, as without a cache
        CliRunner().invoke(analyze, ["estimate", str(SAMPLE)], catch_exceptions=False)
    assert "0 entries" in run("cache").stdout


def test_the_user_sees_and_removes_what_is_kept(filled, monkeypatch):
    assert run("cache").stdout.startswith(f"cache: {filled}: 5 entries, 0.")
    listed = run("cache", "--list").stdout
    assert "strike s1.1 of sample" in listed
    assert "estimate of carton from 4 strikes" in listed
    found = json.loads(run("cache", "--json").stdout)
    assert found["size_bytes"] == sum(path.stat().st_size for path in filled.iterdir())
    assert run("cache", "--clear").stdout == f"cache: {filled}: 5 entries removed\n"
    assert json.loads(run("cache", "--json").stdout)["entries"] == []
    monkeypatch.setenv("PERCUSS_CACHE", "")
    assert "switched off" in run("cache").stdout
    assert json.loads(run("cache", "--json").stdout) == {"folder": None}


def test_list_and_clear_exclude_each_other():
    assert CliRunner().invoke(analyze, ["cache", "--list", "--clear"]).exit_code == 2
