"""Messages count in the singular and the plural, and all by one function."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from schemas.wording import counted
from tests.source_tree import nodes_of

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [path for name in ("acquire", "analyze", "schemas") for path in (ROOT / name).rglob("*.py")]
UNCOUNTED = ("analyze/motion/", "analyze/estimation/", "analyze/geometry/")
"""folders of computations, whose few messages with numbers name the several that are too few or too many"""
THINGS = re.compile(
    r" (?:more |good |damaged |planned |usable |flat |open )?("
    r"strikes|frames|images|views|tags|markers|messages|recordings|sessions|rows|"
    r"pages|samples|topics|attachments|chunks|edges|falls|cells|files|faces(?! the)|corners|"
    r"sources|axes|tips|records)\b"
)


@pytest.mark.parametrize(
    ("number", "words", "text"),
    [
        (1, ("strike",), "1 strike"),
        (0, ("strike",), "0 strikes"),
        (2, ("axis",), "2 axes"),
        (3, ("body",), "3 bodies"),
        (2, ("damaged record", "was"), "2 damaged records were"),
        (1, ("frame", "is"), "1 frame is"),
        (4, ("key",), "4 keys"),
        (2, ("view", "fits"), "2 views fit"),
        (2, ("strike", "so far gives"), "2 strikes so far give"),
        (5, ("batch", "has"), "5 batches have"),
    ],
)
def test_noun_and_verb_follow_the_number(number: int, words: tuple[str, ...], text: str) -> None:
    assert counted(number, *words) == text


def _uncounted(path: Path) -> list[str]:
    """Places of texts such as f"{number} strikes", which would read "1 strikes"."""
    found = []
    for node in nodes_of(path):
        if not isinstance(node, ast.JoinedStr):
            continue
        for value, text in zip(node.values, node.values[1:], strict=False):
            if (
                isinstance(value, ast.FormattedValue)
                and value.format_spec is None
                and not (isinstance(value.value, ast.Name) and value.value.id.isupper())
                and isinstance(text, ast.Constant)
                and (match := THINGS.match(str(text.value)))
            ):
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(value.value)}{match[0]}")
    return found


def test_every_message_counts_with_the_one_function() -> None:
    checked = [path for path in SOURCES if not path.relative_to(ROOT).as_posix().startswith(UNCOUNTED)]
    found = [place for path in checked for place in _uncounted(path)]
    assert not found, "\n".join(found)


def test_every_page_counts_with_the_one_function() -> None:
    pages = [path for path in ROOT.glob("analyze/**/*.html") if "templates" in path.parts]
    assert len(pages) > 3
    for path in pages:
        text = path.read_text(encoding="utf-8")
        found = re.findall(r"\{\{[^}]*\}\}" + THINGS.pattern, text)
        assert not found or path.name in {"comparison.html", "report.html"}, (path, found)
