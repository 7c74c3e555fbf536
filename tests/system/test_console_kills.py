"""Console, operator's browser, estimator and daemon killed at random moments of sessions: nothing is lost.

    python -m pytest -m slow tests/system/test_console_kills.py

Sessions stop themselves, and go on with the recordings so far after each death of the daemon. Every strike
that the console once showed with a verdict must be in a recording at the end.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from acquire.console.web.client import ConsoleClient, ConsoleRefused
from acquire.console.web.orders import StartSession
from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError
from analyze.api import load
from tests.system.test_adaptive_session import children_of
from tests.system.test_console import Bench, bench, is_over, wait

__all__ = ["bench"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

KILLS = int(os.environ.get("PERCUSS_KILLS", "12"))
"""number of kills; the figures in docs/reference/faults.md are for 30"""
VICTIMS = ("console", "browser", "estimator", "daemon")
SHARES = (0.3, 0.3, 0.25, 0.15)
PAUSE_S = (2.0, 9.0)
"""shortest and longest time between two kills [s]"""
SESSION_S = 240.0


def is_open(bench: Bench) -> bool:
    """True while a recording is open or being finished."""
    with DaemonClient(bench.socket) as client:
        return client.call("status")["recording"] is not None


class Killer:
    """Operator of a bench whose programs are killed: answers prompts, and mends what died."""

    def __init__(self, bench: Bench, seed: int) -> None:
        self.bench = bench
        self.rng = np.random.default_rng(seed)
        self.killed: dict[str, int] = dict.fromkeys(VICTIMS, 0)
        self.shown: dict[str, set[str]] = {}
        """ids of the strikes that the console showed with a verdict, by the recording's file"""
        self.console = bench.start_console()
        self.client = self.attach()
        self.answered = -1
        self.unfinished: list[str] = []
        """files of the session that the daemon's death ended, to go on with"""

    @property
    def kills(self) -> int:
        return sum(self.killed.values())

    def attach(self) -> ConsoleClient:
        client = self.bench.client()
        client.take_over()
        return client

    def begin(self) -> None:
        """Start the daemon if it is dead, and a session; go on with one that the daemon's death ended."""
        wait(self.client, lambda state: bool(state.choices.plans))
        with contextlib.suppress(ConsoleRefused):  # it runs already
            time.sleep(1.5)  # until the console knows whether the daemon is alive
            self.client.start_daemon()
        self.recover()
        wait(self.client, lambda state: not is_open(self.bench))
        choices = self.client.state().choices
        kept = [entry for entry in self.client.archive() if entry.complete and entry.strikes]
        done = [entry.id for entry in kept if entry.file in self.unfinished]
        self.client.start_session(
            StartSession(
                object_id=choices.objects[0].id,
                plan_id=choices.plans[0].id,
                name=f"k{len(self.shown)}-{self.kills}",
                until="com=0.3mm",
                max_strikes=6,
                countdown_s=0,
                resume=done,
                override="a test",
            )
        )

    def recover(self) -> None:
        """Rebuild recordings that were cut short, as an operator would."""
        end_s = time.monotonic() + 20.0
        while (parts := list(self.bench.recordings.glob("*.part"))) and time.monotonic() < end_s:
            time.sleep(0.5)  # the capture process finishes its file by itself
        for part in parts:
            command = [sys.executable, "-m", "acquire", "recover", str(part)]
            subprocess.run(command, check=True, capture_output=True)
            part.unlink(missing_ok=True)

    def look(self) -> bool:
        """Answer a prompt, note the strikes shown, release a hold; True if the session is over."""
        state = self.client.state()
        session = state.session
        if session is not None:
            seen = self.shown.setdefault(Path(session.file).name, set())
            seen |= {strike.id for strike in session.strikes}
            if session.paused:
                with contextlib.suppress(AcquireError):
                    self.client.resume()
        if state.prompt is not None and state.prompt.id != self.answered and state.prompt.hands_off:
            with contextlib.suppress(AcquireError):
                self.client.answer(state.prompt.id)
                self.answered = state.prompt.id
        return not state.daemon.running or is_over(state)

    def kill(self) -> None:
        victim = str(self.rng.choice(VICTIMS, p=SHARES))
        if victim == "console":
            self.console.kill()
            self.console.wait()
            self.client.close()
            self.console = self.bench.start_console()
            self.client = self.attach()
        elif victim == "browser":
            self.client.close()
            time.sleep(float(self.rng.uniform(0.2, 3.0)))
            self.client = self.attach()
        else:
            with DaemonClient(self.bench.socket) as client:
                daemon = int(client.call("status")["pid"])
            victims = [daemon] if victim == "daemon" else children_of(daemon, "analyze advise")
            if victim == "daemon":
                self.unfinished.append(next(reversed(self.shown), ""))
            for pid in victims:
                os.kill(pid, signal.SIGKILL)
            if not victims:
                return
        self.killed[victim] += 1


def test_programs_killed_at_random_moments_lose_no_strike(bench: Bench) -> None:
    plan = bench.folder / "plan.json"
    command = ["plan", bench.folder / "carton.toml", "--rig", bench.rig_file, "--no-cards", "-o", plan]
    subprocess.run([sys.executable, "-m", "analyze", *map(str, command)], check=True, capture_output=True)
    killer = Killer(bench, 27)
    while killer.kills < KILLS:
        killer.begin()
        before = killer.killed["daemon"]
        killer.answered, end_s = -1, time.monotonic() + SESSION_S
        next_s = time.monotonic() + float(killer.rng.uniform(*PAUSE_S))
        while not killer.look():
            assert time.monotonic() < end_s, killer.client.state().model_dump_json()
            if time.monotonic() > next_s and killer.kills < KILLS:
                killer.kill()
                next_s = time.monotonic() + float(killer.rng.uniform(*PAUSE_S))
            time.sleep(0.1)
        if killer.killed["daemon"] == before:
            killer.unfinished.clear()
    killer.recover()
    killer.client.close()
    kept = {path.name: set(load(path).strike_ids) for path in bench.recordings.glob("*.mcap")}
    sys.stdout.write(f"{killer.killed}; {sum(map(len, kept.values()))} strikes in {len(kept)} recordings\n")
    for name, shown in killer.shown.items():
        in_series = set().union(*(ids for each, ids in kept.items() if each.startswith(Path(name).stem)))
        assert shown <= in_series, (name, shown - in_series, kept)
    assert killer.kills >= KILLS
