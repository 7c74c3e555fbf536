"""Attack by hostile files: each through every command that reads its kind, within limits."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from tests.attack.copies import copy_folder, whole_targets
from tests.attack.findings import Tally
from tests.attack.forked import run_forked
from tests.attack.hostile_files import Hostile, fitting, hostile_files
from tests.attack.judge import judge
from tests.attack.targets import Target, Verb


def attack_by_hostile_files(
    folder: Path, until_s: float, report: Callable[[Tally], None], *, short: bool = False
) -> None:
    """Run every fitting command on each hostile file, until `until_s` (monotonic) [s].

    Args:
        folder: folder for the files.
        until_s: end of the attack, by the monotonic clock [s].
        report: called with the tally of each try.
        short: True for some of the files, each through the first of its commands.
    """
    made = folder / "made"
    made.mkdir(parents=True, exist_ok=True)
    targets = whole_targets(folder)
    for hostile in hostile_files():
        for target in (each for each in targets if fitting(each, hostile)):
            if time.monotonic() > until_s or (short and hostile.slow):
                continue
            file = made / Path(target.file).name
            hostile.write(file)
            for verb in target.verbs[: 1 if short else None]:
                report(_try(hostile, target, verb, file, folder))
            file.unlink()


def _try(hostile: Hostile, target: Target, verb: Verb, file: Path, folder: Path) -> Tally:
    case = copy_folder(target, folder)
    (case / target.file).unlink()
    file.rename(case / target.file)
    outcome = run_forked(verb.call(target.file), case, folder)
    (case / target.file).rename(file)
    found = list(judge(f"{target.kind}: {verb.name}, {hostile.name}", target, outcome, case))
    return Tally(f"hostile {target.kind}: {verb.name}", 1, outcome.memory_bytes, outcome.wall_s, found)
