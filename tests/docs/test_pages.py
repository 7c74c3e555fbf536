"""Every page, unbuilt: links and anchors lead somewhere, commands exist, snippets are valid."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import click
import pytest

from acquire.virtual.given_truth import GivenTruth
from schemas.object_spec import ObjectSpec
from schemas.quantity import RENAMED, RenamedDocument
from schemas.rig import RigConfig
from tests.docs.pages import DOCS, FENCE, PAGES, snippets, text_of
from tests.places import ROOT

LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)|^```\{(?:image|figure|include)\} (\S+)$", re.MULTILINE)
SPAN = re.compile(r"`((?:analyze|acquire|make) [^`]+)`")
HEADING = re.compile(r"^#{1,6} (.+)$", re.MULTILINE)
TARGET = re.compile(r"^\(([\w-]+)\)=$", re.MULTILINE)
ids = [page.relative_to(ROOT).as_posix() for page in PAGES]


def prose_of(page: Path) -> str:
    """A page without its fenced code."""
    return FENCE.sub(lambda fence: fence[0] if "{" in fence[0].split("\n")[0] else "", text_of(page))


@cache
def anchors_of(page: Path) -> set[str]:
    """Anchors of a page: those that GitHub and MyST make from its headings, and those it sets itself."""
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in HEADING.findall(prose_of(page))]
    slugs = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in plain}
    return slugs | set(TARGET.findall(text_of(page)))


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_to_files_and_headings_that_exist(page: Path):
    wrong = []
    for address, image in LINK.findall(prose_of(page)):
        path, _, anchor = (address or image).partition("#")
        if re.match(r"\w+:", path):
            continue
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            wrong.append(f"{address or image}: no such file")
        elif anchor and file.suffix == ".md" and anchor not in anchors_of(file):
            wrong.append(f"{address}: no such heading in {file.name}")
    assert not wrong


@cache
def commands() -> dict[str, click.Command]:
    sys.path.insert(0, str(DOCS))
    try:
        import command_tables
    finally:
        sys.path.remove(str(DOCS))
    return dict(command_tables.commands())


def unknown_parts(line: str) -> list[str]:
    """Complaints about a line of `analyze` or `acquire` whose verb or options do not exist."""
    try:
        words = shlex.split(line, comments=True)
    except ValueError:
        return [f"not to be parsed: {line}"]
    if len(words) < 2 or words[0] not in {"analyze", "acquire"}:
        return []
    name = next((" ".join(words[:n]) for n in (3, 2) if " ".join(words[:n]) in commands()), None)
    if name is None:
        group = " ".join(words[:2])
        known = group.startswith("--") or any(full.startswith(group + " ") for full in commands())
        return [] if known or words[1].startswith("-") else [f"no such command: {line}"]
    known_options = {"--help", "-h"}
    for parameter in commands()[name].params:
        known_options |= set(parameter.opts) | set(parameter.secondary_opts)
    options = [word.split("=")[0] for word in words[2:] if re.match(r"--?[a-z]", word)]
    return [f"{name} has no {option}" for option in options if option not in known_options]


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_commands_and_their_options_exist(page: Path):
    lines = [line.strip() for body in snippets(page, "sh") for line in body.replace("\\\n", " ").splitlines()]
    spans = [span.replace("\\|", "|").split(" ...")[0] for span in SPAN.findall(prose_of(page))]
    assert not [part for line in lines + spans for part in unknown_parts(line)]


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_shell_snippets_are_valid_and_make_targets_exist(page: Path):
    targets = set(re.findall(r"^([a-z][\w-]*):", text_of(ROOT / "Makefile"), re.MULTILINE))
    for body in snippets(page, "sh"):
        checked = subprocess.run(["bash", "-n"], input=body, text=True, capture_output=True, check=False)
        assert checked.returncode == 0, checked.stderr
    lines = "\n".join(snippets(page, "sh") + re.findall(r"`make [^`]*`", prose_of(page)))
    named = re.findall(r"(?:^|`)make ([a-z][\w-]*)(?=[`\s])", lines, re.MULTILINE)
    assert set(named) <= targets


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_toml_and_python_snippets_are_valid(page: Path):
    for body in snippets(page, "python"):
        ast.parse(body)
    for body in snippets(page, "toml"):
        found = tomllib.loads(body)
        if "camera" in found:
            RigConfig.model_validate(found)
        elif "shape" in found:
            ObjectSpec.model_validate(found)
        elif "truth" in found:
            GivenTruth.model_validate(found["truth"])
        else:
            assert set(found) <= set(ObjectSpec.model_fields) | set(RigConfig.model_fields) | {"marker"}


def test_the_snippets_for_python_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for folder in ("recordings", "docs"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    for body in snippets(DOCS / "how-to" / "python.md", "python"):
        exec(compile(body, "python.md", "exec"), {})
    assert {path.name for path in tmp_path.glob("*.*")} >= {"report.html", "carton.urdf", "plan.json"}


def test_every_page_is_in_a_table_of_contents():
    listed = {DOCS / "index.md"}
    for page in sorted(DOCS.rglob("index.md")):
        for body in re.findall(r"^```\{toctree\}\n(.*?)^```$", text_of(page), re.MULTILINE | re.DOTALL):
            for name in (line for line in body.splitlines() if line and not line.startswith(":")):
                listed |= set(page.parent.glob(f"{name}.md"))
    assert not set(DOCS.rglob("*.md")) - listed


def test_the_drawing_of_the_packages_is_that_of_the_code():
    sys.path.insert(0, str(DOCS))
    try:
        import drawing
    finally:
        sys.path.remove(str(DOCS))
    assert drawing.PICTURE.read_text(encoding="utf-8") == drawing.svg(), "run `make docs`: an import changed"


def test_pages_are_wrapped():
    """Only lines with a table, link, code span or picture, which cannot be broken, may be longer."""
    unbreakable = re.compile(r"\s*\||:alt:|.*\]\(|.*`|.*\\")
    long = [
        f"{page.relative_to(ROOT)}: {line}"
        for page in PAGES
        if "decisions" not in page.parts
        for line in prose_of(page).splitlines()
        if len(line) > 110 and not unbreakable.match(line)
    ]
    assert not long


def renamed_documents(base: type[RenamedDocument] = RenamedDocument) -> list[type[RenamedDocument]]:
    return [base, *(one for direct in base.__subclasses__() for one in renamed_documents(direct))]


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_tables_begin_with_a_head(page: Path):
    blocks = re.findall(r"(?m)(?:^\|.*\n?)+", prose_of(page))
    assert not [block[:80] for block in blocks if not re.match(r"\|.*\n\|[ :|-]+\n", block)]


def test_the_table_of_renamed_keys_names_every_document_that_has_some():
    importlib.import_module("schemas.result")  # it defines the documents
    page = text_of(DOCS / "reference" / "renamed-keys.md")
    assert "../../schemas/renamed_keys.csv" in page
    documents = {document.__name__ for document in renamed_documents()} - {RenamedDocument.__name__}
    assert documents == set(RENAMED) - {"RegionName", "WarningCode"}
