"""Browsers that look on: they read the console's events and live images, until standard input ends.

`python -m tests.benchmarks.console_browsers HOST COOKIE NUMBER`
"""

from __future__ import annotations

import contextlib
import http.client
import sys
import threading


def _read(host: str, cookie: str, path: str) -> None:
    connection = http.client.HTTPConnection(host)
    with contextlib.suppress(OSError, http.client.HTTPException):
        connection.request("GET", path, headers={"Cookie": cookie})
        answer = connection.getresponse()
        while answer.read1(1 << 16):
            pass


def main() -> None:
    """Read events and live images of as many browsers as asked for."""
    host, cookie, number = sys.argv[1], sys.argv[2], int(sys.argv[3])
    for _ in range(number):
        for path in ("/api/events", "/api/preview.mjpeg"):
            threading.Thread(target=_read, args=(host, cookie, path), daemon=True).start()
    sys.stdin.read()


if __name__ == "__main__":
    main()
