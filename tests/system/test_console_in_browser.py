"""The operator's page in Chromium on the virtual rig: a session by its main button alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

from tests.system.test_console import Bench, bench, is_over

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

    from acquire.console.web.snapshot import Snapshot

__all__ = ["bench"]
pytestmark = pytest.mark.timeout(900)
SESSION_S = 500.0
"""time after which a session counts as hung [s]: three strikes take 60 s on two idle cores"""


def wait(page: Page, done: Callable[[], bool], timeout_s: float = 60.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < end_s, page.locator("body").inner_text()
        page.wait_for_timeout(100)


def press_main(page: Page, label: str, timeout_s: float = 60.0) -> None:
    """Press Enter, the key of the main button, once that button offers what is wanted."""
    action = page.locator("#action")
    shown = page.locator("#action-label")
    wait(page, lambda: action.is_enabled() and label in shown.inner_text(), timeout_s)
    page.keyboard.press("Enter")


@pytest.fixture
def page(chromium: Browser, bench: Bench) -> Iterator[Page]:
    """Page of a console on a cold rig."""
    console = bench.start_console()
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda line: problems.append(line.text) if "Content Security" in line.text else None)
    page.goto(bench.addresses[console.pid])
    yield page
    assert not problems


def start_session(page: Page, bench: Bench, *, until: bool = False) -> None:
    """Start rig, check and session by the main button; `until`: with a target."""
    press_main(page, "Start the rig")
    wait(page, lambda: page.locator("#no-daemon").is_hidden())
    press_main(page, "Check")
    wait(page, lambda: "Start" in page.locator("#action-label").inner_text(), 90.0)
    with bench.client() as looks_on:
        wait(page, lambda: looks_on.state().check.passed is not None, 90.0)
    wait(page, lambda: page.locator("#check").is_enabled(), 60.0)
    if page.locator("#override-field").is_visible():  # a busy computer loses frames
        page.locator("#override").fill("a test on a busy computer")
    if until:
        page.check("input[value=until]")
    page.evaluate("document.activeElement.blur()")
    press_main(page, "Start")
    with bench.client() as looks_on:
        wait(page, lambda: looks_on.state().session is not None, 90.0)


def place_until(page: Page, bench: Bench, done: Callable[[Snapshot], bool]) -> Snapshot:
    """Confirm each placement by the main button until the state is as wanted."""
    end_s = time.monotonic() + SESSION_S
    label = page.locator("#action-label")
    with bench.client() as looks_on:
        while not done(state := looks_on.state()):
            assert time.monotonic() < end_s, page.locator("body").inner_text()
            assert not is_over(state), state.session
            ready = state.prompt is not None and state.prompt.hands_off
            if ready and "laced" in label.inner_text() and page.locator("#action").is_enabled():
                page.keyboard.press("Enter")
                page.wait_for_timeout(1000)  # as a person, who presses again if nothing happens
            page.wait_for_timeout(100)
    return state


def test_the_first_strike_and_the_end_by_the_page(page: Page, bench: Bench) -> None:
    start_session(page, bench)
    state = place_until(page, bench, lambda state: bool(state.session and state.session.strikes))
    assert state.session is not None
    page.keyboard.press("3")
    wait(page, lambda: page.locator("#verdict-tag").is_visible())
    assert page.locator("#verdict-title").inner_text().startswith(state.session.strikes[0].id)
    page.locator("#order-abort").click()
    page.click("#confirm-yes")
    with bench.client() as looks_on:
        wait(page, lambda: is_over(looks_on.state()))
        wait(page, lambda: looks_on.archive()[0].complete)
        assert looks_on.archive()[0].strikes == len(state.session.strikes)


@pytest.mark.slow
@pytest.mark.parametrize("until", [False, True])
def test_a_whole_session_by_the_page_alone(page: Page, bench: Bench, until: bool) -> None:
    if until:
        bench.plan(strikes=9)
    start_session(page, bench, until=until)
    state = place_until(page, bench, is_over)
    assert state.session is not None
    assert state.session.state == "finished", state.session
    assert not until or state.session.text.startswith("com=0.5mm is reached"), state.session
    with bench.client() as looks_on:
        wait(page, lambda: looks_on.archive()[0].complete)
        entry = looks_on.archive()[0]
    page.keyboard.press("5")
    wait(page, lambda: entry.object in page.locator("#archive-rows").inner_text())
    with page.context.expect_page() as opened:
        page.locator("#archive-rows").get_by_text("Report").first.click()
    report = opened.value
    report.get_by_text("entre of mass").first.wait_for(timeout=120_000)  # the page waits until it is made
