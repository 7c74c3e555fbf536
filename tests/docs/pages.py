"""Pages of the documentation and their snippets, as the tests read them."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from tests.places import ROOT

DOCS = ROOT / "docs"
PROJECT_PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "recordings/README.md")
PAGES = sorted(DOCS.rglob("*.md")) + [ROOT / name for name in PROJECT_PAGES]
FENCE = re.compile(r"^ *```(\w*)[^\n]*\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


@cache
def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def snippets(page: Path, language: str) -> list[str]:
    return [body for kind, body in FENCE.findall(text_of(page)) if kind == language]
