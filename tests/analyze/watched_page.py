"""A page in a browser, with all problems that occur on it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import cv2
import numpy as np

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

DESKTOP = (1280, 900)
PHONE = (390, 844)
A4_PX = (703, 1032)
"""width and height of a printed page within margins of 12 mm [px], at CSS's 96 px per inch"""
A4_CARDS_PX = (1062, 733)
"""width and height of a printed card, landscape within margins of 8 mm [px]"""
HERE = ("file:", "data:")
PATIENCE_MS = 60_000
LEAST_INK = 0.004
"""least share of a plot's pixels that must differ from its background"""
LEAST_CONTRAST = 4.5
"""contrast of text against the page that WCAG 2 asks for (level AA)"""
PLOT_FONT = 7.0
"""smallest font [pt] of matplotlib's plots, whose labels are outlines"""
LEAST_FONT_PX = 7.0
"""size [px] below which a label of a plot is illegible"""

OVERFLOWING = """(scrolls) => [...document.querySelectorAll('main *:not(svg *)')].filter(each => {
    const box = each.getBoundingClientRect();
    const beyond = box.width > 0 && box.right > document.documentElement.clientWidth + 1;
    return beyond && !each.closest(scrolls ? '.scroll, .views' : '.plate, details:not([open])');
}).map(each => `${each.tagName} ${each.className.baseVal ?? each.className} reaches ` +
    `${Math.round(each.getBoundingClientRect().right)}`)"""
TEXTS = """
    const APART = 'svg, style, script, math, .toc, .sidebar-drawer, .toc-drawer, .skip-to-content, ' +
        '.visually-hidden, details:not([open])';
    const texts = [];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        if (!node.data.trim() || node.parentElement.closest(APART)) continue;
        const range = document.createRange();
        range.selectNodeContents(node);
        for (const box of range.getClientRects())
            if (box.width > 0) texts.push({node, box, text: node.data.trim().slice(0, 40)});
    }
    const labels = plot => [...plot.querySelectorAll('g[id^=text_], text')]
        .map(each => ({each, name: each.id || each.textContent, box: each.getBoundingClientRect()}))
        .filter(({box}) => box.width > 0);
    const overlap = (a, b, slack) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > slack &&
        Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > slack;
"""
OVERLAPPING = f"""() => {{{TEXTS}
    const found = [];
    texts.forEach((a, i) => texts.slice(i + 1).forEach(b => {{
        if (a.node !== b.node && overlap(a.box, b.box, 4)) found.push(`${{a.text}} / ${{b.text}}`);
    }}));
    return found;
}}"""
OVERLAPPING_LABELS = f"""(plots) => {{{TEXTS}
    return [...document.querySelectorAll(plots)].flatMap(plot => labels(plot).flatMap(({{name, box}}, i) =>
        labels(plot).slice(i + 1).filter(other => overlap(box, other.box, 1))
            .map(other => `${{name}} / ${{other.name}}`)));
}}"""
CUT_TEXT = f"""() => {{{TEXTS}
    const beyond = (box, frame) => box.left < frame.left - 1 || box.right > frame.right + 1 ||
        box.top < frame.top - 3 || box.bottom > frame.bottom + 3;
    const clips = each => /hidden|clip|auto|scroll/.test(getComputedStyle(each).overflow);
    const found = texts.filter(({{node, box}}) => {{
        for (let each = node.parentElement; each && each !== document.body; each = each.parentElement)
            if (clips(each) && beyond(box, each.getBoundingClientRect())) return true;
        return box.left < -1 || box.right > document.documentElement.clientWidth + 1;
    }}).map(({{text}}) => text);
    return found.concat([...document.querySelectorAll('svg')].flatMap(plot => labels(plot)
        .filter(({{box}}) => beyond(box, plot.getBoundingClientRect())).map(({{name}}) => name)));
}}"""
SMALL_LABELS = f"""([smallest, least]) => {{{TEXTS}
    return [...document.querySelectorAll('svg')].flatMap(plot => {{
        const scale = plot.getBoundingClientRect().width / plot.viewBox.baseVal.width;
        return labels(plot).map(({{each, name}}) => ({{
            name, size: scale * (parseFloat(each.getAttribute('font-size')) || smallest),
        }})).filter(({{size}}) => size < least).map(({{name, size}}) => `${{name}}: ${{size.toFixed(1)}} px`);
    }});
}}"""
BROKEN_NUMBERS = f"""() => {{{TEXTS}
    return [...new Set(texts.map(({{node}}) => node))].flatMap(node => {{
        const found = [];
        for (const each of node.data.matchAll(/[0-9.]+\\s*±\\s*[0-9.]+/g)) {{
            const range = document.createRange();
            range.setStart(node, each.index);
            range.setEnd(node, each.index + each[0].length);
            const tops = [...range.getClientRects()].filter(box => box.width > 0).map(box => box.top);
            if (Math.max(...tops) - Math.min(...tops) > 4) found.push(each[0].replace(/\\s+/g, ' '));
        }}
        return found;
    }});
}}"""
DRAWN_OUTSIDE = """() => [...document.querySelectorAll('svg[viewBox]')].flatMap(plot => {
    const frame = plot.viewBox.baseVal, box = plot.getBoundingClientRect(), corner = plot.getScreenCTM();
    if (!corner || !box.width) return [];
    const left = corner.e + frame.x * corner.a, top = corner.f + frame.y * corner.d;
    const right = left + frame.width * corner.a, bottom = top + frame.height * corner.d;
    const spare = box.width > right - left + 4 || box.height > bottom - top + 4;
    return !spare ? [] : [...plot.querySelectorAll('path, polygon, rect, line')].filter(each => {
        const drawn = each.getBoundingClientRect();
        const beyond = drawn.left < left - 4 || drawn.right > right + 4 ||
            drawn.top < top - 4 || drawn.bottom > bottom + 4;
        return beyond && !each.closest('[clip-path], defs');
    }).slice(0, 1).map(each => `${each.tagName} of ${plot.getAttribute('aria-label') || 'a plot'}`);
})"""
CONTRASTS = f"""() => {{{TEXTS}
    const parts = colour => (colour.match(/[0-9.]+/g) || []).map(Number);
    const light = colour => parts(colour).slice(0, 3).map(v => v / 255)
        .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const ground = element => {{
        for (let each = element; each; each = each.parentElement) {{
            const colour = getComputedStyle(each).backgroundColor;
            if ((parts(colour)[3] ?? 1) > 0.5) return colour;
        }}
        return 'rgb(255, 255, 255)';
    }};
    return texts.filter(({{node}}) => !node.parentElement.closest('.symbol')).map(({{node, text}}) => {{
        const [a, b] = [getComputedStyle(node.parentElement).color, ground(node.parentElement)].map(light);
        return [text, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)];
    }});
}}"""
PLOTS = """() => [...document.querySelectorAll('main svg, main img, canvas')].map(each => {
    const box = each.getBoundingClientRect();
    return {x: box.x + scrollX, y: box.y + scrollY, width: box.width, height: box.height,
            missing: each.tagName === 'IMG' && !(each.complete && each.naturalWidth > 0)};
})"""


