"""The console in Chromium: one-time address, cookie, the stop by a key, and other sites beside it."""

from __future__ import annotations

import http.server
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

from tests.acquire.console.web.served import Console, console

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ATTACKS = """<!doctype html><script>
const at = "http://127.0.0.1:PORT";
const send = (path, options) => fetch(at + path, options).then(a => a.text()).catch(String);
window.done = Promise.all([
  send("/api/stop/clear", {method: "POST", credentials: "include", body: '{"confirm": true}'}),
  send("/api/daemon/start", {method: "POST", credentials: "include", mode: "no-cors", body: "{}"}),
  send("/api/session/resume", {method: "POST", credentials: "include",
    headers: {"Content-Type": "application/json", "X-Percuss": "1"}, body: "{}"}),
  send("/api/state", {credentials: "include"}),
  new Promise(end => { const i = new Image(); i.onload = () => end("image"); i.onerror = () => end("none");
    i.src = at + "/api/preview.jpg"; }),
]);
</script><form method="post" enctype="text/plain" action="http://127.0.0.1:PORT/api/session/abort"></form>
<iframe src="http://127.0.0.1:PORT/"></iframe>"""


@pytest.fixture
def served() -> Iterator[Console]:
    with console() as each:
        each.visitors._visitors.clear()
        each.visitors._operator = None
        yield each


@pytest.fixture
def page(chromium: Browser, served: Console) -> Iterator[Page]:
    context = chromium.new_context()
    page = context.new_page()
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda line: problems.append(line.text) if "Content Security" in line.text else None)
    page.goto(f"http://{served.host}/?token={served.visitors.new_token()}")
    yield page
    context.close()
    assert not problems


def wait(done: Callable[[], bool], timeout_s: float = 10.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_the_token_leaves_the_address_and_scripts_see_no_cookie(page: Page, served: Console) -> None:
    assert "token" not in page.url
    assert page.evaluate("document.cookie") == ""
    (cookie,) = page.context.cookies()
    assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
    wait(lambda: served.visitors.operator_present)


@pytest.mark.parametrize("key", ["Escape", " "])
def test_a_key_stops_the_striker(page: Page, served: Console, key: str) -> None:
    wait(lambda: served.visitors.operator_present)
    page.locator("body").press(key)
    wait(lambda: "stop" in served.backend.orders)


def test_a_closed_browser_is_noticed(chromium: Browser, served: Console) -> None:
    context = chromium.new_context()
    page = context.new_page()
    page.goto(f"http://{served.host}/?token={served.visitors.new_token()}")
    wait(lambda: any(each.streams for each in served.visitors._visitors.values()))
    context.close()
    closed_s = time.monotonic()
    wait(lambda: not served.visitors.operator_present)
    assert time.monotonic() - closed_s < 4.0


def test_a_page_of_another_site_orders_and_sees_nothing(page: Page, served: Console) -> None:
    wait(lambda: served.visitors.operator_present)
    content = ATTACKS.replace("PORT", str(served.port)).encode()

    class Site(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.2", 0), Site) as site:
        thread = threading.Thread(target=site.serve_forever)
        thread.start()
        try:
            other = page.context.new_page()
            other.goto(f"http://127.0.0.2:{site.server_address[1]}/")
            answers = other.evaluate("window.done")
            other.evaluate("document.forms[0].submit()")
            other.wait_for_timeout(300)
        finally:
            site.shutdown()
            thread.join()
    assert all("Failed to fetch" in each or each == "" for each in answers[:4]), answers
    assert answers[4] == "none"
    assert served.backend.orders == []
