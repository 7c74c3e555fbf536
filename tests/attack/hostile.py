"""Attack by hostile files: each through every command that reads its kind, within limits."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.attack.files import ALLOWED, KEPT, _is_one_line, _linked, _targets
from tests.attack.findings import Finding, Tally
from tests.attack.forked import CPU_S, MEMORY_BYTES, Outcome, run_forked
from tests.attack.hostile_files import Hostile, fitting, hostile_files
from tests.attack.targets import Target, Verb

_COMMANDS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""characters that command a terminal or turn the order of writing"""


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
    targets = _targets(folder)
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
    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    shutil.copytree(target.folder, case, copy_function=_linked)
    (case / target.file).unlink()
    file.rename(case / target.file)
    outcome = run_forked(verb.call(target.file), case, folder)
    (case / target.file).rename(file)
    found = list(_problems(f"{target.kind}: {verb.name}, {hostile.name}", outcome))
    return Tally(f"hostile {target.kind}: {verb.name}", 1, outcome.memory_bytes, outcome.wall_s, found)


def _problems(what: str, outcome: Outcome) -> Iterator[Finding]:
    said = (outcome.complaint or outcome.output)[-KEPT:]
    if outcome.hung or outcome.cpu_s > CPU_S:
        yield Finding("hang", what, f"{outcome.cpu_s:.0f} s of CPU in {outcome.wall_s:.0f} s; {said}")
    elif outcome.code not in ALLOWED or "Traceback (most recent" in outcome.complaint:
        yield Finding("traceback", what, f"exit {outcome.code}: {said}")
    elif not _is_one_line(outcome):
        yield Finding("not one line", what, said)
    if outcome.memory_bytes > MEMORY_BYTES:
        yield Finding("memory", what, f"{outcome.memory_bytes / 1e6:.0f} MB; {said}")
    if _COMMANDS.search(outcome.output + outcome.complaint):
        yield Finding("control character", what, repr(said))
