"""Reports that take longer than a browser should wait in silence."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from acquire.console.web import report_wait
from acquire.console.web.refusal import Refusal
from acquire.console.web.report_wait import ReportWait


def test_pages_wait_for_one_report_that_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report_wait, "WAIT_S", 0.05)
    made, asked = threading.Event(), []
    page = tmp_path / "report.html"
    page.write_text("centre of mass", encoding="utf-8")

    def report(recording_id: str) -> Path:
        asked.append(recording_id)
        made.wait(10)
        return page

    async def ask() -> None:
        wait = ReportWait()
        first, second = await asyncio.gather(wait.answer("r0", report), wait.answer("r0", report))
        assert (first.status_code, second.status_code) == (202, 202)
        assert first.headers["refresh"] == "1"
        assert b"appears here by itself" in bytes(first.body)
        made.set()
        while (last := await wait.answer("r0", report)).status_code == 202:
            pass
        assert last.headers["content-security-policy"].startswith("sandbox")

    asyncio.run(ask())
    assert asked == ["r0"]


def test_a_refused_report_is_refused_to_the_page_that_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report_wait, "WAIT_S", 0.0)

    def report(_: str) -> Path:
        raise Refusal(409, "NotComplete", "cut short")

    async def ask() -> None:
        wait = ReportWait()

        async def load_until_answered() -> None:
            while (await wait.answer("r0", report)).status_code == 202:
                pass

        for _ in range(2):  # a reload tries again
            with pytest.raises(Refusal, match="cut short"):
                await load_until_answered()

    asyncio.run(ask())
