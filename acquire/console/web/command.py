"""The command `acquire console`: web server, rig and register of browsers together, until Ctrl-C."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from acquire.config import read_rig
from acquire.console.web.app import make_app
from acquire.console.web.rig_console import RigConsole
from acquire.console.web.routes import Site
from acquire.console.web.server import HOST, WebServer, ended_by_signals, listen
from acquire.console.web.visitors import Visitors

DEFAULT_PORT: Final = 8765


@dataclass(frozen=True)
class ConsoleOptions:
    """Options of `acquire console`."""

    rig: Path
    """rig file"""
    recordings: Path | None
    """folder of the recordings; None for that of the rig file"""
    objects: Path
    """folder of objects and plans"""
    port: int
    """port; 0 for one that is free"""
    browser: bool
    """True to open the page in a browser"""


def run_console(options: ConsoleOptions) -> None:
    """Serve the console until Ctrl-C, SIGTERM or SIGHUP.

    Raises:
        ConfigError: the rig file cannot be used.
        AcquireError: the port is taken.
    """
    rig = read_rig(options.rig)
    recordings = options.recordings or Path(rig.recorder.directory)
    with contextlib.ExitStack() as cleanup:
        listener = cleanup.enter_context(listen(options.port))
        port = listener.getsockname()[1]
        address = f"http://{HOST}:{port}"

        def print_address(words: str = "for a further browser") -> str:
            url = f"{address}/?token={visitors.new_token()}"
            sys.stdout.write(f"{words}: {url}\n")
            sys.stdout.flush()
            return url

        visitors = Visitors(on_redeemed=print_address)
        console = RigConsole(options.rig, recordings, options.objects, lambda: visitors.operator_present)
        cleanup.callback(console.close)
        site = Site(console, visitors, address)
        cleanup.callback(site.stopping.shutdown)
        server = WebServer(make_app(site, port), listener, site.ended)
        key_file = key_path(rig.daemon.socket_path())
        cleanup.enter_context(_key_for_scripts(key_file, site.address, visitors.new_key()))
        url = print_address("console, for one browser")
        if options.browser:
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
        with ended_by_signals(server.end):
            server.run()


def key_path(socket: Path) -> Path:
    """Path of the file with address and key for scripts, beside the daemon's socket."""
    return socket.with_name(f"{socket.name}.console.json")


@contextlib.contextmanager
def _key_for_scripts(path: Path, url: str, key: str) -> Iterator[None]:
    """Write the address and key for scripts of this user to a private file; delete it at the end."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    new = path.with_name(f"{path.name}.{os.getpid()}")
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump({"url": url, "key": key, "pid": os.getpid()}, file)
    new.replace(path)
    try:
        yield
    finally:
        with contextlib.suppress(OSError, ValueError):
            if json.loads(path.read_text(encoding="utf-8"))["pid"] == os.getpid():
                path.unlink()
