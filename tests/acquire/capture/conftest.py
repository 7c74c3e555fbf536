"""Fixture of the environment of a capture process with a synthetic camera."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from tests.places import ROOT


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    yield monkeypatch
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("capture")] == []
