"""Fixture of aligned memory for the direct recorder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.direct_io import can_write_directly


@pytest.fixture
def memory(tmp_path: Path) -> Iterator[BlockMemory]:
    if not can_write_directly(tmp_path):
        pytest.skip("this file system takes no O_DIRECT")
    memory = BlockMemory(8 << 20, 64 << 20)
    yield memory
    assert memory.free == memory.blocks, "every block was given back"
    assert memory.used_bytes == 0, "all that was borrowed too"
