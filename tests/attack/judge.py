"""Judges how a command ended on a damaged or hostile file: each failure is a finding."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from tests.attack.findings import Finding
from tests.attack.forked import CPU_S, MEMORY_BYTES, Outcome
from tests.attack.targets import Target

KEPT = 400
"""characters of a complaint that a finding keeps"""
STATED_LOSS = 3
"""exit code of a command that states a loss"""
ALLOWED = {0, 1, 2, STATED_LOSS}
RESULTS_OF_FAILURES = {"results", "new.rrd"}
"""outputs that stay: a batch's table holds the failure, a replay what could be read"""
_NOISE = re.compile(r"\[ ?WARN|\[\w+ @|lib\w+ (warning|error)|Corrupt |.*(Warning|Error): ")
"""lines of libraries that reach standard error: OpenCV, FFmpeg, libpng, libjpeg, Python's warnings"""
_ANNOUNCED = re.compile(r"(analyze|acquire|note|s\d+): |s\d+:$|.*expected energy ratio |\s*$")
"""lines of a command that fails: complaint, remarks, and what `acquire strike` is about to do"""
_FAILED_CHECK = "FAIL  "
_COMMANDS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""characters that command a terminal or turn the order of writing"""


def judge(what: str, target: Target, outcome: Outcome, case: Path) -> Iterator[Finding]:
    """Yield the failures of a command.

    Args:
        what: kind of file, command and damage, for the findings.
        target: target whose file was damaged.
        outcome: how the command ended.
        case: working folder of the command, a copy of the target's folder.
    """
    said = last_words(outcome)
    if outcome.hung or outcome.cpu_s > CPU_S:
        yield Finding("hang", what, f"{outcome.cpu_s:.0f} s of CPU in {outcome.wall_s:.0f} s; {said}")
    elif outcome.code not in ALLOWED or "Traceback (most recent" in outcome.complaint:
        yield Finding("traceback", what, f"exit {outcome.code}: {said}")
    elif not is_one_line(outcome):
        yield Finding("not one line", what, said)
    if outcome.memory_bytes > MEMORY_BYTES:
        yield Finding("memory", what, f"{outcome.memory_bytes / 1e6:.0f} MB; {said}")
    if _COMMANDS.search(outcome.output + outcome.complaint):
        yield Finding("control character", what, repr(said))
    if outcome.code in {1, 2}:
        known = {path.name for path in target.folder.iterdir()}
        if left := {path.name for path in case.iterdir()} - known - RESULTS_OF_FAILURES:
            yield Finding("left behind", what, f"{sorted(left)}; {said}")


def last_words(outcome: Outcome) -> str:
    """End of a command's complaint or, without one, of its output."""
    return (outcome.complaint or outcome.output)[-KEPT:]


def is_one_line(outcome: Outcome) -> bool:
    """True if a command that failed reports so in one line, and no library writes beside it."""
    lines = outcome.complaint.splitlines()
    failed = outcome.code in {1, 2}
    if any(_NOISE.match(line) or (failed and not _ANNOUNCED.match(line)) for line in lines):
        return False
    own = sum(line.startswith(("analyze: ", "acquire: ")) for line in lines)
    # A failed check of a rig is a row of its table.
    return own == 1 or not failed or (not lines and _FAILED_CHECK in outcome.output)
