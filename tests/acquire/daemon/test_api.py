"""The daemon's socket is private, answers in order, returns errors by class, survives bad requests."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

from acquire.daemon import server as api
from acquire.daemon.client import DaemonClient, wait_for_socket
from acquire.daemon.server import ApiServer
from acquire.errors import DaemonBusy, DaemonError, DaemonNotRunning, DaemonSilent, StrikerRefused


@pytest.fixture
def server(tmp_path, monkeypatch):
    monkeypatch.setattr(api, "BUSY_S", 0.1)
    gate = threading.Event()

    def refuse(*_):
        raise StrikerRefused("not armed: call striker.arm first")

    def wait(*_):
        gate.wait(30)
        return {"waited": True}

    handlers = {
        "echo": lambda _, params: params,
        "refuse": refuse,
        "wait": wait,
        "gone": lambda connection, _: connection.gone,
    }
    listening = ApiServer(tmp_path / "private" / "d.sock", handlers)
    yield listening, tmp_path / "private" / "d.sock", gate
    gate.set()
    listening.close()


def test_a_request_is_answered(server):
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


@pytest.mark.parametrize(
    "line", [b"\n", b"{\n", b"[]\n", b'{"id": 1}\n', b'{"method": 5, "id": 1}\n', b"\xff\xfe\n"]
)
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


def test_subscribers_receive_events(server):
    listening, path, _ = server
    client = DaemonClient(path)
    heard = []
    thread = threading.Thread(target=lambda: heard.extend(client.events()))
    thread.start()
    for _ in range(200):
        listening.publish("state", {"state": "IDLE"})
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
    listening = ApiServer(path, {})
    with DaemonClient(path):
        pass
    listening.close()
    assert not path.exists()


def test_a_socket_left_by_a_dead_daemon_is_not_ready(tmp_path):
    path = tmp_path / "daemon.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))
    with pytest.raises(DaemonBusy):
        wait_for_socket(path, lambda: True, 0.1)


def test_a_missing_daemon_is_reported_in_one_line(tmp_path):
    with pytest.raises(DaemonNotRunning, match="acquire run"):
        DaemonClient(tmp_path / "nothing.sock")


REQUEST = """
import contextlib, os, socket, sys
if len(sys.argv) > 2:
    os.setgroups([])
    os.setgid(int(sys.argv[2]))
    os.setuid(int(sys.argv[2]))
with socket.socket(socket.AF_UNIX) as sock:
    try:
        sock.connect(sys.argv[1])
    except OSError as error:
        sys.exit(f"{type(error).__name__}")
    with contextlib.suppress(BrokenPipeError):  # refused before it spoke
        sock.sendall(b'{"id": 1, "method": "echo"}\\n')
    print(sock.makefile("rb").readline().decode(), end="")
