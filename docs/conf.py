"""Configuration of the documentation site: Sphinx, MyST Markdown, the Furo theme; readable from disk.

Build with `make docs`. The choice of tools is docs/decisions/0029-documentation-site.md.
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

import command_tables  # noqa: E402 - these two stand beside this file
import drawing  # noqa: E402

project = "Percuss"
author = "the Percuss authors"
project_copyright = f"2026 {author}"
version = release = installed_version("percuss")
language = "en"

extensions = ["mathml", "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["decisions/TEMPLATE.md"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autoclass_content = "class"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
python_maximum_signature_line_length = 88
# Docstrings write code in single backticks, as Markdown does.
default_role = "code"
# Two classes may have a field of one name; which one a type means is not asked.
suppress_warnings = ["ref.python"]
# Quotation marks of equations and commands stay as they are.
smartquotes = False

html_theme = "furo"
html_title = "Percuss"
html_static_path = ["_static"]
html_css_files = ["percuss.css"]
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#1f5fa8",
        "color-brand-content": "#1f5fa8",
        "font-stack": "system-ui, -apple-system, 'Segoe UI', 'Noto Sans', 'DejaVu Sans', sans-serif",
        "font-stack--monospace": "ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace",
    },
    "dark_css_variables": {"color-brand-primary": "#8ab8f0", "color-brand-content": "#8ab8f0"},
}

MARKUP_OF_RST = re.compile(r"(``.*?``|`[^`]*`)|([|*_\\])")


def _is_text(line: str) -> bool:
    """True if `line` is unindented text: not empty, and no field, directive or list item."""
    return bool(line) and not line.startswith((" ", ":", "..", "- ", "* "))


def _plain_docstring(
    _app: Any, _kind: str, _name: str, _object: Any, _options: Any, lines: list[str]
) -> None:
    """Rewrite the lines of a docstring, in place, as reStructuredText that shows them as they stand.

    Lines indented by four spaces below a paragraph become a literal block (code or an equation). Characters
    that reStructuredText would take for markup, as in |theta'|, *.mcap and name_, are escaped.
    """
    found: list[str] = []
    paragraph, code = "", False
    for line in lines:
        if code and line and not line.startswith("    "):
            code = False
        elif not code and line.startswith("    ") and _is_text(paragraph) and found[-1] == "":
            found += [] if paragraph.endswith("::") else ["::", ""]
            code = True
        if line:
            paragraph = line
        markup = line.lstrip().startswith((":", "..")) or code
        found.append(line if markup else MARKUP_OF_RST.sub(lambda one: one[1] or "\\" + one[2], line))
    lines[:] = found


def _keep_colons(_app: Any, kind: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Keep the words before a colon in an attribute's first line, which Napoleon would take for a type."""
    if kind in {"attribute", "data", "property"}:
        lines[:0] = ["..", ""]  # an empty comment: Napoleon skips leading empty lines


GENERATED = {
    "reference/modules": ("<!-- modules -->", drawing.module_tables),
    "reference/commands": ("<!-- options -->", command_tables.option_tables),
}
"""Page to the mark that its generated part replaces."""


def _generated_tables(_app: Any, name: str, source: list[str]) -> None:
    """Insert the tables of modules and of command options, made from the code, into their two pages."""
    if name in GENERATED:
        mark, tables = GENERATED[name]
        source[0] = source[0].replace(mark, tables())


def setup(app: Any) -> None:
    """Connect this file's three hooks to Sphinx; `_keep_colons` runs before Napoleon (priority 500)."""
    app.connect("autodoc-process-docstring", _keep_colons, priority=400)
    app.connect("autodoc-process-docstring", _plain_docstring)
    app.connect("source-read", _generated_tables)
