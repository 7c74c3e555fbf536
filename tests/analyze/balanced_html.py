"""Check that the tags of an HTML page are balanced."""

from __future__ import annotations

from html.parser import HTMLParser


class Balanced(HTMLParser):
    """HTML parser that fails where a tag closes that was not the last to open.

    `open` lists the tags that were never closed.
    """

    VOID = frozenset({"meta", "br", "img", "path", "circle", "rect", "use"})

    def __init__(self):
        super().__init__()
        self.open, self.tags = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag
