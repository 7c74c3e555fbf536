"""Check that a built site loads nothing from another host; links to be clicked may lead anywhere.

Usage: `python docs/offline.py site`
"""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

LOADED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "audio": "src",
    "embed": "src",
    "object": "data",
}
LOADED_LINKS = {"stylesheet", "preload", "preconnect", "dns-prefetch", "icon", "modulepreload", "prefetch"}
ELSEWHERE = re.compile(r"^(https?:)?//")
CSS_ELSEWHERE = re.compile(r"""(?:@import\s+|url\()\s*["']?((?:https?:)?//[^"')\s]+)""")


class _Loads(HTMLParser):
    """Parser that collects in `found` the addresses that a browser fetches to show an HTML page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Add the address of an element that a browser loads without a click, such as an image."""
        values = {name: value or "" for name, value in attrs}
        if tag == "link" and LOADED_LINKS & set(values.get("rel", "").split()):
            self.found.append(values.get("href", ""))
        elif tag in LOADED:
            self.found.append(values.get(LOADED[tag], ""))


def loads_from_elsewhere(site: Path) -> list[str]:
    """Lines "file: address" for everything that a page or style sheet of a site loads from other hosts."""
    problems = []
    for page in sorted(site.rglob("*.html")):
        parser = _Loads()
        parser.feed(page.read_text(encoding="utf-8"))
        problems += [
            f"{page.relative_to(site)}: {address}" for address in parser.found if ELSEWHERE.match(address)
        ]
    for sheet in sorted(site.rglob("*.css")):
        found = CSS_ELSEWHERE.findall(sheet.read_text(encoding="utf-8"))
        problems += [f"{sheet.relative_to(site)}: {address}" for address in found]
    return problems


def main() -> int:
    """Print what the site loads from other hosts; return 1 if it loads anything from there, else 0."""
    problems = loads_from_elsewhere(Path(sys.argv[1]))
    print("\n".join(problems), file=sys.stderr, end="\n" if problems else "")
    return int(bool(problems))


if __name__ == "__main__":
    raise SystemExit(main())
