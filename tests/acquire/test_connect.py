"""`acquire.connect()`: a client for scripts, and nothing heavy imported before it is called."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest

import acquire
from acquire.daemon.server import ApiServer
from acquire.errors import DaemonNotRunning


def test_a_script_reads_stops_and_listens(tmp_path: Path) -> None:
    path = tmp_path / "private" / "d.sock"
    stops: list[object] = []
    handlers = {
        "status": lambda *_: {"striker": "HOMED"},
        "striker.strike": lambda _, params: {"outcome": "CONTACT", **params},
        "striker.stop": lambda *_: stops.append(None),
    }
    server = ApiServer(path, handlers)
    try:
        with acquire.connect(path) as daemon:
            assert daemon.call("status") == {"striker": "HOMED"}
            assert daemon.call("striker.strike", strike_id="1", tip_speed_m_s=0.3)["tip_speed_m_s"] == 0.3
            daemon.call("striker.stop")
            assert len(stops) == 1
        with acquire.connect(str(path)) as listener:
            answered = threading.Event()
            publishing = threading.Thread(target=_publish_until, args=(server, answered))
            publishing.start()
            assert next(listener.events()) == {"event": "state", "state": "ARMED"}
            answered.set()
            publishing.join()
    finally:
        server.close()


def _publish_until(server: ApiServer, answered: threading.Event) -> None:
    while not answered.wait(0.01):
        server.publish("state", {"state": "ARMED"})


def test_without_a_daemon_the_default_socket_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(DaemonNotRunning, match="acquire run"):
        acquire.connect()


def test_importing_the_package_imports_nothing_heavy() -> None:
    heavy = "'numpy', 'pydantic', 'socket'"
    program = f"import sys, acquire; print([name for name in ({heavy}) if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_packages_are_typed() -> None:
    root = Path(acquire.__file__).parents[1]
    assert all((root / package / "py.typed").exists() for package in ("acquire", "analyze", "schemas"))
