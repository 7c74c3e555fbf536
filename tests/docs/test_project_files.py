"""Files for contributors agree with the project: versions, workflow, citation."""

from __future__ import annotations

import re
import subprocess
import tomllib

import yaml

from tests.places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
INSTALLERS = [
    ROOT / "Makefile",
    ROOT / ".ci" / "install-uv",
    *(ROOT / "containers").glob("*.Containerfile"),
    *(ROOT / ".github" / "workflows").glob("*.yml"),
]


def test_pre_commit_runs_the_locked_ruff():
    (hooks,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert hooks["repo"] == "local"
    assert {hook["entry"].split()[0] for hook in hooks["hooks"]} == {".venv/bin/ruff"}


def test_everything_is_installed_with_hashes():
    """pip and uv check hashes where the lock gives them: for packages, for what builds them, and for uv."""
    checked = [
        "--require-hashes -r",
        "--require-hashes --build-constraints requirements.lock requirements.lock",
        "--constraints requirements.lock --build-constraints requirements.lock",
        "--no-deps --no-build-isolation -e .",  # nothing is downloaded
    ]
    found = []
    for path in INSTALLERS:
        text = re.sub(r"\\\n|\n {10,}", " ", path.read_text(encoding="utf-8"))
        lines = [line for line in text.splitlines() if re.search(r"\b(pip|uv) (pip )?(install|sync)\b", line)]
        found += [(path.name, re.sub(r"\s+", " ", line)) for line in lines]
    assert len(found) == 7
    assert not [each for each in found if not any(options in each[1] for options in checked)]


def test_the_lock_has_uv_and_what_source_archives_are_built_with():
    """PyGObject and pycairo have no wheels for Linux: meson-python and its dependencies build them."""
    pinned = dict(re.findall(r"^([\w.-]+)==(\S+) \\\n    --hash=sha256:[0-9a-f]{64}", LOCK, re.MULTILINE))
    assert len(pinned) == len(re.findall(r"^[\w.-]+==", LOCK, re.MULTILINE))
    assert {"uv", "meson-python", "meson", "ninja", "pyproject-metadata", "packaging", "pycairo"} <= set(
        pinned
    )
    assert {"hatchling", "pathspec", "pluggy", "trove-classifiers"} <= set(pinned)


def test_actions_of_the_workflow_are_pinned_by_commit():
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    used = re.findall(r"uses: (\S+)", workflow)
    assert used
    assert not [action for action in used if not re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", action)]


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
