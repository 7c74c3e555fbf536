"""The virtual rig names the libraries that it lacks before it starts anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.cli import main
from acquire.virtual import requirements


def test_all_libraries_are_installed_here() -> None:
    requirements.refuse_missing_libraries()


def test_a_missing_library_is_named_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`acquire demo` names the missing modules and `make setup` in one line, and leaves no file."""
    monkeypatch.setattr(requirements, "REQUIRED_MODULES", ("mujoco", "no_physics", "no_bus"))
    shown = CliRunner().invoke(main, ["demo", "-o", str(tmp_path / "demo.mcap")])
    assert shown.exit_code == 1
    assert "acquire: the virtual rig needs no_physics, no_bus, which analysis alone" in shown.stderr
    assert "make setup" in shown.stderr
    assert not list(tmp_path.iterdir())
