"""Processes of the attack: one damages files; the other sends requests, kills, and then damages files too."""

from __future__ import annotations

import multiprocessing
import os
import time
from pathlib import Path

from tests.attack.files import attack_files
from tests.attack.flood import attack_flood
from tests.attack.forked import import_everything
from tests.attack.hostile import attack_by_hostile_files
from tests.attack.kills import attack_kills
from tests.attack.requests import attack_requests

REQUESTS_PER_MINUTE, KILLS_PER_MINUTE = 2000, 1
HOSTILE_SHARE = 0.3
"""share of the time after which no more hostile files are tried"""
FIRST_SHARE = 0.6
"""share of the time after which no more requests are sent, and no process is killed"""


def attack_by_files(folder: Path, seed: int, until_s: float, tallies: multiprocessing.Queue) -> None:
    """Attack by files in this process, and put the tally of each try into `tallies`."""
    os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
    import_everything()
    if not seed % 2:  # once is enough
        now_s = time.monotonic()
        attack_by_hostile_files(folder, now_s + HOSTILE_SHARE * (until_s - now_s), tallies.put)
    attack_files(folder, seed, until_s, tallies.put)


def attack_by_others(
    folder: Path, seed: int, minutes: float, until_s: float, tallies: multiprocessing.Queue
) -> None:
    """Connections, requests and kills, then files for the rest of the time."""
    first_s = until_s - (1.0 - FIRST_SHARE) * 60.0 * minutes
    attack_flood(tallies.put)
    attack_requests(seed, round(REQUESTS_PER_MINUTE * minutes), first_s, tallies.put)
    attack_kills(seed, max(1, round(KILLS_PER_MINUTE * minutes)), first_s, tallies.put)
    if time.monotonic() < until_s:
        attack_by_files(folder, seed + 1, until_s, tallies)
