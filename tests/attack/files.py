"""Attack by files: damaged ones of every kind through every command that reads them."""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.attack.copies import copy_folder, whole_targets
from tests.attack.findings import Finding, Tally
from tests.attack.forked import Outcome, run_forked
from tests.attack.judge import STATED_LOSS, judge, last_words
from tests.attack.mutations import Damage, damage
from tests.attack.targets import Target, Verb, read_all

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
    targets = whole_targets(folder)
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


def _run(target: Target, verb: Verb, hurt: Damage | None, folder: Path) -> Outcome:
    """Run a command in a copy of the target's folder, in which the file is damaged (None: whole)."""
    case = copy_folder(target, folder)
    if hurt is not None:
        (case / target.file).unlink()
        (case / target.file).write_bytes(hurt.data)
    return run_forked(verb.call(target.file), case, folder)


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
    yield from judge(what, target, outcome, case)
    if not target.replaceable and (case / target.file).read_bytes() != hurt.data:
        yield Finding("source changed", what, last_words(outcome))
    if verb.same and wanted is not None and not hurt.forged:
        yield from _silent(verb, what, outcome, wanted, case)


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
