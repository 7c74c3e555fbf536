"""Console against other sites, other programs of the computer, and browsers that only watch."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from acquire.console.web import routes, server
from acquire.console.web.gate import CONTENT_POLICY, cookie_name
from acquire.console.web.visitors import LOST_S, ORDER_LIMIT, STOP_LIMIT, Visitors
from tests.acquire.console.web.served import Console, console

ORDERS = [route for route in routes.ROUTES if route.method == "POST"]
READS = [route for route in routes.ROUTES if route.method == "GET"]


def concrete(path: str) -> str:
    return path.replace("{recording_id}", "r1").replace("{strike_id}", "s1.1")


@pytest.fixture(scope="module")
def served() -> Iterator[Console]:
    """One console for tests that change nothing; its clock stands, so that a test uses up no rate."""
    with console() as each:
        yield each


@pytest.fixture
def fresh() -> Iterator[Console]:
    with console() as each:
        yield each


# --- who is let in


def test_an_address_lets_one_browser_in_once(fresh: Console) -> None:
    token = fresh.visitors.new_token()
    answer = fresh.get(f"/?token={token}", {"Cookie": None})
    assert (answer.status, answer.headers["location"], answer.data) == (303, "/", b"")
    cookie, *attributes = answer.headers["set-cookie"].split("; ")
    assert cookie.startswith(f"{cookie_name(fresh.port)}=")
    assert {each.lower() for each in attributes} == {"httponly", "samesite=strict", "path=/"}
    assert fresh.get("/api/state", {"Cookie": cookie}).json["role"] == "watcher"
    again = fresh.get(f"/?token={token}", {"Cookie": None})
    assert (again.status, again.kind) == (403, "TokenUsed")


@pytest.mark.parametrize("token", ["", "x", "x" * 5000, "%00", "a&token=b"])
def test_a_guessed_token_lets_nobody_in(served: Console, token: str) -> None:
    answer = served.get(f"/?token={token}", {"Cookie": None})
    assert answer.status in {401, 403}
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    "cookie", [None, "", "percuss_console=1", 'x="', "=;=;", "percuss_console_{port}=wrong"]
)
@pytest.mark.parametrize(
    "path", ["/", "/api/state", "/api/events", "/api/preview.mjpeg", "/static/index.html"]
)
def test_without_the_cookie_nothing_is_shown(served: Console, path: str, cookie: str | None) -> None:
    given = None if cookie is None else cookie.format(port=served.port)
    answer = served.get(path, {"Cookie": given})
    assert (answer.status, answer.kind) == (401, "NotLetIn")


@pytest.mark.parametrize("route", ORDERS, ids=lambda route: route.path)
def test_without_the_cookie_no_order_is_taken(served: Console, route: routes.ApiRoute) -> None:
    assert served.post(concrete(route.path), {}, {"Cookie": None}).status == 401
    assert served.backend.orders == []


def test_the_key_of_scripts_is_no_cookie_and_a_cookie_no_key(fresh: Console) -> None:
    key = fresh.visitors.new_key()
    bearer = {"Cookie": None, "Authorization": f"Bearer {key}.me"}
    assert fresh.get("/api/state", bearer).json["role"] == "watcher"
    assert fresh.get("/api/state", {"Cookie": f"{cookie_name(fresh.port)}={key}.me"}).status == 401
    secret = fresh.cookie.partition("=")[2]
    for wrong in (secret, f"{secret}.me", key, f"{key}.", "", f"{key[:-1]}.me", "." * 5000):
        given = {"Cookie": None, "Authorization": f"Bearer {wrong}"}
        assert fresh.get("/api/state", given).status == 401


# --- other sites


@pytest.mark.parametrize(
    "host", ["evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "localhost.evil:{port}", ""]
)
def test_a_name_that_another_site_points_here_is_refused(served: Console, host: str) -> None:
    answer = served.get("/api/state", {"Host": host.format(port=served.port)})
    assert (answer.status, answer.kind) == (421, "WrongHost")
    token = served.visitors.new_token()
    assert served.get(f"/?token={token}", {"Host": host.format(port=served.port)}).status == 421


def test_two_hosts_are_refused(served: Console) -> None:
    with served.connected() as bare:
        head = (
            f"GET /api/state HTTP/1.1\r\nHost: {served.host}\r\nHost: evil\r\nCookie: {served.cookie}\r\n\r\n"
        )
        bare.sendall(head.encode())
        assert bare.recv(100).split()[1] in {b"400", b"421"}


@pytest.mark.parametrize(
    "change",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1:{port}"},
        {"Origin": "http://localhost:{port}"},
        {"Origin": None},
        {"X-Percuss": None},
        {"X-Percuss": "0"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Content-Type": "text/plain"},
        {"Content-Type": "application/x-www-form-urlencoded"},
        {"Content-Type": None},
    ],
    ids=str,
)
@pytest.mark.parametrize("path", ["/api/stop/clear", "/api/daemon/start", "/api/operator/take", "/api/stop"])
def test_an_order_that_another_site_sends_is_refused(
    fresh: Console, path: str, change: dict[str, str | None]
) -> None:
    given = {name: value and value.format(port=fresh.port) for name, value in change.items()}
    assert fresh.post(path, {"confirm": True}, given).status in {403, 415}
    assert fresh.backend.orders == []


def test_another_site_sees_nothing(served: Console) -> None:
    assert served.get("/api/state", {"Sec-Fetch-Site": "cross-site"}).status == 403
    assert served.get("/api/state", {"Origin": "http://evil.example"}).status == 403


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_other_methods_are_refused(served: Console, method: str) -> None:
    assert served.send(method, "/api/stop").status == 405


@pytest.mark.parametrize("route", ORDERS, ids=lambda route: route.path)
def test_a_get_changes_nothing(served: Console, route: routes.ApiRoute) -> None:
    assert served.get(concrete(route.path)).status in {404, 405}
    assert served.backend.orders == []


@pytest.mark.parametrize("path", ["/", "/api/state", "/api/preview.jpg", "/nothing", "/api/cards/s1"])
def test_every_answer_carries_the_headers(served: Console, path: str) -> None:
    headers = served.get(path).headers
    policy = "default-src 'none'; style-src 'unsafe-inline'" if "cards" in path else CONTENT_POLICY
    assert headers["content-security-policy"] == policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"
    assert "server" not in headers
    assert "access-control-allow-origin" not in headers


# --- files

TRAVERSALS = [
    "/../app.py",
    "/static/../app.py",
    "/static/..%2fapp.py",
    "/static/%2e%2e/app.py",
    "/static/....//app.py",
    "/static//etc/passwd",
    "//etc/passwd",
    "/static/%2fetc%2fpasswd",
    "/static/index.html%00.png",
    "/static/..%5capp.py",
    "/api/archive/..%2f..%2fetc%2fpasswd/report",
    "/api/archive/../../download",
    "/api/archive/%2e%2e%2fr/download",
    "/api/cards/..%2f..%2fapp.py",
    f"/api/archive/{'r' * 5000}/report",
]


@pytest.mark.parametrize("path", TRAVERSALS, ids=lambda path: path[:40])
def test_no_path_of_a_browser_reaches_a_file(served: Console, path: str) -> None:
    answer = served.get(path)
    assert answer.status in {400, 404}
    assert b"import" not in answer.data
    assert b"root:" not in answer.data


@pytest.mark.parametrize(
    "order",
    [
        {"object_id": "../o", "plan_id": "p1"},
        {"object_id": "o1", "plan_id": "/etc/passwd"},
        {"object_id": "o1", "plan_id": "p1", "name": "../../x"},
        {"object_id": "o1", "plan_id": "p1", "name": "a/b"},
        {"object_id": "o1", "plan_id": "p1", "until": "--exec=sh"},
        {"object_id": "o1", "plan_id": "p1", "file": "/tmp/x"},
        {"object_id": "o1"},
        [],
        "start",
    ],
    ids=str,
)
def test_a_session_is_started_by_ids_only(fresh: Console, order: object) -> None:
    assert fresh.post("/api/session/start", order).status == 422
    assert fresh.backend.orders == []


@pytest.mark.parametrize("body", [b"{", b"\xff", b"[" * 100_000, b'{"confirm": tru', b"NaN"])
def test_a_body_that_is_no_order_is_refused(fresh: Console, body: bytes) -> None:
    assert fresh.post("/api/stop/clear", body).status in {400, 413, 422}
    assert fresh.backend.orders == []


# --- roles


def test_watchers_may_look_and_stop_and_take_over_explicitly(fresh: Console) -> None:
    watcher = {"Cookie": fresh.another_cookie()}
    assert fresh.get("/api/state").json["role"] == "operator"
    assert fresh.get("/api/state", watcher).json["role"] == "watcher"
    refused = fresh.post("/api/session/pause", {"when": "now"}, watcher)
    assert (refused.status, refused.kind) == (403, "Watcher")
    assert fresh.post("/api/stop", {}, watcher).status == 200
    assert fresh.backend.orders == ["stop"]
    assert fresh.post("/api/operator/take", {}, watcher).status == 200
    assert fresh.get("/api/state").json["role"] == "watcher"
    assert fresh.post("/api/session/pause", {"when": "now"}, watcher).status == 200
    assert fresh.post("/api/session/pause", {"when": "now"}).status == 403


@pytest.mark.parametrize("route", [each for each in ORDERS if not each.anyone], ids=lambda route: route.path)
def test_watchers_give_no_orders(served: Console, route: routes.ApiRoute) -> None:
    assert served.post(concrete(route.path), {}, {"Cookie": served.another_cookie()}).kind == "Watcher"


def test_the_operator_is_lost_two_seconds_after_the_last_stream() -> None:
    now = [0.0]
    visitors = Visitors(lambda: now[0])
    assert not visitors.operator_present
    operator = visitors.find(visitors.add())
    assert operator is not None
    visitors.open_stream(operator)
    now[0] = 1e4
    assert visitors.operator_present
    visitors.close_stream(operator)
    now[0] += 0.9 * LOST_S
    assert visitors.operator_present
    now[0] += 0.2 * LOST_S
    assert not visitors.operator_present


def test_an_invitation_lets_a_further_browser_in(fresh: Console) -> None:
    address = fresh.post("/api/invite").json["url"]
    assert address.startswith(f"http://{fresh.host}/?token=")
    assert fresh.get(address.removeprefix(f"http://{fresh.host}"), {"Cookie": None}).status == 303


# --- floods and slow clients


def test_orders_are_limited_and_stops_are_not_beside_them() -> None:
    with console(lambda: 0.0) as standing:
        orders = [
            standing.post("/api/session/pause", {"when": "now"}).status for _ in range(ORDER_LIMIT[1] + 5)
        ]
        assert orders == [200] * ORDER_LIMIT[1] + [429] * 5
        stops = [standing.post("/api/stop").status for _ in range(STOP_LIMIT[1])]
        assert stops == [200] * STOP_LIMIT[1]
        assert STOP_LIMIT[0] >= 20


def test_ten_thousand_requests_of_strangers_leave_the_operator_his_stop(fresh: Console) -> None:
    """They come over kept connections and pipelined, as fast as the server takes them."""
    request = f"GET /api/state HTTP/1.1\r\nHost: {fresh.host}\r\n\r\n".encode()
    statuses: list[bytes] = []
    lock = threading.Lock()

    def flood() -> None:
        for _ in range(2500):
            with contextlib.suppress(OSError), fresh.connected() as bare:
                bare.sendall(request)
                answer = bare.recv(4096)
                with lock:
                    statuses.append(answer.split(b" ", 2)[1] if answer else b"")

    threads = [threading.Thread(target=flood) for _ in range(4)]
    for thread in threads:
        thread.start()
    waits = []
    while any(thread.is_alive() for thread in threads):
        began_s = time.monotonic()
        assert fresh.post("/api/stop").status == 200
        waits.append(time.monotonic() - began_s)
        time.sleep(0.1)
    for thread in threads:
        thread.join()
    assert len(statuses) > 9000
    assert set(statuses) <= {b"401", b"429", b""}
    assert max(waits) < 2.0
    assert fresh.get("/api/state").status == 200


def test_slow_clients_are_hung_up_on_and_take_no_place(
    fresh: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "REQUEST_S", 0.6)
    slow = [fresh.connected() for _ in range(3 * server.MAX_STRANGERS)]
    try:
        for bare in slow:
            with contextlib.suppress(OSError):
                bare.sendall(b"GET /api/state HTTP/1.1\r\nHost: ")
        assert fresh.post("/api/stop").status == 200
        end_s = time.monotonic() + 5.0
        for bare in slow:
            bare.settimeout(max(0.05, end_s - time.monotonic()))
            assert hung_up(bare)
    finally:
        for bare in slow:
            bare.close()
    assert fresh.get("/api/state").status == 200


def hung_up(bare: socket.socket) -> bool:
    try:
        return bare.recv(1) == b""
    except ConnectionError:
        return True


def test_a_slow_body_is_refused(fresh: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acquire.console.web.body.BODY_S", 0.3)
    head = (
        f"POST /api/stop HTTP/1.1\r\nHost: {fresh.host}\r\nOrigin: http://{fresh.host}\r\nX-Percuss: 1\r\n"
        f"Cookie: {fresh.cookie}\r\nContent-Type: application/json\r\nContent-Length: 10\r\n\r\n{{"
    )
    with fresh.connected() as bare:
        bare.sendall(head.encode())
        assert bare.recv(100).split()[1] == b"408"
    assert fresh.backend.orders == []


def test_large_heads_and_bodies_are_refused(fresh: Console) -> None:
    assert fresh.post("/api/stop", {"x": "y" * 100_000}).status == 413
    with fresh.connected() as bare, contextlib.suppress(OSError):
        bare.sendall(f"GET /api/state HTTP/1.1\r\nHost: {fresh.host}\r\nX-Long: ".encode())
        for _ in range(1000):
            bare.sendall(b"y" * 10_000)
            time.sleep(0.001)
        pytest.fail("ten megabytes of a header were taken")
    assert fresh.backend.orders == []


def test_a_browser_that_does_not_read_its_events_disturbs_nobody(fresh: Console) -> None:
    head = f"GET /api/events HTTP/1.1\r\nHost: {fresh.host}\r\nCookie: {fresh.cookie}\r\n\r\n"
    with fresh.connected() as bare:
        bare.sendall(head.encode())
        time.sleep(0.3)
        assert fresh.visitors.operator_present
        assert fresh.post("/api/stop").status == 200
    with contextlib.ExitStack() as streams:
        for _ in range(20):
            bare = streams.enter_context(fresh.connected())
            bare.sendall(head.encode())
        time.sleep(0.3)
        assert fresh.post("/api/stop").status == 200
