"""Files for contributors agree with the project: versions, workflow, citation."""

from __future__ import annotations

import re
import subprocess
import tomllib

import yaml

from tests.places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_pre_commit_runs_the_locked_ruff():
    locked = re.search(
        r"^ruff==([\d.]+)", (ROOT / "requirements.lock").read_text(encoding="utf-8"), re.MULTILINE
    )
    (hooks,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert locked is not None
    assert hooks["rev"] == f"v{locked[1]}"


def test_the_workflow_runs_the_gates_and_names_tests_that_exist():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    runs = [step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step]
    assert ".ci/run" in runs
    named = {path for run in runs for path in re.findall(r"\b(?:tests|recordings)/[\w./-]+", run)}
    assert not [path for path in named if not (ROOT / path).exists()]


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])


def test_the_changelog_has_this_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.+)$", text, re.MULTILINE)[0] == "Unreleased"
    assert f"## {PROJECT['version']}" in text


def test_nothing_that_is_ignored_is_in_the_repository():
    """A tracked `.venv`, even a link, takes the place of the environment wherever it is checked out."""
    tracked = ["git", "-C", str(ROOT), "ls-files", "--cached", "--ignored", "--exclude-standard"]
    found = subprocess.run(tracked, capture_output=True, text=True, check=True).stdout.split()
    assert not found


def test_every_extra_that_is_named_exists_and_none_is_looked_for_on_an_index():
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    sources = [
        path for package in ("acquire", "analyze", "schemas") for path in (ROOT / package).rglob("*.py")
    ]
    text = "\n".join(path.read_text(encoding="utf-8") for path in pages + sources)
    named = re.findall(r"install [^\n]*'\.\[([\w,]+)\]'|extra_command\([\"'](\w+)[\"']\)", text)
    extras = {extra for pair in named for group in pair if group for extra in group.split(",")}
    assert extras <= set(PROJECT["optional-dependencies"])
    assert extras >= {"export", "s3", "cluster", "rig"}
    assert "percuss[" not in text
