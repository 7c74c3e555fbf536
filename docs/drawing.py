"""Draw the packages and their imports, read from the code, into docs/images/architecture.svg.

Layers are computed, so that a package lies above all that it imports. Where packages import each other, the
import with the fewest places in the code is drawn in red and counts for no layer. An import that follows from
others (transitive reduction) is left out; so are imports of `schemas`, which all packages use, and of the
modules beside a package's folders (`errors`, `types`).
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
TOPS = ("acquire", "analyze")
PURE = {
    "geometry",
    "least_squares",
    "planning",
    "tracking",
    "calibration",
    "motion",
    "registration",
    "estimation",
}
"""Packages of `analyze` without input, output, clock or chance, as tests/test_architecture.py requires."""
NODE_WIDTH, NODE_HEIGHT, GAP_X, GAP_Y = 112, 34, 16, 62
LONGEST_ROW = 7
Graph = dict[str, dict[str, int]]
"""Package to the packages that it imports, each with the number of importing places."""


def module_files(top: str) -> list[Path]:
    """Python files of a package, generated ones left out."""
    return sorted(path for path in (ROOT / top).rglob("*.py") if "_pb2" not in path.name)


def imported_names(path: Path) -> set[str]:
    """Full dotted names that a file imports, inside functions as well."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def package_imports(top: str) -> Graph:
    """Graph of `top`: for each subpackage those that it imports, with the number of importing places."""
    graph: Graph = {path.parent.name: {} for path in sorted((ROOT / top).glob("*/__init__.py"))}
    for path in module_files(top):
        package = path.relative_to(ROOT / top).parts[0]
        for name in imported_names(path) if package in graph else ():
            parts = name.split(".")
            if parts[0] == top and len(parts) > 1 and parts[1] in graph and parts[1] != package:
                graph[package][parts[1]] = graph[package].get(parts[1], 0) + 1
    return graph


def reachable(graph: Graph, start: str) -> set[str]:
    """All packages that `start` imports, directly or through others."""
    found: set[str] = set()
    waiting = list(graph[start])
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += graph[name]
    return found


def without_cycles(graph: Graph) -> tuple[Graph, list[tuple[str, str]]]:
    """Graph without cycles, and the imports removed: of each cycle the one with the fewest places."""
    graph = {user: dict(used) for user, used in graph.items()}
    removed = []
    while True:
        below = {name: reachable(graph, name) for name in graph}
        cyclic = [
            (count, user, used)
            for user in graph
            for used, count in graph[user].items()
            if user in below[used]
        ]
        if not cyclic:
            return graph, removed
        _, user, used = min(cyclic)
        del graph[user][used]
        removed.append((user, used))


def layers(graph: Graph) -> list[list[str]]:
    """Packages of a graph without cycles by layer, lowest first, each above all that it imports."""
    level: dict[str, int] = {}

    def height(name: str) -> int:
        if name not in level:
            level[name] = 1 + max((height(used) for used in graph[name]), default=-1)
        return level[name]

    rows: list[list[str]] = [[] for _ in range(1 + max(map(height, graph)))]
    for name in graph:
        rows[level[name]].append(name)
    return [row[start : start + LONGEST_ROW] for row in rows for start in range(0, len(row), LONGEST_ROW)]


def reduced(graph: Graph) -> list[tuple[str, str]]:
    """Imports (importer, imported) that remain if each one implied by a chain of others is left out."""
    below = {name: reachable(graph, name) for name in graph}
    return sorted(
        (user, used)
        for user in graph
        for used in graph[user]
        if not any(used in below[other] for other in graph[user])
    )


def arranged(graph: Graph, width: float) -> dict[str, tuple[float, int]]:
    """Place (x of the middle, row) of every package; rows are ordered by the mean place of their imports."""
    place: dict[str, tuple[float, int]] = {}
    for number, row in enumerate(layers(graph)):
        known = {name: [place[used][0] for used in graph[name] if used in place] for name in row}
        row.sort(key=lambda name: (sum(known[name]) / len(known[name]) if known[name] else width / 2, name))
        step = width / len(row)
        place.update({name: ((index + 0.5) * step, number) for index, name in enumerate(row)})
    return place


