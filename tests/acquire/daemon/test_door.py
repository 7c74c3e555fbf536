"""The daemon's socket under a flood: the arm can be stopped, memory and threads are bounded."""

from __future__ import annotations

import contextlib
import json
import resource
import socket
import subprocess
import sys
import threading
import time

import pytest

from acquire.daemon import connection, door, request_reader
from acquire.daemon import server as api
from acquire.daemon.client import DaemonClient
from acquire.daemon.server import ApiServer
from acquire.errors import DaemonBusy, DaemonError, DaemonSilent

MANY = 1200
"""connections that a flood holds open"""
PROMPT_S = 0.2
"""longest time that stopping may take"""

SERVER = """
import resource, sys
from pathlib import Path
from acquire.daemon.server import ApiServer
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[2]),) * 2)
complaints = []
server = ApiServer(
    Path(sys.argv[1]),
    {"striker.stop": lambda *_: {}, "status": lambda *_: {"accepting": server.accepting, "said": complaints}},
    urgent={"striker.stop"},
    complain=complaints.append,
)
print("ready", flush=True)
sys.stdin.readline()
server.close()
"""


@contextlib.contextmanager
def serving(path, files=1024):
    """A server in a process of its own, which may have so many files open."""
    command = [sys.executable, "-c", SERVER, str(path), str(files)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "ready\n"
            yield
        finally:
            process.stdin.close()
            assert process.wait(20) == 0


@pytest.fixture
def many_files():
    """Let this process hold a flood's connections."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 2 * MANY + 500), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def connected(path, sent=b""):
    sock = socket.socket(socket.AF_UNIX)
    while True:
        try:
            sock.connect(str(path))
        except BlockingIOError:
            time.sleep(0.001)
        else:
            break
    sock.sendall(sent)
    return sock


def stop_s(path):
    """Time that `acquire stop` takes [s]."""
    began = time.monotonic()
    with DaemonClient(path, patience_s=2.0) as client:
        assert client.call("striker.stop") == {}
    return time.monotonic() - began


@pytest.mark.parametrize(
    "sent", [b"", b"{", *(b'{"id": 1, "method": "%s"}\n' % each for each in (b"status", b"striker.stop"))]
)
def test_the_arm_can_be_stopped_while_thousands_are_connected(tmp_path, many_files, sent):
    path = tmp_path / "d" / "d.sock"
    with serving(path), contextlib.ExitStack() as flood:
        took = []
        for number in range(MANY):
            with contextlib.suppress(BrokenPipeError):
                flood.enter_context(connected(path, sent))
            if number % 200 == 199:
                took.append(stop_s(path))
        took += [stop_s(path) for _ in range(5)]
        flood.close()
        took.append(stop_s(path))
        assert max(took) < 5 * PROMPT_S  # of a machine with other work; `make attack` states the times
        with DaemonClient(path) as client:
            assert client.call("status")["accepting"] is True


def test_connections_opened_and_closed_leave_nothing_behind(tmp_path):
    path = tmp_path / "d" / "d.sock"
    with serving(path):
        for _ in range(MANY):
            connected(path).close()
        assert stop_s(path) < 5 * PROMPT_S


def test_a_server_without_free_files_goes_on_and_says_so(tmp_path, many_files):
    """With too many files open the system refuses new connections; those that are silent make room."""
    path = tmp_path / "d" / "d.sock"
    with serving(path, files=60):
        with contextlib.ExitStack() as flood:
            for _ in range(90):
                flood.enter_context(connected(path))
            with DaemonClient(path) as client:
                status = client.call("status")
        assert status["accepting"] is True
        assert status["said"] == [
            "a program could not connect to the daemon (Too many open files); others are still taken"
        ]
        assert stop_s(path) < 5 * PROMPT_S


@pytest.fixture
def server(tmp_path):
    gate = threading.Event()
    handlers = {"echo": lambda _, params: params, "wait": lambda *_: gate.wait(20), "stop": lambda *_: {}}
    listening = ApiServer(tmp_path / "p" / "d.sock", handlers, urgent={"stop"})
    yield listening, tmp_path / "p" / "d.sock"
    gate.set()
    listening.close()


def test_beyond_the_places_only_urgent_requests_are_carried_out(server, monkeypatch):
    monkeypatch.setattr(api, "MAX_CLIENTS", 3)
    path = server[1]
    with contextlib.ExitStack() as clients:
        held = [clients.enter_context(DaemonClient(path)) for _ in range(3)]
        for client in held:
            client.call("echo")
        with DaemonClient(path) as late, pytest.raises(DaemonBusy, match="programs are connected"):
            late.call("echo")
        with DaemonClient(path) as late:
            assert late.call("stop") == {}
        monkeypatch.setattr(api, "YIELD_S", 0.0)
        with DaemonClient(path) as late, contextlib.suppress(DaemonBusy):
            late.call("echo")  # makes the idlest give up its place
        for _ in range(100):
            with DaemonClient(path) as late, contextlib.suppress(DaemonBusy):
                if late.call("echo", x=1) == {"x": 1}:
                    return
    pytest.fail("no idle client gave up its place")


def test_a_request_that_does_not_end_is_not_waited_for(server, monkeypatch):
    monkeypatch.setattr(door, "LINE_S", 0.1)
    monkeypatch.setattr(request_reader, "LINE_S", 0.1)
    whole = b'{"id": 1, "method": "echo"}\n'
    for first in (b"", whole):
        with connected(server[1], first) as sock, sock.makefile("rb") as stream:
            if first:
                assert json.loads(stream.readline())["result"] == {}
            sock.sendall(whole[:9])
            assert "a request did not end" in json.loads(stream.readline())["error"]["message"]
            assert stream.readline() == b""


def test_a_request_may_not_be_larger_than_stated(server, monkeypatch):
    monkeypatch.setattr(request_reader, "LINE_BYTES", 1000)
    monkeypatch.setattr(request_reader, "LARGE_BYTES", 1 << 20)
    with connected(server[1]) as sock, contextlib.suppress(OSError):
        sock.sendall(b"x" * (4 << 20))
        answer = json.loads(sock.makefile("rb").readline())
        assert answer["error"]["message"] == "a request may have 1 MiB"
    with DaemonClient(server[1]) as client:
        assert client.call("echo", text="y" * 5000) == {"text": "y" * 5000}


def test_one_client_at_a_time_sends_a_large_request(server, monkeypatch):
    """So that all together need no more memory than one: others wait for its end."""
    monkeypatch.setattr(door, "FIRST_BYTES", 500)
    monkeypatch.setattr(request_reader, "LINE_BYTES", 1000)
    monkeypatch.setattr(request_reader, "LINE_S", 0.5)
    with connected(server[1], b"x" * 5000) as slow, connected(server[1], b"x" * 5000) as other:
        said = [json.loads(each.makefile("rb").readline())["error"]["message"] for each in (slow, other)]
    assert sum("did not end" in each for each in said) == 2


def subscribed(path):
    """A client that the server has accepted as a subscriber."""
    sock = connected(path, b'{"id": 1, "method": "subscribe"}\n')
    with sock.makefile("rb") as stream:
        assert json.loads(stream.readline()) == {"id": 1, "result": {}}
    return sock


def assert_place_is_given_up(listening):
    for _ in range(200):
        if not listening._clients:
            return
        time.sleep(0.02)
    pytest.fail("the subscriber holds its place")


def test_a_subscriber_that_does_not_read_is_disconnected(server, monkeypatch):
    monkeypatch.setattr(connection, "SEND_S", 1.0)
    listening, path = server
    with subscribed(path):
        assert listening._clients
        for _ in range(3 * connection.MAX_EVENTS):
            listening.publish("state", {"text": "z" * 1000})
        assert_place_is_given_up(listening)


def test_a_subscriber_that_left_gives_up_its_place(server):
    listening, path = server
    with subscribed(path):
        assert listening._clients
    assert_place_is_given_up(listening)


def test_a_full_queue_is_waited_for(tmp_path):
    """As when the daemon's computer is busy for a moment: no reason to kill anything."""
    path = tmp_path / "d.sock"
    with socket.socket(socket.AF_UNIX) as listener, contextlib.ExitStack() as waiting:
        listener.bind(str(path))
        listener.listen(1)
        with contextlib.suppress(BlockingIOError):
            while True:
                sock = waiting.enter_context(socket.socket(socket.AF_UNIX))
                sock.setblocking(False)
                sock.connect(str(path))
        threading.Timer(0.3, lambda: [waiting.enter_context(listener.accept()[0]) for _ in range(2)]).start()
        DaemonClient(path, patience_s=5.0).close()
        for _ in range(2):
            with contextlib.suppress(DaemonSilent):
                waiting.enter_context(DaemonClient(path, patience_s=0.1))
        with pytest.raises(DaemonSilent, match=r"no connection for 0\.1 s"):
            DaemonClient(path, patience_s=0.1)


@pytest.mark.parametrize(("mode", "refused"), [(0o777, True), (0o1777, False), (0o755, False)])
def test_a_folder_in_which_others_may_put_theirs_is_refused(tmp_path, mode, refused):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(mode)
    if refused:
        with pytest.raises(DaemonError, match=r"every user may replace the daemon's socket.*chmod o-w"):
            ApiServer(shared / "p" / "d.sock", {})
    else:
        ApiServer(shared / "p" / "d.sock", {}).close()
