"""What code cites of the documentation exists: pages by path, sections of the method by number."""

from __future__ import annotations

import re
import subprocess

from tests.places import ROOT

PAGE = re.compile(r"\bdocs/[\w./-]+\.(?:md|toml|service|ipynb|svg|png)\b")
SECTION = re.compile(r"(?:method\.md, sections?|\bmethod) (\d+(?:\.\d+)?)(?: and (\d+(?:\.\d+)?))?")
HEADING = re.compile(r"^#{2,3} (\d+(?:\.\d+)?) ", re.MULTILINE)


def sources() -> dict[str, str]:
    """Text of every file that may cite the documentation, by path."""
    patterns = ("*.py", "*.toml", "*.html", "Makefile", "*.service", "*.ipynb")
    listed = subprocess.run(
        ["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True, check=True
    )
    paths = [path for path in listed.stdout.splitlines() if (ROOT / path).exists()]
    return {path: (ROOT / path).read_text(encoding="utf-8") for path in paths}


def test_cited_pages_exist():
    cited = [(path, page) for path, text in sources().items() for page in PAGE.findall(text)]
    assert len(cited) > 20
    assert not [(path, page) for path, page in cited if not (ROOT / page).exists()]


def test_cited_sections_of_the_method_exist():
    sections = set(HEADING.findall((ROOT / "docs" / "explanation" / "method.md").read_text(encoding="utf-8")))
    cited = [
        (path, number)
        for path, text in sources().items()
        for found in SECTION.findall(text)
        for number in found
        if number
    ]
    assert cited
    assert not [(path, number) for path, number in cited if number not in sections]
