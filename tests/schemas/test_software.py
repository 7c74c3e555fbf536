"""Name and version of the program that recordings and results contain."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

from schemas.software import BUILT_COMMIT, built_commit, commit, extra_command, software_version
from tests.places import ROOT


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


def test_an_extra_is_installed_by_the_program_that_installed_the_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    assert extra_command("export") == "pip install '.[export]' in the project's folder"
    (tmp_path / "uv-receipt.toml").touch()
    assert extra_command("export") == "uv tool install '.[export]' in the project's folder"


@pytest.fixture
def source(checkout: Path) -> Path:
    """A checkout that builds as the project does, with a module of each package."""
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "schemas/software.py"):
        (checkout / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, checkout / name)
    for name in ("acquire", "analyze"):
        (checkout / name).mkdir()
        (checkout / name / "__init__.py").touch()
    git(checkout, "add", ".")
    git(checkout, "commit", "-q", "-m", "source")
    return checkout


def built(source: Path, kind: str, folder: Path) -> Path:
    """Root of the installed wheel that is built from `source`."""
    (wheel,) = WheelBuilder(str(source)).build(directory=str(folder), versions=[kind])
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / kind)
    return folder / kind


def test_a_wheel_names_the_commit_it_was_built_from(source: Path, tmp_path_factory) -> None:
    folder = tmp_path_factory.mktemp("wheel")
    installed = built(source, "standard", folder)
    assert built_commit(installed) == git(source, "rev-parse", "HEAD")[:12]
    (source / "LICENSE").write_text("changed", encoding="utf-8")
    assert built_commit(built(source, "standard", folder)) == commit(source)
    assert commit(source).endswith("-dirty")


def test_a_wheel_from_a_source_archive_names_its_commit(source: Path, tmp_path_factory) -> None:
    folder = tmp_path_factory.mktemp("archive")
    (archive,) = SdistBuilder(str(source)).build(directory=str(folder))
    subprocess.run(["tar", "-xf", archive, "-C", folder], check=True)
    (unpacked,) = (path for path in folder.iterdir() if path.is_dir())
    assert not (unpacked / ".git").exists()
    assert built_commit(built(unpacked, "standard", folder)) == commit(source)


def test_an_editable_wheel_states_no_commit_which_would_grow_old(source: Path, tmp_path_factory) -> None:
    installed = built(source, "editable", tmp_path_factory.mktemp("editable"))
    assert not list(installed.rglob(BUILT_COMMIT))
    assert built_commit(source) == ""