def _panel(top: str, above: float, width: float) -> tuple[list[str], float]:
    """SVG elements of the panel of package `top`, whose upper edge is at `above`, and its height [px]."""
    graph, removed = without_cycles(package_imports(top))
    place = arranged(graph, width - 2 * GAP_X)
    height = len(layers(graph)) * (NODE_HEIGHT + GAP_Y) + 30
    parts = [
        f'<rect class="panel" x="20" y="{above}" width="{width}" height="{height}" rx="10"/>',
        f'<text class="top" x="38" y="{above + 32}">{top}</text>',
    ]

    def centre(name: str) -> tuple[float, float]:
        x, row = place[name]
        return 20 + GAP_X + x, above + height - 36 - row * (NODE_HEIGHT + GAP_Y)

    for kind, edges in (("edge", reduced(graph)), ("cycle", removed)):
        for user, used in edges:
            (x1, y1), (x2, y2) = centre(user), centre(used)
            side = NODE_HEIGHT / 2 if y2 > y1 else -NODE_HEIGHT / 2
            middle = (y1 + y2) / 2
            curve = f"C{x1:.0f} {middle:.0f} {x2:.0f} {middle:.0f} {x2:.0f} {y2 - side:.0f}"
            parts.append(f'<path class="{kind}" d="M{x1:.0f} {y1 + side:.0f}{curve}"/>')
    for name in sorted(graph):
        x, y = centre(name)
        kind = "pure" if top == "analyze" and name in PURE else "node"
        corner = f'x="{x - NODE_WIDTH / 2:.0f}" y="{y - NODE_HEIGHT / 2:.0f}"'
        parts += [
            f'<rect class="{kind}" {corner} width="{NODE_WIDTH}" height="{NODE_HEIGHT}" rx="6"/>',
            f'<text class="name" x="{x:.0f}" y="{y + 5:.0f}">{escape(name)}</text>',
        ]
    return parts, height


def svg() -> str:
    """SVG text of the drawing: panel of `analyze` above that of `acquire`, below them a bar `schemas`."""
    width = LONGEST_ROW * (NODE_WIDTH + GAP_X) + 2 * GAP_X
    total, above, elements = width + 40, 20.0, []
    for top in reversed(TOPS):
        parts, height = _panel(top, above, width)
        elements += parts
        above += height + 18
    bar_text = "schemas: recording format, documents, topics (used by all above)"
    elements += [
        f'<rect class="bar" x="20" y="{above}" width="{width}" height="44" rx="10"/>',
        f'<text class="name" x="{total / 2:.0f}" y="{above + 27}">{bar_text}</text>',
    ]
    style = (
        "text{font-family:'DejaVu Sans',Helvetica,Arial,sans-serif;fill:#1a1a1a}"
        ".top{font-size:20px;font-weight:bold}.name{font-size:14px;text-anchor:middle}"
        ".panel{fill:#f6f6f4;stroke:#d5d2cb}.bar{fill:#ece7db;stroke:#b9b1a0}"
        ".node{fill:#fff;stroke:#8d877b}.pure{fill:#dbe8f6;stroke:#1f5fa8}"
        ".edge{fill:none;stroke:#8d877b;stroke-width:1.2}.cycle{fill:none;stroke:#b3261e;stroke-width:1.6}"
    )
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total:.0f} {above + 64:.0f}" role="img">'
    title = "<title>Packages of acquire and analyze and what they import, computed from the code</title>"
    ground = f'<rect width="{total:.0f}" height="{above + 64:.0f}" fill="#fff"/>'
    return "\n".join([head, title, f"<style>{style}</style>", ground, *elements, "</svg>"]) + "\n"


def escaped(text: str) -> str:
    """Text escaped so that a cell of a Markdown table shows it unchanged; code spans stay code."""
    spans = re.split(r"(`[^`]*`)", text)
    return "".join(
        one.replace("|", "\\|") if one[:1] == "`" else re.sub(r"[\\|<*_$[]", r"\\\g<0>", one) for one in spans
    )


def module_tables() -> str:
    """Markdown: a heading and a table per package, a row per module with the first line of its docstring."""
    found: dict[str, list[str]] = defaultdict(list)
    for top in ("schemas", *TOPS):
        for path in module_files(top):
            document = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            line = (
                document.split("\n")[0]
                .replace("|", "\\|")
                .replace("<", "&lt;")
                .replace("*", "\\*")
                .replace("$", "\\$")
            )
            package = path.parent.relative_to(ROOT).as_posix()
            if path.name == "__init__.py":
                found[package].insert(0, line)
            else:
                found[package].append(f"| `{path.name}` | {line} |")
    parts = []
    for package, lines in sorted(found.items()):
        text, rows = (lines[0], lines[1:]) if not lines[0].startswith("|") else ("", lines)
        parts.append(
            f"## {package}\n\n{text}\n" + ("\n| | |\n|---|---|\n" + "\n".join(rows) + "\n" if rows else "")
        )
    return "\n".join(parts)


def main() -> None:
    """Write the drawing as an SVG file to `PICTURE`."""
    PICTURE.write_text(svg(), encoding="utf-8")


if __name__ == "__main__":
    main()
