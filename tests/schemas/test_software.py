"""Name and version of the program that recordings and results contain."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from schemas.software import commit, software_version


def git(folder: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.org"]
    return subprocess.run(
        ["git", "-C", str(folder), *identity, *arguments], check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    git(tmp_path, "init", "-q")
    (tmp_path / "a").write_text("1", encoding="utf-8")
    git(tmp_path, "add", "a")
    git(tmp_path, "commit", "-q", "-m", "first")
    return tmp_path


def test_checkout_gives_its_commit_and_dirty_mark(checkout: Path) -> None:
    head = git(checkout, "rev-parse", "HEAD")[:12]
    git(checkout, "tag", "-a", "v1", "-m", "a tag is no commit")
    assert commit(checkout) == head
    (checkout / "a").write_text("2", encoding="utf-8")
    assert commit(checkout) == f"{head}-dirty"


def test_git_hook_variables_are_ignored(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head = commit(checkout)
    monkeypatch.setenv("GIT_DIR", "/nowhere")
    assert commit(checkout) == head


def test_without_a_checkout_or_git_there_is_no_commit(
    checkout: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch
) -> None:
    assert commit(tmp_path_factory.mktemp("installed")) == ""
    monkeypatch.setenv("PATH", "/nowhere")
    assert commit(checkout) == ""


def test_an_empty_checkout_has_no_commit(tmp_path: Path) -> None:
    git(tmp_path, "init", "-q")
    assert commit(tmp_path) == ""


def test_version_comes_first() -> None:
    assert software_version().startswith("percuss ")
