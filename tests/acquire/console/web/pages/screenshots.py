"""Screenshots of the console's pages: every state, at three widths, in light and dark.

Run as `python -m tests.acquire.console.web.pages.screenshots FOLDER [STATE ...]`.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from tests.acquire.console.web.pages.sample_console import SampleConsole, sample_console
from tests.acquire.console.web.pages.snapshots import states

SIZES = {390: 844, 820: 1180, 1280: 800, 1440: 900}
"""height of the window for each width [px]"""
SCHEMES = ("light", "dark")


def _lose(page: Page, server: SampleConsole) -> None:
    server.silent = True
    page.wait_for_selector("#link-lost:not([hidden])")


def _fail_stop(page: Page, server: SampleConsole) -> None:
    server.stop_fails = True
    page.keyboard.press("Escape")
    page.wait_for_selector("#stopped.alarm")


def _compare(page: Page, _: SampleConsole) -> None:
    page.locator("#archive-rows input").nth(0).check()
    page.locator("#archive-rows input").nth(1).check()


MOMENTS: dict[str, tuple[str, Callable[[Page, SampleConsole], object]]] = {
    "help": ("place", lambda page, _: page.keyboard.press("?")),
    "home": ("stopped", lambda page, _: page.click("#home")),
    "large-place": ("place", lambda page, _: page.keyboard.press("l")),
    "large-armed": ("armed", lambda page, _: page.keyboard.press("l")),
    "card": ("place", lambda page, _: page.click("#card-open")),
    "until": ("ready", lambda page, _: page.check("input[value=until]")),
    "lost": ("place", _lose),
    "stop-failed": ("armed", _fail_stop),
    "compare": ("archive", _compare),
}
"""states that the page reaches by an action: the state before, and the action"""


COUNT_SNAPSHOTS = """
    const parse = JSON.parse;
    globalThis.newestShown = 0;
    JSON.parse = (...text) => {
        const found = parse(...text);
        if (found?.shown) requestAnimationFrame(() => { globalThis.newestShown = found.shown; });
        return found;
    };
"""
"""script for a page before it is opened: keeps the number of the newest snapshot that it has drawn"""

AT_REST = """() => new Promise(resolve => {
    const loaded = () => [...document.images].every(each => !each.checkVisibility() || each.naturalWidth > 0);
    const ends = performance.now() + 1000;
    let changed = performance.now();
    const watch = new MutationObserver(() => { changed = performance.now(); });
    watch.observe(document, {subtree: true, childList: true, attributes: true, characterData: true});
    const look = () => {
        const now = performance.now();
        if (now > ends || (now - changed > 60 && loaded())) { watch.disconnect(); resolve(); }
        else requestAnimationFrame(look);
    };
    look();
})"""
"""promise that a page has not changed for 60 ms and shows its pictures, kept after a second in any case"""


def show_state(page: Page, server: SampleConsole, name: str, settle_ms: int = 0) -> None:
    """Open a page in a state and wait until it has drawn it, and for `settle_ms` more.

    The page must have `COUNT_SNAPSHOTS`.
    """
    before, act = MOMENTS.get(name, (name, None))
    view, steps = states()[before]
    server.silent = server.stop_fails = False
    server.show(steps[0])
    page.goto(server.url)
    page.wait_for_selector("#role:not([hidden])", state="attached")
    for step in steps[1:]:
        wait_until_drawn(page, server)
        server.show(step)
    wait_until_drawn(page, server)
    if page.locator(f"#view-{view}").is_hidden():
        page.click(f"nav [data-view={view}]")
    page.evaluate(AT_REST)
    page.wait_for_timeout(settle_ms)
    if act is not None:
        act(page, server)
        page.evaluate(AT_REST)
        page.wait_for_timeout(settle_ms)


def wait_until_drawn(page: Page, server: SampleConsole) -> None:
    """Wait until a page has drawn the newest snapshot."""
    page.wait_for_function("wanted => globalThis.newestShown === wanted", arg=server.shown)


def take(browser: Browser, server: SampleConsole, folder: Path, names: list[str]) -> None:
    """Write one PNG per state, width and colour scheme: as seen first, not the whole page."""
    for width, height in SIZES.items():
        for scheme in SCHEMES:
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            page.add_init_script(COUNT_SNAPSHOTS)
            for name in names:
                show_state(page, server, name, settle_ms=600)
                page.screenshot(path=folder / f"{name}-{width}-{scheme}.png")
                if width < max(SIZES):
                    tall = page.evaluate("document.documentElement.scrollHeight")
                    page.set_viewport_size({"width": width, "height": max(height, min(tall, 4000))})
                    page.wait_for_timeout(150)
                    page.screenshot(path=folder / f"{name}-{width}-{scheme}-whole.png")
                    page.set_viewport_size({"width": width, "height": height})
            page.close()


def main(arguments: list[str]) -> None:
    """Take the screenshots that were asked for."""
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
    with sample_console() as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
        take(browser, server, folder, arguments[1:] or [*states(), *MOMENTS])
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
