"""Reports that take seconds to make: the browser gets a page that waits, and loads the report by itself."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, Response

REPORT_POLICY: Final = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; font-src data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""Content-Security-Policy of a report: a page of its own that reaches neither the console nor the network"""
WAIT_S: Final = 1.0
"""time in which a report that is kept is answered, without a page that waits [s]"""
WAITING_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark"><title>Report – Percuss</title>
<style>body{font:1.1rem/1.5 system-ui,sans-serif;max-width:34rem;margin:18vh auto 0;padding:0 1.2rem}
h1{font-size:1.6rem;margin:0 0 .4rem}progress{width:100%;height:.6rem;margin-top:1rem}</style></head>
<body><h1>The report is being made</h1>
<p>All strikes are read again, from the recorded images: some ten seconds, longer while a session runs. The
report appears here by itself.</p><progress aria-label="making the report"></progress></body></html>
"""


class ReportWait:
    """Reports that are being made, each once however many pages wait for it."""

    def __init__(self) -> None:
        self._tasks: dict[str, asyncio.Task[Path]] = {}

    async def answer(self, recording_id: str, report: Callable[[str], Path]) -> Response:
        """The report, or with status 202 a page that asks for it again every second.

        Args:
            recording_id: id of the recording.
            report: function that makes the report and returns its path; called in a thread.

        Raises:
            Exception: raised by `report`; the next request makes the report anew.
        """
        task = self._tasks.get(recording_id)
        if task is None:
            task = asyncio.ensure_future(run_in_threadpool(report, recording_id))
            self._tasks[recording_id] = task
        done, _ = await asyncio.wait({task}, timeout=WAIT_S)
        if not done:
            headers = {
                "refresh": "1",
                "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'",
            }
            return Response(WAITING_PAGE, 202, headers, "text/html")
        self._tasks.pop(recording_id, None)
        return FileResponse(
            task.result(), media_type="text/html", headers={"content-security-policy": REPORT_POLICY}
        )
