"""The console's pages in Chromium: every state at three widths, the stop, keys, roles, a lost connection."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.acquire.console.web.pages.page_rules import FOCUS_ORDER, RULES, STOP
from tests.acquire.console.web.pages.results import HOSTILE
from tests.acquire.console.web.pages.sample_console import SampleConsole, sample_console
from tests.acquire.console.web.pages.screenshots import (
    COUNT_SNAPSHOTS,
    MOMENTS,
    SCHEMES,
    SIZES,
    show_state,
)
from tests.acquire.console.web.pages.snapshots import base, prompt, session, states

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

QUICK = [(390, "light")]
"""width and scheme in which every state is looked at by the short tests, too"""


@pytest.fixture(scope="module")
def server() -> Iterator[SampleConsole]:
    with sample_console() as running:
        yield running


@pytest.fixture
def page(chromium: Browser, server: SampleConsole) -> Iterator[Page]:
    server.orders.clear()
    server.stop_fails = server.silent = False
    server.slow_s = 0.0
    opened = chromium.new_page(viewport={"width": 1440, "height": 900})
    opened.add_init_script(COUNT_SNAPSHOTS)
    problems: list[str] = []
    opened.on("pageerror", lambda error: problems.append(str(error)))
    opened.on("console", lambda line: problems.append(line.text) if "Content Security" in line.text else None)
    yield opened
    opened.close()
    assert not problems


def _orders(server: SampleConsole, path: str) -> list[object]:
    return [content for asked, content in server.orders if asked == path]


def _await_orders(page: Page, server: SampleConsole, count: int = 1) -> None:
    """Wait until the page has sent this many orders, and 100 ms more, in which no other may follow."""
    end = time.monotonic() + 10
    while len(server.orders) < count and time.monotonic() < end:
        page.wait_for_timeout(10)
    page.wait_for_timeout(100)


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        pytest.param(width, scheme, marks=() if (width, scheme) in QUICK else pytest.mark.slow)
        for width in SIZES
        for scheme in SCHEMES
    ],
)
def test_every_state_keeps_the_rules(page, server, width, scheme):
    page.set_viewport_size({"width": width, "height": SIZES[width]})
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    broken = {}
    for name in (*states(), *MOMENTS):
        show_state(page, server, name)
        for rule, script in RULES.items():
            if found := page.evaluate(script):
                broken[name, rule] = found
        stop = page.evaluate(STOP)
        assert stop == {"seen": True, "hit": True, "enabled": True, "larger": []}, name
    assert not broken, "\n".join(f"{key}: {found}" for key, found in broken.items())


@pytest.mark.parametrize("key", ["Escape", "Space"])
def test_keys_stop_in_every_view_without_a_question(page, server, key):
    show_state(page, server, "place")
    for view in ("ready", "place", "strike", "know", "archive"):
        page.click(f"nav [data-view={view}]")
        server.orders.clear()
        page.keyboard.press(key)
        _await_orders(page, server)
        assert server.orders == [("/api/stop", {})]


def test_stop_acts_when_the_button_goes_down_and_once(page, server):
    show_state(page, server, "armed")
    box = page.locator("#stop").bounding_box()
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    _await_orders(page, server)
    assert _orders(server, "/api/stop") == [{}]
    page.mouse.up()
    page.wait_for_timeout(150)
    assert _orders(server, "/api/stop") == [{}]


def test_escape_closes_a_dialog_and_stops(page, server):
    show_state(page, server, "place")
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    _await_orders(page, server)
    assert page.locator("#help").is_hidden()
    assert _orders(server, "/api/stop") == [{}]


def test_space_is_a_character_in_a_text_field_but_escape_stops(page, server):
    show_state(page, server, "ready-failed")
    page.fill("#override", "")
    page.focus("#override")
    page.keyboard.type("tag is dirty")
    assert page.input_value("#override") == "tag is dirty"
    assert not server.orders
    page.keyboard.press("Escape")
    _await_orders(page, server)
    assert server.orders == [("/api/stop", {})]


def test_stop_without_an_answer_names_the_switch(page, server):
    show_state(page, server, "armed")
    server.stop_fails = True
    page.keyboard.press("Escape")
    page.wait_for_selector("#stopped.alarm")
    assert "switch or plug" in page.inner_text("#stopped")
    assert len(_orders(server, "/api/stop")) == 3


def test_homing_again_asks_first(page, server):
    show_state(page, server, "stopped")
    page.click("#home")
    assert not server.orders
    page.click("#confirm-no")
    assert not server.orders
    page.click("#home")
    page.click("#confirm-yes")
    _await_orders(page, server)
    assert server.orders == [("/api/stop/clear", {"confirm": True})]


def test_start_needs_a_passed_check_or_a_reason(page, server):
    show_state(page, server, "ready-failed")
    assert page.locator("#action").is_disabled()
    page.fill("#override", "one tag is dirty")
    page.click("#action")
    _await_orders(page, server)
    [order] = _orders(server, "/api/session/start")
    assert order == {
        "object_id": "o1",
        "plan_id": "p1",
        "override": "one tag is dirty",
        "countdown_s": 3,
    }


def test_start_sends_target_and_number_of_strikes(page, server):
    show_state(page, server, "ready")
    page.check("input[value=until]")
    page.fill("#until-inertia", "2")
    page.keyboard.press("Enter")
    _await_orders(page, server)
    [order] = _orders(server, "/api/session/start")
    assert order["until"] == "com=0.5mm,inertia=2%"
    assert order["max_strikes"] == 12
    assert "override" not in order


def test_an_ended_session_is_offered_to_go_on_with(page, server):
    server.show(base() | {"session": session("aborted", "stopped", 4)})
    page.goto(server.url)
    page.wait_for_selector("#view-know", state="visible")
    assert page.inner_text("#sign-word") == "ENDED"
    page.locator("#action-label", has_text="Go on with it").wait_for()
    page.locator("#action:enabled").wait_for()
    page.keyboard.press("Enter")
    page.locator("#resume option[value=r0]").wait_for(state="attached")
    page.wait_for_timeout(800)
    assert page.input_value("#resume") == "r0"
    page.keyboard.press("Enter")
    _await_orders(page, server)
    [order] = _orders(server, "/api/session/start")
    assert order == {
        "object_id": "o1",
        "plan_id": "p1",
        "resume": ["r0"],
        "until": "com=0.5mm",
        "max_strikes": 12,
        "countdown_s": 3,
    }


def test_orders_that_take_seconds_say_so(page, server):
    show_state(page, server, "no-daemon")
    server.slow_s = 0.6
    page.keyboard.press("Enter")
    page.wait_for_selector("#doing", state="visible")
    assert "camera and striker are opened" in page.inner_text("#doing")
    assert page.locator("#action").is_disabled()
    page.wait_for_selector("#doing", state="hidden")


def test_while_this_page_moves_the_arm_it_warns_and_stop_is_ready(page, server):
    show_state(page, server, "stopped")
    page.click("nav [data-view=archive]")
    assert "may have been hit" in page.inner_text("#stopped-text")
    server.slow_s = 0.8
    page.click("#home")
    page.click("#confirm-yes")
    page.locator("#sign-word", has_text="HOMING").wait_for()
    assert page.inner_text("#stop-keys") == "Esc or Space"
    page.locator("#stop-keys", has_text="stopped").wait_for()


def test_the_armed_sign_is_in_every_view(page, server):
    show_state(page, server, "armed")
    for view in ("ready", "know", "archive"):
        page.click(f"nav [data-view={view}]")
        assert page.locator("#sign").is_visible()
        assert page.inner_text("#sign-word").startswith("ARMING")


def test_a_fault_of_the_striker_is_an_alarm(page, server):
    show_state(page, server, "fault")
    assert "STRIKER FAULT" in page.inner_text("#stopped")
    assert page.locator("#action").is_enabled(), "a session homes the striker at its start"
    page.click("#home")
    page.click("#confirm-yes")
    _await_orders(page, server)
    assert server.orders == [("/api/stop/clear", {"confirm": True})]


def test_the_next_placement_answers_harder(page, server):
    show_state(page, server, "again")
    faster = prompt(id=8, hint="The next strike is 15 % faster")
    server.show(base() | {"session": session("placing", "", 2), "prompt": faster})
    page.locator("#orders-note", has_text="15 % faster").wait_for()


def test_pedal_answers_a_prompt_once_even_after_a_click_elsewhere(page, server):
    show_state(page, server, "place")
    page.click("nav [data-view=know]")
    page.click("nav [data-view=place]")
    page.click("#sound")
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    _await_orders(page, server)
    assert server.orders == [("/api/prompt/answer", {"id": 7, "ok": True, "order": "placed"})]


def test_orders_of_the_strike_view(page, server):
    show_state(page, server, "again")
    for count, button in enumerate(("again", "harder"), 1):
        page.click(f"#order-{button}")
        _await_orders(page, server, count)  # each goes over a connection of its own
    page.click("#order-skip")
    assert len(server.orders) == 2
    page.click("#confirm-yes")  # a strike that is left out does not come back
    _await_orders(page, server, 3)
    page.click("#order-pause")
    _await_orders(page, server, 4)
    orders = [content.get("order") for path, content in server.orders if path == "/api/prompt/answer"]
    assert orders == ["again", "harder", "skip"]
    assert _orders(server, "/api/session/pause") == [{"when": "after_strike"}]


def test_watchers_may_only_stop_and_take_over(page, server):
    show_state(page, server, "watcher")
    for control in ("#action", "#place-skip", "#place-pause"):
        assert page.locator(control).is_disabled()
    assert page.locator("#stop").is_enabled()
    page.click("#take")
    assert not server.orders
    page.click("#confirm-yes")
    _await_orders(page, server)
    assert server.orders == [("/api/operator/take", {})]


def test_a_lost_connection_is_stated_and_mended(page, server):
    show_state(page, server, "place")
    server.silent = True
    page.wait_for_selector("#link-lost:not([hidden])")
    assert "pauses before its next strike" in page.inner_text("#link-lost")
    assert page.locator("#action").is_disabled()
    assert page.locator("#stop").is_enabled()
    server.silent = False
    page.wait_for_selector("#link-lost", state="hidden")
    assert page.locator("#action").is_enabled()


def test_preview_is_loaded_only_by_views_that_show_it(page, server):
    show_state(page, server, "place")
    assert server.previews == 1
    page.click("nav [data-view=archive]")
    page.wait_for_timeout(600)
    assert server.previews == 0
    page.click("nav [data-view=ready]")
    page.wait_for_timeout(600)
    assert server.previews == 1
    page.evaluate(
        "Object.defineProperty(document, 'hidden', {value: true});"
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
    page.wait_for_timeout(600)
    assert server.previews == 0


def test_names_are_text_whatever_they_contain(page, server):
    snapshot = base() | {
        "session": session("placing", HOSTILE, 1, object=HOSTILE),
        "prompt": prompt(text=HOSTILE, hint=HOSTILE, edge=HOSTILE, card="javascript:document.title=1"),
        "trouble": [HOSTILE],
    }
    server.show(snapshot)
    page.goto(server.url)
    page.wait_for_timeout(400)
    for view in ("ready", "place", "strike", "know", "archive"):
        page.click(f"nav [data-view={view}]")
        page.wait_for_timeout(200)
    assert HOSTILE in page.inner_text("#trouble")
    assert page.title() != "1"
    assert page.locator("img[src=x]").count() == 0


def test_view_follows_the_session_unless_pinned(page, server):
    show_state(page, server, "ready")
    server.show(base() | {"session": session("placing", ""), "prompt": prompt()})
    page.wait_for_selector("#view-place", state="visible")
    page.keyboard.press("4")
    server.show(base() | {"session": session("arming", "")})
    page.wait_for_timeout(300)
    assert page.locator("#view-know").is_visible()
    page.keyboard.press("f")
    page.wait_for_selector("#view-strike", state="visible")
    page.reload()
    server.show(base() | {"session": session("placing", ""), "prompt": prompt()})
    page.wait_for_selector("#view-place", state="visible")


def test_pedal_leaves_a_verdict_and_the_view_still_follows(page, server):
    show_state(page, server, "again")
    assert page.inner_text("#sign-word") == "AGAIN"
    page.keyboard.press("Enter")
    page.wait_for_selector("#view-place", state="visible")
    server.show(base() | {"session": session("arming", "", 2)})
    page.wait_for_selector("#view-strike", state="visible")
    assert not server.orders


def test_trouble_that_was_read_is_not_shown_again(page, server):
    show_state(page, server, "no-camera")
    page.click("#trouble-close")
    page.wait_for_selector("#trouble", state="hidden")
    server.show(base() | {"trouble": ["12 frames lost"]})
    page.wait_for_selector("#trouble", state="visible")


def test_focus_reaches_all_controls_in_order_and_is_seen(page, server):
    show_state(page, server, "place")
    wanted = page.evaluate(FOCUS_ORDER)
    reached = []
    name = (
        "(({id, dataset, textContent}) => id || dataset.view || textContent.trim())(document.activeElement)"
    )
    for _ in wanted:
        page.keyboard.press("Tab")
        reached.append(page.evaluate(name))
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"
    assert reached == wanted
    assert reached[-1] == "stop"


def test_archive_is_filtered_and_two_recordings_are_compared(page, server):
    show_state(page, server, "archive")
    page.fill("#filter", "carton 2026-11-2")
    page.wait_for_timeout(100)
    assert page.locator("#archive-rows tr").count() == 3
    page.locator("#archive-rows input").nth(0).check()
    page.locator("#archive-rows input").nth(1).check()
    page.wait_for_selector("#comparison:not([hidden])")
    assert page.locator("#compare-rows tr").count() == 3
    assert "+0.29" in page.inner_text("#compare-rows")
    page.locator("#archive-rows button", has_text="Re-estimate").first.click()
    _await_orders(page, server)
    assert _orders(server, "/api/archive/r0/estimate") == [{}]
