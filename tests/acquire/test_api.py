"""The local socket: private, answers in order, carries errors as their own class, survives bad requests."""

from __future__ import annotations

import json
import os
import socket
import stat
import threading

import pytest

from acquire.api import ApiServer, DaemonClient
from acquire.errors import DaemonBusy, DaemonError, DaemonNotRunning, StrikerRefused


@pytest.fixture
def server(tmp_path):
    gate = threading.Event()

    def refuse(*_):
        raise StrikerRefused("not armed: call striker.arm first")

    def wait(*_):
        gate.wait(10)
        return {"waited": True}

    handlers = {"echo": lambda _, params: params, "refuse": refuse, "wait": wait, "gone": lambda connection, _: connection.gone}
    api = ApiServer(tmp_path / "private" / "d.sock", handlers)
    yield api, tmp_path / "private" / "d.sock", gate
    gate.set()
    api.close()


def test_it_answers(server):
    with DaemonClient(server[1]) as client:
        assert client.call("echo", a=1) == {"a": 1}
        assert client.call("gone") is False


def test_the_socket_is_private(server):
    path = server[1]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_folder_open_to_others_is_refused(tmp_path):
    (tmp_path / "open").mkdir(mode=0o755)
    (tmp_path / "open").chmod(0o755)
    with pytest.raises(DaemonError, match="chmod 700"):
        ApiServer(tmp_path / "open" / "d.sock", {})


def test_errors_arrive_as_their_own_class(server):
    with DaemonClient(server[1]) as client, pytest.raises(StrikerRefused, match="not armed"):
        client.call("refuse")


def test_unknown_methods_are_named(server):
    with DaemonClient(server[1]) as client, pytest.raises(DaemonError, match="unknown method 'dance'"):
        client.call("dance")


@pytest.mark.parametrize("line", [b"\n", b"{\n", b"[]\n", b'{"id": 1}\n', b'{"method": 5, "id": 1}\n', b"\xff\xfe\n"])
def test_bad_requests_get_an_error_and_the_connection_lives(server, line):
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(str(server[1]))
        stream = raw.makefile("rb")
        raw.sendall(line)
        assert "error" in json.loads(stream.readline())
        raw.sendall(b'{"id": 2, "method": "echo", "params": {"x": 1}}\n')
        assert json.loads(stream.readline()) == {"id": 2, "result": {"x": 1}}
        stream.close()


def test_a_slow_request_does_not_hold_up_another_client(server):
    _, path, gate = server
    with DaemonClient(path) as slow, DaemonClient(path) as quick:
        thread = threading.Thread(target=slow.call, args=("wait",))
        thread.start()
        assert quick.call("echo", b=2) == {"b": 2}
        gate.set()
        thread.join()


def test_subscribers_hear_events(server):
    api, path, _ = server
    client = DaemonClient(path)
    heard = []
    thread = threading.Thread(target=lambda: heard.extend(client.events()))
    thread.start()
    for _ in range(200):
        api.publish("state", {"state": "IDLE"})
        if heard:
            break
        thread.join(0.01)
    client.close()
    thread.join()
    assert heard[0] == {"event": "state", "state": "IDLE"}


def test_a_second_daemon_on_the_socket_is_refused(server):
    with pytest.raises(DaemonBusy, match="already listens"):
        ApiServer(server[1], {})


def test_a_socket_left_by_a_dead_daemon_is_taken_over(tmp_path):
    path = tmp_path / "private" / "d.sock"
    path.parent.mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    api = ApiServer(path, {})
    with DaemonClient(path):
        pass
    api.close()
    assert not path.exists()


def test_no_daemon_is_said_in_one_line(tmp_path):
    with pytest.raises(DaemonNotRunning, match="acquire run"):
        DaemonClient(tmp_path / "nothing.sock")


def test_another_users_connection_is_dropped(server, monkeypatch):
    monkeypatch.setattr("acquire.api._peer_uid", lambda _: os.getuid() + 1)
    with pytest.raises(DaemonNotRunning), DaemonClient(server[1]) as client:
        client.call("echo")