@dataclass
class WatchedPage:
    """A page with its problems so far: console errors, exceptions, requests that failed or left the disk."""

    page: Page
    problems: list[str] = field(default_factory=list)

    def overflowing(self, scrolls: bool = True) -> list[str]:
        """Elements that reach beyond the page's right edge, in words.

        With `scrolls`, those within a part that scrolls by itself do not count.
        """
        return self.page.evaluate(OVERFLOWING, scrolls)

    def faults(self, least_font: float = LEAST_FONT_PX) -> list[str]:
        """All that keeps the page from being read as it is shown, in words; empty for a page without fault.

        These are elements beyond the right edge (large figures, of the class `plate`, may scroll), cut and
        overlapping texts, labels of plots that are cut, cover each other or are smaller than `least_font`
        [px], values whose interval is on another line, shapes beyond the edges of their plot, faint texts,
        empty plots, and `problems`.
        """
        faint = {text for text, contrast in self.contrasts() if contrast < LEAST_CONTRAST}
        return [
            *(f"overflows: {each}" for each in self.overflowing(scrolls=False)),
            *(f"cut: {each}" for each in self.cut_text()),
            *(f"overlap: {each}" for each in self.overlapping()),
            *(f"labels overlap: {each}" for each in self.overlapping_labels("svg")),
            *(f"small: {each}" for each in self.page.evaluate(SMALL_LABELS, [PLOT_FONT, least_font])),
            *(f"broken: {each}" for each in self.page.evaluate(BROKEN_NUMBERS)),
            *(f"drawn outside: {each}" for each in self.page.evaluate(DRAWN_OUTSIDE)),
            *(f"faint: {each}" for each in sorted(faint)),
            *(f"empty: {each}" for each in self.empty_plots()),
            *self.problems,
        ]

    def cut_text(self) -> list[str]:
        """Texts and labels of plots that reach out of what shows them, be it page, box or plot."""
        return self.page.evaluate(CUT_TEXT)

    def overlapping(self) -> list[str]:
        """Pairs of texts outside plots that cover each other, as "first / second"."""
        return self.page.evaluate(OVERLAPPING)

    def overlapping_labels(self, plots: str) -> list[str]:
        """Pairs of labels within one plot that cover each other; `plots` is a CSS selector of plots."""
        return self.page.evaluate(OVERLAPPING_LABELS, plots)

    def contrasts(self) -> list[tuple[str, float]]:
        """Each text outside plots with its contrast with the background, by WCAG 2: from 1 to 21."""
        return self.page.evaluate(CONTRASTS)

    def picture(self) -> np.ndarray:
        """Screenshot of the visible part of the page, (height, width, 3) uint8."""
        return cv2.imdecode(np.frombuffer(self.page.screenshot(), dtype=np.uint8), cv2.IMREAD_COLOR)

    def plots(self) -> int:
        """Number of plots on the page."""
        return len(self.page.evaluate(PLOTS))

    def empty_plots(self) -> list[str]:
        """Plots in which nothing is drawn, in words: their number and place on the page."""
        boxes = self.page.evaluate(PLOTS)
        picture = cv2.imdecode(
            np.frombuffer(self.page.screenshot(full_page=True), dtype=np.uint8), cv2.IMREAD_COLOR
        )
        found = []
        for number, box in enumerate(boxes, 1):
            left, top, right, bottom = (
                int(v) for v in (box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"])
            )
            if left >= picture.shape[1]:
                continue  # in a part that scrolls by itself, or found by `overflowing`
            part = picture[max(top, 0) : bottom, max(left, 0) : right]
            if box["missing"] or part.size == 0 or ink(part) < LEAST_INK:
                found.append(
                    f"plot {number} of {len(boxes)} at {left}, {top}: {right - left} x {bottom - top} px"
                )
        return found


def ink(picture: np.ndarray) -> float:
    """Share of pixels (height, width, 3) that differ from the commonest colour."""
    flat = picture.reshape(-1, 3).astype(np.int64) @ [1, 256, 65536]
    return 1 - np.bincount(np.unique(flat, return_inverse=True)[1]).max() / len(flat)


@contextmanager
def watched(browser: Browser, size: tuple[int, int] = DESKTOP) -> Iterator[WatchedPage]:
    """Context with a new page of the browser for local files; requests to other places are problems."""
    with _page(browser, size) as found:
        found.page.on(
            "console",
            lambda message: (
                found.problems.append(f"console: {message.text}")
                if message.type in {"error", "warning"}
                else None
            ),
        )
        found.page.on(
            "request",
            lambda asked: (
                None if asked.url.startswith(HERE) else found.problems.append(f"asked for {asked.url}")
            ),
        )
        yield found


@contextmanager
def watched_viewer(browser: Browser, size: tuple[int, int], elsewhere: set[str]) -> Iterator[WatchedPage]:
    """Context with a new page for rerun's web viewer, of whose thousands of lines only errors are kept.

    Its requests to hosts elsewhere are blocked, and the hosts added to `elsewhere`.
    """

    def shut(route: Route) -> None:
        elsewhere.add(urlsplit(route.request.url).netloc)
        route.fulfill(status=204, headers={"access-control-allow-origin": "*"})

    with _page(browser, size) as found:
        found.page.context.route(lambda url: not url.startswith((*HERE, "blob:", "http://127.0.0.1:")), shut)
        # The browser does not take a built-in function.
        found.page.expose_function("problem", lambda text: found.problems.append(text))  # noqa: PLW0108
        found.page.add_init_script(
            "console.debug = console.info = console.log = () => {};"
            "console.error = (...text) => problem(`console: ${text}`)"
        )
        yield found


@contextmanager
def _page(browser: Browser, size: tuple[int, int]) -> Iterator[WatchedPage]:
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    context.set_default_timeout(PATIENCE_MS)
    found = WatchedPage(context.new_page())
    found.page.on("pageerror", lambda error: found.problems.append(f"exception: {error}"))
    found.page.on(
        "requestfailed", lambda request: found.problems.append(f"failed: {request.url}: {request.failure}")
    )
    found.page.on(
        "response",
        lambda answer: (
            found.problems.append(f"{answer.status}: {answer.url}") if answer.status >= 400 else None
        ),
    )
    try:
        yield found
    finally:
        context.close()
