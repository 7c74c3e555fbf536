"""Arbitrary bytes from sockets and pipes are answered or refused, and the receiver continues."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from acquire.capture import wire
from acquire.capture.process import Capture
from acquire.clock.clock import SystemClock
from acquire.daemon.client import DaemonClient
from acquire.daemon.server import ApiServer
from acquire.errors import AcquireError, DaemonError

QUICK = settings(
    max_examples=60,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
PARAMS = st.dictionaries(
    st.sampled_from(["path", "plan_json", "object_toml", "shape_base64", "state", "strike_id", "timeout_s"]),
    JSON,
    max_size=4,
)
REQUESTS = st.fixed_dictionaries(
    {},
    optional={
        "id": JSON,
        "method": JSON | st.sampled_from(["echo", "float", "nan"]),
        "params": JSON | PARAMS,
    },
)
LINES = st.one_of(
    JSON.map(lambda value: json.dumps(value).encode()),
    REQUESTS.map(lambda value: json.dumps(value).encode()),
    st.binary(max_size=40).map(lambda data: data.replace(b"\n", b" ")),
    st.just(b"[" * 100_000),
).filter(lambda line: b'"subscribe"' not in line)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    path = tmp_path_factory.mktemp("api") / "private" / "d.sock"
    handlers = {
        "echo": lambda _, params: params,
        "float": lambda _, params: int(float(params["strike_id"])),
        "nan": lambda *_: float("nan"),
    }
    api = ApiServer(path, handlers)
    yield path
    api.close()


@QUICK
@given(line=LINES)
def test_every_line_is_answered_and_the_connection_lives(server: Path, line: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as raw:
        raw.settimeout(5.0)
        raw.connect(str(server))
        with raw.makefile("rb") as stream:
            raw.sendall(line + b"\n")
            answer = json.loads(stream.readline())
            assert {"result", "error"} & answer.keys()
            raw.sendall(b'{"id": 2, "method": "echo", "params": {"x": 1}}\n')
            assert json.loads(stream.readline()) == {"id": 2, "result": {"x": 1}}


@QUICK
@given(
    line=st.binary(max_size=40).map(lambda data: data.replace(b"\n", b" "))
    | JSON.map(lambda value: json.dumps(value).encode())
)
def test_a_server_that_is_no_daemon_raises_only_a_daemon_error(line: bytes, tmp_path: Path) -> None:
    path = tmp_path / "other.sock"
    path.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen(1)

        def answer() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.recv(1000)
                connection.sendall(line + b"\n")

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            with DaemonClient(path) as client, contextlib.suppress(DaemonError):
                client.call("status")
        finally:
            thread.join()


def test_unknown_error_name_becomes_a_daemon_error(tmp_path: Path) -> None:
    def refuse(*_: object) -> None:
        raise ZeroDivisionError("division by zero")

    api = ApiServer(tmp_path / "p" / "d.sock", {"refuse": refuse})
    try:
        with (
            DaemonClient(tmp_path / "p" / "d.sock") as client,
            pytest.raises(DaemonError, match="ZeroDivisionError"),
        ):
            client.call("refuse")
    finally:
        api.close()


@QUICK
@given(data=st.binary(max_size=60))
def test_a_frame_is_whole_or_refused(data: bytes) -> None:
    here, there = socket.socketpair()
    with here, there:
        here.settimeout(5.0)
        there.sendall(data)
        there.close()
        with contextlib.suppress(wire.WireClosed):
            while True:
                assert isinstance(wire.receive(here)[0], dict)


@QUICK
@given(
    text=JSON.map(lambda value: json.dumps(value).encode()) | st.binary(max_size=30) | st.just(b"[" * 50_000)
)
def test_a_frame_whose_header_is_no_object_is_refused(text: bytes) -> None:
    here, there = socket.socketpair()
    with here, there:
        here.settimeout(5.0)
        there.sendall(len(text).to_bytes(4, "little") + bytes(4) + text)
        with contextlib.suppress(wire.WireClosed):
            assert isinstance(wire.receive(here)[0], dict)


@QUICK
@given(
    messages=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 1 << 63), st.binary(max_size=9))),
    cut=st.integers(0, 30),
)
def test_a_batch_comes_back_whole_or_is_refused(messages: list[tuple[int, int, bytes]], cut: int) -> None:
    batch = b"".join(wire.pack_message(*message) for message in messages)
    assert list(wire.unpack_messages(batch)) == messages
    part = batch[: max(0, len(batch) - cut)]
    try:
        found = list(wire.unpack_messages(part))
    except ValueError:
        return
    assert found == messages[: len(found)]
    assert sum(len(wire.pack_message(*message)) for message in found) == len(part)


COMMANDS = ["start", "open_recording", "open_window", "close_window", "messages", "status", "close_recording"]
HEADERS = st.fixed_dictionaries(
    {"op": st.sampled_from(COMMANDS) | JSON},
    optional={"rig": JSON, "path": JSON, "manifest": JSON, "attachments": JSON, "topics": JSON, "id": JSON},
).filter(lambda header: header["op"] != "stop")


@QUICK
@given(header=HEADERS, payload=st.binary(max_size=40))
def test_the_capture_process_answers_every_command(header: dict, payload: bytes) -> None:
    def no_camera(*_: object):
        raise AcquireError("no camera in this test")

    here, there = socket.socketpair()
    never, end = os.pipe()
    with here, there, os.fdopen(never), os.fdopen(end, "w"):
        here.settimeout(5.0)
        capture = Capture(there, no_camera, SystemClock(), never)
        wire.send(here, header, payload)
        wire.send(here, {"op": "stop", "id": "last"})
        thread = threading.Thread(target=capture.run)
        thread.start()
        try:
            while wire.receive(here)[0].get("id") != "last":
                pass
        finally:
            thread.join(5.0)
        assert not thread.is_alive()
