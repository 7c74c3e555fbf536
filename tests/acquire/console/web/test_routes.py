"""Routes of the console: each answers with the document that its OpenAPI entry names."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from acquire.console.web.backend import Viewer
from acquire.console.web.openapi import openapi_document
from acquire.console.web.orders import Answer, StartSession
from acquire.console.web.refusal import Refusal
from acquire.console.web.routes import ROUTES
from acquire.console.web.snapshot import Snapshot
from acquire.errors import DaemonNotRunning, DaemonSilent, StrikerStopped
from tests.acquire.console.web.samples import STATES, sample
from tests.acquire.console.web.served import Console, console


@pytest.fixture(scope="module")
def served() -> Iterator[Console]:
    with console() as each:
        yield each


@pytest.mark.parametrize("state", STATES)
def test_every_state_reaches_the_browser(served: Console, state: str) -> None:
    served.backend.state = state
    shown = Snapshot.model_validate_json(served.get("/api/state").data)
    viewer = Viewer("watcher" if state == "watcher" else "operator", True, 0)
    expected = sample(state, viewer)
    assert shown.session == expected.session
    assert shown.prompt == expected.prompt
    served.backend.state = "ready"


def test_the_state_is_sent_when_it_changes_with_a_heartbeat(served: Console) -> None:
    with served.connected() as stream:
        head = f"GET /api/events HTTP/1.1\r\nHost: {served.host}\r\nCookie: {served.cookie}\r\n\r\n"
        stream.sendall(head.encode())
        received = b""
        while b": alive" not in received:
            received += stream.recv(65536)
            if received.count(b"event: state") == 1:
                served.backend.state = "placing"
    assert received.count(b"event: state") == 2
    served.backend.state = "ready"


def test_live_images_are_sent_as_they_come(served: Console) -> None:
    with served.connected() as stream:
        head = f"GET /api/preview.mjpeg HTTP/1.1\r\nHost: {served.host}\r\nCookie: {served.cookie}\r\n\r\n"
        stream.sendall(head.encode())
        received = b""
        while received.count(b"\xff\xd8\xff") < 3:
            received += stream.recv(65536)
    assert b"multipart/x-mixed-replace" in received


def test_orders_reach_the_rig(served: Console) -> None:
    served.backend.orders.clear()
    for path, body in (
        ("/api/daemon/start", {}),
        ("/api/check", {}),
        ("/api/session/start", {"object_id": "o1", "plan_id": "p1", "name": "a 1", "override": "x"}),
        ("/api/session/pause", {"when": "after_strike"}),
        ("/api/session/resume", {}),
        ("/api/prompt/answer", {"id": 3, "ok": True, "order": "harder"}),
        ("/api/session/abort", {}),
        ("/api/stop", {}),
        ("/api/stop/clear", {"confirm": True}),
    ):
        assert served.post(path, body).status == 200, path
    start = StartSession(object_id="o1", plan_id="p1", name="a 1", override="x")
    answer = Answer(id=3, ok=True, order="harder")
    expected = ["daemon", "check", start, "after_strike", "resume", answer, "abort", "stop", "clear"]
    assert served.backend.orders == expected


def test_homing_after_a_stop_needs_a_confirmation(served: Console) -> None:
    assert served.post("/api/stop/clear", {}).status == 422
    assert served.post("/api/stop/clear", {"confirm": False}).status == 422


@pytest.mark.parametrize(
    ("error", "status", "kind", "remedy"),
    [
        (DaemonNotRunning("no daemon listens at /x: start one"), 503, "DaemonNotRunning", "start one"),
        (DaemonSilent("it hangs"), 504, "DaemonSilent", ""),
        (StrikerStopped("stopped: home it"), 409, "StrikerStopped", "home it"),
        (Refusal(409, "NameTaken", "taken", "another"), 409, "NameTaken", "another"),
    ],
    ids=lambda each: type(each).__name__,
)
def test_errors_of_the_rig_are_answers(
    served: Console, monkeypatch: pytest.MonkeyPatch, error: Exception, status: int, kind: str, remedy: str
) -> None:
    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr(served.backend, "resume", fail)
    answer = served.post("/api/session/resume")
    assert (answer.status, answer.kind, answer.json["error"]["remedy"]) == (status, kind, remedy)


def test_names_are_data_and_not_markup(served: Console) -> None:
    entry = next(each for each in served.get("/api/archive").json if "<b>" in each["object"])
    assert entry["object"] == "spray <b>can</b> & cap"
    assert served.get("/api/archive").headers["content-type"] == "application/json"


def test_the_openapi_document_describes_every_route(served: Console) -> None:
    document = served.get("/api/openapi.json").json
    assert document == json.loads(json.dumps(openapi_document(ROUTES)))
    described = {(method.upper(), path) for path, methods in document["paths"].items() for method in methods}
    assert described == {(route.method, route.path) for route in ROUTES}
    text = json.dumps(document)
    for name in ("Snapshot", "StartSession", "ErrorAnswer", "ArchiveEntry", "Curve", "PromptView"):
        assert name in document["components"]["schemas"]
    references = {each.split('"')[0] for each in text.split('"#/components/schemas/')[1:]}
    assert references <= set(document["components"]["schemas"])
