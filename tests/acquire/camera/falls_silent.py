"""A camera that stops answering while it is opened: a relay stops its process after some requests.

Only control (GVCP) is relayed: the relay has an address of its own, and a camera that is opened through it
never streams.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from acquire.camera.discovery import GVCP_PORT
from tests.loopback import loopback

_PATTERN_CAMERA = Path(__file__).with_name("pattern_camera.py")


@contextmanager
def falls_silent(host: int, answers: int) -> Iterator[str]:
    """Yield a relay's IP address; the camera behind it answers `answers` requests, then is stopped."""
    address, behind = loopback(host), loopback(host + 1)
    ended = threading.Event()
    with (
        subprocess.Popen(
            [sys.executable, str(_PATTERN_CAMERA), behind],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as camera,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as front,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as back,
    ):
        assert camera.stdout is not None
        assert camera.stdout.readline() == "ready\n"
        front.bind((address, GVCP_PORT))
        back.connect((behind, GVCP_PORT))
        for each in (front, back):
            each.settimeout(0.1)

        def relay() -> None:
            left = answers
            while not ended.is_set():
                try:
                    request, client = front.recvfrom(2048)
                    back.send(request)
                    if left:
                        front.sendto(back.recv(2048), client)
                except TimeoutError:
                    continue
                left -= left > 0
                if not left:
                    camera.send_signal(signal.SIGSTOP)

        if answers == 0:
            camera.send_signal(signal.SIGSTOP)
        thread = threading.Thread(target=relay, name="relay")
        thread.start()
        try:
            yield address
        finally:
            ended.set()
            thread.join()
            camera.kill()
