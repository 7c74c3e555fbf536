"""Attack by files: damaged ones of every kind through every command that reads them."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from tests.attack.findings import Finding, Tally
from tests.attack.forked import CPU_S, MEMORY_BYTES, Outcome, run_forked
from tests.attack.mutations import Damage, damage
from tests.attack.targets import Target, Verb, make_targets, read_all

KEPT = 400
"""characters of a complaint that a finding keeps"""
NOISE = re.compile(r"\[ ?WARN|\[\w+ @|lib\w+ (warning|error)|Corrupt |.*(Warning|Error): ")
"""lines of libraries that reach standard error: OpenCV, FFmpeg, libpng, libjpeg, Python's warnings"""
STATED_LOSS = 3
"""exit code of a command that states a loss"""
ALLOWED = {0, 1, 2, STATED_LOSS}
SHARE_OF_ANY = 0.15
"""share of the tries that draw from all commands alike; the others draw the quick ones more often"""


def attack_files(
    folder: Path, seed: int, until_s: float, report: Callable[[Tally], None], tries: float = math.inf
) -> None:
    """Damage files and run commands on them until `until_s` (monotonic) [s], or `tries` times.

    Args:
        folder: folder for the files; what led to a finding stays in its sub-folder `findings`.
        seed: seed of all damage.
        until_s: end of the attack, by the monotonic clock [s].
        report: called with the tally of each try.
        tries: number of tries after which to end.
    """
    rng = np.random.default_rng(seed)
    targets = _targets(folder)
    pairs = [(target, verb) for target in targets for verb in target.verbs]
    expected: dict[int, Any] = {}
    cost = np.array([verb.usual_s for _, verb in pairs])
    parent = os.getppid()
    while time.monotonic() < until_s and tries > 0 and os.getppid() == parent:
        tries -= 1
        chances = 1.0 / cost
        number = (
            int(rng.integers(len(pairs)))
            if rng.random() < SHARE_OF_ANY
            else int(rng.choice(len(pairs), p=chances / chances.sum()))
        )
        target, verb = pairs[number]
        if verb.same and number not in expected:
            expected[number] = _result(verb, _run(target, verb, None, folder), folder / "case")
        hurt = damage((target.folder / target.file).read_bytes(), rng, text=target.text)
        outcome = _run(target, verb, hurt, folder)
        cost[number] += 0.1 * (max(0.02, outcome.wall_s) - cost[number])
        found = list(_problems(target, verb, hurt, outcome, expected.get(number), folder / "case"))
        for finding in found:
            _keep(folder, target, hurt, finding)
        report(Tally(f"{target.kind}: {verb.name}", 1, outcome.memory_bytes, outcome.wall_s, found))


@cache
def _targets(folder: Path) -> list[Target]:
    """Write the whole files, in a process of its own: OpenCV's threads would not survive a fork."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(make_targets, folder / "whole").result()


def _run(target: Target, verb: Verb, hurt: Damage | None, folder: Path) -> Outcome:
    """Run a command in a copy of the target's folder, in which the file is damaged (None: whole)."""
    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    shutil.copytree(target.folder, case, copy_function=_linked)
    if hurt is not None:
        (case / target.file).unlink()
        (case / target.file).write_bytes(hurt.data)
    return run_forked(verb.call(target.file), case, folder)


def _linked(source: str, copy: str) -> None:
    Path(copy).hardlink_to(source)


def _result(verb: Verb, outcome: Outcome, case: Path) -> Any:
    """Result of a command that states one as JSON; None if it ended otherwise."""
    if outcome.code not in {0, STATED_LOSS}:
        return None
    if verb.name == "recover":
        with contextlib.suppress(SystemExit):
            return json.loads(read_all(case / "new.mcap"))
        return None
    return json.loads(outcome.output)


def _problems(
    target: Target, verb: Verb, hurt: Damage, outcome: Outcome, wanted: Any, case: Path
) -> Iterator[Finding]:
    """What is wrong with the way in which a command ended."""
    what = f"{target.kind}: {verb.name}, {hurt.name}"
    said = (outcome.complaint or outcome.output)[-KEPT:]
    if outcome.hung or outcome.cpu_s > CPU_S:
        yield Finding("hang", what, f"{outcome.cpu_s:.0f} s of CPU in {outcome.wall_s:.0f} s; {said}")
    elif outcome.code not in ALLOWED or "Traceback (most recent" in outcome.complaint:
        yield Finding("traceback", what, f"exit {outcome.code}: {said}")
    elif not _is_one_line(outcome):
        yield Finding("not one line", what, said)
    if outcome.memory_bytes > MEMORY_BYTES:
        yield Finding("memory", what, f"{outcome.memory_bytes / 1e6:.0f} MB; {said}")
    if any(ord(each) < 32 and each not in "\n\t\r" for each in outcome.output + outcome.complaint):
        yield Finding("control character", what, repr(said))
    if (case / target.file).read_bytes() != hurt.data:
        yield Finding("source changed", what, said)
    if outcome.code in {1, 2}:
        known = {path.name for path in target.folder.iterdir()}
        # A replay is kept as far as the recording can be read, and a batch's table holds the failure.
        if left := {path.name for path in case.iterdir()} - known - {"results", "new.rrd"}:
            yield Finding("left behind", what, f"{sorted(left)}; {said}")
    if verb.same and wanted is not None and not hurt.forged:
        yield from _silent(verb, what, outcome, wanted, case)


def _is_one_line(outcome: Outcome) -> bool:
    """True if a command that failed said so in one line, and no library spoke beside it."""
    lines = outcome.complaint.splitlines()
    if any(NOISE.match(line) for line in lines):
        return False
    own = sum(line.startswith(("analyze: ", "acquire: ")) for line in lines)
    return own == 1 or outcome.code not in {1, 2}


def _silent(verb: Verb, what: str, outcome: Outcome, wanted: Any, case: Path) -> Iterator[Finding]:
    """A result that differs from that of the whole file, without a word about a loss."""
    if outcome.code != 0:
        return
    found = _result(verb, outcome, case)
    if found != wanted:
        kind = "laundered" if verb.name == "recover" else "silent change"
        yield Finding(kind, what, f"differs in {_different(found, wanted)}")


def _different(found: Any, wanted: Any) -> str:
    if not isinstance(found, dict) or not isinstance(wanted, dict):
        return "the whole"
    return ", ".join(sorted(key for key in found.keys() | wanted.keys() if found.get(key) != wanted.get(key)))


def _keep(folder: Path, target: Target, hurt: Damage, finding: Finding) -> None:
    kept = folder / "findings"
    kept.mkdir(exist_ok=True)
    number = len(list(kept.glob("*.txt")))
    if number < 200:
        (kept / f"{number:03d}-{Path(target.file).name}").write_bytes(hurt.data)
        (kept / f"{number:03d}.txt").write_text(
            f"{finding.kind}\n{finding.what}\n{finding.text}\n", encoding="utf-8", errors="replace"
        )
