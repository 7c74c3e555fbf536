"""The console's static files: they obey the strict Content-Security-Policy and never insert HTML."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.acquire.console.web.pages.sample_console import STATIC

MAX_LINES = 400
SCRIPTS = sorted(STATIC.rglob("*.js"))
FILES = [path for path in sorted(STATIC.rglob("*")) if path.is_file()]
INSERTS_HTML = re.compile(
    r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|DOMParser|srcdoc|\beval\(|new Function"
)
OUTSIDE = re.compile(r"(?:https?:)?//[\w.-]+\.\w+")


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def _tags() -> list[tuple[str, dict[str, str | None]]]:
    parser = _Tags()
    parser.feed((STATIC / "index.html").read_text())
    return parser.tags


def _name(path: Path) -> str:
    return path.relative_to(STATIC).as_posix()


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_files_are_short_and_name_no_other_site(path):
    text = path.read_text()
    assert len(text.splitlines()) <= MAX_LINES
    assert not OUTSIDE.findall(text.replace("http://www.w3.org", ""))


@pytest.mark.parametrize("path", SCRIPTS, ids=_name)
def test_scripts_insert_text_only(path):
    assert not INSERTS_HTML.findall(path.read_text())


def test_page_has_no_inline_script_or_style():
    for tag, attributes in _tags():
        assert tag != "style"
        assert "style" not in attributes
        assert not [name for name in attributes if name.startswith("on")]
        if tag == "script":
            assert attributes["src"] == "/static/js/main.js"


def test_ids_are_unique_and_scripts_ask_only_for_ids_of_the_page():
    ids = [attributes["id"] for _, attributes in _tags() if "id" in attributes]
    assert len(ids) == len(set(ids))
    for path in SCRIPTS:
        assert set(re.findall(r'byId\("([\w-]+)"\)', path.read_text())) <= set(ids)


def test_labels_belong_to_fields():
    tags = _tags()
    ids = {attributes.get("id") for _, attributes in tags}
    for _, attributes in tags:
        for name in ("for", "aria-labelledby", "aria-describedby"):
            assert name not in attributes or attributes[name] in ids


def test_modules_import_files_that_exist():
    for path in SCRIPTS:
        for module in re.findall(r'from "([^"]+)"', path.read_text()):
            assert (path.parent / module).resolve() in SCRIPTS
