"""The judge of the attack: each way in which a command may fail is a finding of its own kind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.attack.forked import CPU_S, MEMORY_BYTES, Outcome
from tests.attack.judge import judge
from tests.attack.targets import Target

LINE = "analyze: a.mcap: is empty: there is nothing to read\n"
REFUSED = Outcome(1, 0.1, 0.1, 10, "", LINE, hung=False)


@pytest.mark.parametrize(
    ("changes", "kinds"),
    [
        ({}, []),
        ({"code": 0, "complaint": ""}, []),
        ({"code": 3, "complaint": "lost: 1 message\nlost: 1 attachment\n"}, []),
        ({"hung": True}, ["hang"]),
        ({"cpu_s": CPU_S + 1}, ["hang"]),
        ({"code": 70}, ["traceback"]),
        ({"code": -9}, ["traceback"]),
        ({"complaint": f"Traceback (most recent call last)\n{LINE}"}, ["traceback"]),
        ({"complaint": LINE + LINE}, ["not one line"]),
        ({"complaint": LINE + "beyond the line\n"}, ["not one line"]),
        ({"complaint": f"note: 2 holes were closed\n{LINE}"}, []),
        ({"complaint": ""}, ["not one line"]),
        ({"complaint": "", "output": "FAIL  camera        does not answer"}, []),
        ({"complaint": f"a.py:3: RuntimeWarning: overflow\n{LINE}"}, ["not one line"]),
        ({"code": 0, "complaint": "[ WARN:0@1.2] global loadsave.cpp\n"}, ["not one line"]),
        ({"memory_bytes": MEMORY_BYTES + 1}, ["memory"]),
        ({"output": "\x1b[2J"}, ["control character"]),
        ({"output": "\u202egpj.exe"}, ["control character"]),
    ],
)
def test_each_failure_is_a_finding(tmp_path: Path, changes: dict[str, object], kinds: list[str]) -> None:
    outcome = replace(REFUSED, **changes)  # pyright: ignore[reportArgumentType]
    target = Target("recording", tmp_path, "a.mcap", ())
    assert [each.kind for each in judge("recording: inspect", target, outcome, tmp_path)] == kinds


def test_what_a_refused_command_leaves_behind_is_a_finding(tmp_path: Path) -> None:
    whole, case = tmp_path / "whole", tmp_path / "case"
    for folder in (whole, case):
        folder.mkdir()
        (folder / "a.mcap").touch()
    (case / "new.mcap").touch()
    target = Target("recording", whole, "a.mcap", ())
    (found,) = judge("recording: recover", target, REFUSED, case)
    assert found.kind == "left behind"
    assert "new.mcap" in found.text
    assert not list(judge("recording: recover", target, replace(REFUSED, code=0, complaint=""), case))