"""
NOBODY = 65534


def send_request(path, *uid):
    """Send a request from another process, as user `uid` if given; return its output and error text."""
    done = subprocess.run(
        [sys.executable, "-c", REQUEST, str(path), *map(str, uid)],
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    return done.stdout, done.stderr.strip()


@pytest.fixture
def open_folder():
    """Folder that every user may enter, unlike the temporary folder of pytest."""
    with tempfile.TemporaryDirectory(prefix="pa-") as name:
        Path(name).chmod(0o755)
        yield Path(name)


def test_another_user_is_refused(open_folder):
    """The server refuses a peer by the user id that the kernel reports; the file modes permit access here.

    As root the test sends the request as another user. An ordinary user cannot do that: the server is then
    set to serve another user.
    """
    root = os.getuid() == 0
    served, speaker = (0, (NOBODY,)) if root else (os.getuid() + 1, ())
    listening = ApiServer(open_folder / "p" / "d.sock", {"echo": lambda _, params: params}, served_uid=served)
    try:
        (open_folder / "p").chmod(0o755)
        (open_folder / "p" / "d.sock").chmod(0o666)
        answer, _ = send_request(open_folder / "p" / "d.sock", *speaker)
        assert (
            f"serves only user {served}, not user {NOBODY if root else os.getuid()}"
            in json.loads(answer)["error"]["message"]
        )
        if not root:
            with (
                DaemonClient(open_folder / "p" / "d.sock") as client,
                pytest.raises(DaemonError, match="serves only user"),
            ):
                client.call("echo")
    finally:
        listening.close()


def test_another_user_cannot_reach_the_socket(open_folder):
    """The socket's folder and file modes alone keep out all users but the owner.

    As root, which can act as another user, the test also tries to enter.
    """
    listening = ApiServer(open_folder / "p" / "d.sock", {"echo": lambda _, params: params})
    try:
        assert stat.S_IMODE((open_folder / "p").lstat().st_mode) == 0o700
        if os.getuid() == 0:
            assert send_request(open_folder / "p" / "d.sock", NOBODY) == ("", "PermissionError")
            (open_folder / "p").chmod(0o755)  # the socket's own mode remains
            assert send_request(open_folder / "p" / "d.sock", NOBODY) == ("", "PermissionError")
        assert "result" in json.loads(send_request(open_folder / "p" / "d.sock")[0])
    finally:
        listening.close()


def test_a_client_refuses_a_daemon_of_another_user(server, monkeypatch):
    theirs = server[1].lstat().st_uid
    monkeypatch.setattr("acquire.daemon.client.os.getuid", lambda: theirs + 1)
    if theirs == 0:  # root's daemon would be trusted: the system is root's anyway
        with DaemonClient(server[1]):
            pass
        return
    with pytest.raises(DaemonError, match=f"belongs to user {theirs}"):
        DaemonClient(server[1])


def test_only_a_stale_socket_of_this_user_is_removed(tmp_path):
    folder = tmp_path / "private"
    folder.mkdir(mode=0o700)
    path = folder / "d.sock"
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DaemonError, match="is not a socket, and is left as it is"):
        ApiServer(path, {})
    assert path.is_symlink()
    path.unlink()
    path.write_text("mine")
    with pytest.raises(DaemonError, match="is not a socket, and is left as it is"):
        ApiServer(path, {})
    assert path.read_text() == "mine"


def test_a_socket_of_another_user_is_not_removed(tmp_path, monkeypatch):
    path = tmp_path / "private" / "d.sock"
    path.parent.mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as theirs:
        theirs.bind(str(path))
    found = os.stat_result((*path.lstat()[:4], os.getuid() + 1, *path.lstat()[5:10]))
    lstat = Path.lstat
    monkeypatch.setattr(Path, "lstat", lambda self: found if self == path else lstat(self))
    with pytest.raises(DaemonError, match=f"belongs to user {os.getuid() + 1}, and is left as it is"):
        ApiServer(path, {})
    assert path.is_socket()


def test_a_linked_folder_is_refused(tmp_path):
    (tmp_path / "real").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with pytest.raises(DaemonError, match="is a symbolic link"):
        ApiServer(tmp_path / "link" / "d.sock", {})


def test_a_hung_daemon_is_reported_in_one_line(tmp_path):
    """A socket that accepts connections and never answers, like that of a stopped process."""
    path = tmp_path / "d.sock"
    with socket.socket(socket.AF_UNIX) as hung:
        hung.bind(str(path))
        hung.listen(1)
        with DaemonClient(path, patience_s=0.2) as client, pytest.raises(DaemonSilent) as raised:
            client.call("status")
        assert str(raised.value) == (
            f"the daemon (process {os.getpid()}) has not answered 'status' for 0.2 s: it hangs: "
            f"end it with `kill -9 {os.getpid()}` and start it again with `acquire run RIG.toml`"
        )
        with contextlib.ExitStack() as waiting:
            with contextlib.suppress(BlockingIOError):
                while True:
                    client = waiting.enter_context(socket.socket(socket.AF_UNIX))
                    client.setblocking(False)
                    client.connect(str(path))
            with pytest.raises(DaemonSilent, match=r"has taken no connection for 0\.2 s"):
                DaemonClient(path, patience_s=0.2)


def test_a_client_waits_while_the_daemon_reports_busy(server, monkeypatch):
    """The answer takes more than three times the client's patience."""
    _, path, gate = server
    with DaemonClient(path, patience_s=6 * api.BUSY_S) as client:
        heard = []
        thread = threading.Thread(target=lambda: heard.append(client.call("wait")))
        start = time.monotonic()
        thread.start()
        thread.join(20 * api.BUSY_S)
        assert thread.is_alive()
        assert time.monotonic() - start > 3 * 6 * api.BUSY_S
        gate.set()
        thread.join()
        assert heard == [{"waited": True}]
        assert client.call("echo", a=1) == {"a": 1}  # no sign of life is taken for an answer


def test_a_client_that_does_not_read_blocks_no_other(server):
    """The socket of one client is full of answers; another client still receives its busy reports."""
    _, path, gate = server
    with socket.socket(socket.AF_UNIX) as deaf, DaemonClient(path, patience_s=8 * api.BUSY_S) as client:
        deaf.connect(str(path))
        request = json.dumps({"id": 1, "method": "echo", "params": {"x": "y" * 400_000}}).encode() + b"\n"
        deaf.settimeout(0.5)
        with contextlib.suppress(TimeoutError):
            for _ in range(20):
                deaf.sendall(request)
        thread = threading.Thread(target=lambda: (time.sleep(12 * api.BUSY_S), gate.set()))
        thread.start()
        assert client.call("wait") == {"waited": True}
        thread.join()
