"""The container files agree with the project; where there is a builder, they are built and run."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.docs.test_project_files import PROJECT
from tests.places import ROOT

FOLDER = ROOT / "containers"
FILES = sorted(FOLDER.glob("*.Containerfile"))
INSTRUCTIONS = {"FROM", "RUN", "COPY", "ENV", "WORKDIR", "ENTRYPOINT"}
COMMAND = {"analysis": "analyze", "rig": "acquire"}


def instructions_of(path: Path) -> list[tuple[str, str]]:
    """Instructions of a container file with their arguments, continued lines joined."""
    text = re.sub(r"^\s*#.*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE).replace("\\\n", " ")
    return [(line.split(maxsplit=1)[0], line.split(maxsplit=1)[1]) for line in text.splitlines() if line]


def packages_of(arguments: str) -> set[str]:
    """Debian packages that a RUN instruction installs."""
    listed = re.search(r"apt-get install -y --no-install-recommends ([^&]*)", arguments)
    return set(listed[1].split()) if listed else set()


def test_there_is_one_for_analysis_and_one_for_the_rig() -> None:
    assert {path.stem for path in FILES} == set(COMMAND)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_container_file_is_valid_and_names_what_exists(path: Path) -> None:
    found = instructions_of(path)
    assert {name for name, _ in found} <= INSTRUCTIONS
    stages = [arguments for name, arguments in found if name == "FROM"]
    assert stages == ["docker.io/library/debian:12-slim AS build", "docker.io/library/debian:12-slim"]
    for name, arguments in found:
        if name == "RUN":
            checked = subprocess.run(
                ["bash", "-n"], input=arguments, text=True, capture_output=True, check=False
            )
            assert checked.returncode == 0, checked.stderr
    (extras,) = re.findall(r"'/src\[([\w,]+)\]'", path.read_text(encoding="utf-8"))
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    assert found[-1] == ("ENTRYPOINT", f'["{COMMAND[path.stem]}"]')
    assert COMMAND[path.stem] in PROJECT["scripts"]


def test_the_rigs_image_has_the_packages_of_make_setup() -> None:
    """Headers and compilers are in the building stage alone; the libraries they serve are in the image."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    (listed,) = re.findall(r"^DEBIAN := (.*)$", makefile, re.MULTILINE)
    runs = [arguments for name, arguments in instructions_of(FOLDER / "rig.Containerfile") if name == "RUN"]
    build, *_, final = (packages for packages in map(packages_of, runs) if packages)
    assert set(listed.split()) <= build | final
    compiled = {"gcc", "pkg-config", "python3-dev", "python3-venv"}
    assert set(listed.split()) - compiled - {"libgirepository1.0-dev", "libcairo2-dev"} <= final
    assert not (compiled & final)
    assert {"libgirepository-1.0-1", "libcairo2"} <= final


def test_what_the_image_does_not_get_is_what_git_ignores() -> None:
    """No tracked file is left out: the program in the image would state its commit as changed."""
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    rules = [line for line in ignored if line and not line.startswith("#")]
    by_git = {line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()}
    assert {rule.removeprefix("**/").removeprefix("!") for rule in rules} <= {
        rule.lstrip("!") for rule in by_git
    }


def builder() -> str | None:
    """Name of a program here that builds images and answers; None if there is none."""
    for name in ("podman", "docker"):
        if shutil.which(name):
            answers = subprocess.run([name, "info"], capture_output=True, timeout=60, check=False)
            if answers.returncode == 0 and b"Cannot connect" not in answers.stdout + answers.stderr:
                return name
    return None


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", sorted(COMMAND))
def test_the_image_is_built_and_runs(name: str, tmp_path: Path) -> None:
    tool = builder()
    if tool is None:
        pytest.skip("no podman, and no docker that answers")
    image = f"percuss-{name}"
    file = f"containers/{name}.Containerfile"
    subprocess.run([tool, "build", "-f", file, "-t", image, "."], cwd=ROOT, check=True)
    shown = subprocess.run(
        [tool, "run", "--rm", image, "--version"], capture_output=True, text=True, check=True
    )
    assert re.match(rf"{COMMAND[name]} \(Percuss\) \S+, commit [0-9a-f]{{12}}", shown.stdout)
    shutil.copy(ROOT / "recordings" / "sample-1.0.mcap", tmp_path)
    work = {
        "analysis": ["estimate", "sample-1.0.mcap"],
        "rig": ["demo", "--strikes", "3", "-o", "demo.mcap"],
    }[name]
    subprocess.run([tool, "run", "--rm", "-v", f"{tmp_path}:/data", image, *work], check=True)
