"""The virtual hand: strikes where a manual striker waits for one. It hears the daemon's events over its API, as a person hears a beep.

It taps the planned point with the planned impulse, a few per cent off, some tenths of a second after it was told to; harder, or less hard,
where the session asks for that. What it does not model: a finger that follows the object, a tap at an angle, a second touch.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from acquire.daemon.api import DaemonClient
from acquire.errors import AcquireError
from acquire.virtual.operator_link import OperatorLink

REACTION_S = (0.3, 0.8)
IMPULSE_SD = 0.03
TOUCH_S = 0.006
HARDER, SOFTER = 1.15, 0.85
"""of the last impulse, where it was told so"""


class VirtualHand:
    """Taps at every release until closed; `impulses_n_s` by the plan's strike ids."""

    def __init__(self, daemon_socket: Path, world: OperatorLink, impulses_n_s: Mapping[str, float], seed: int) -> None:
        self._world = world
        self._impulses = dict(impulses_n_s)
        self._rng = np.random.default_rng((seed, 0x4A2D))
        self._listener = DaemonClient(daemon_socket)
        self._thread = threading.Thread(target=self._run, name="virtual-hand")
        self._thread.start()

    def close(self) -> None:
        """Take it away."""
        self._listener.close()
        self._thread.join()

    def _run(self) -> None:
        place = None
        with contextlib.suppress(AcquireError):
            for event in self._listener.events():
                if event["event"] == "prompt" and event["kind"] == "place":
                    place = event
                    self._impulses[event["strike_id"]] *= (
                        SOFTER if "less hard" in event["hint"] else HARDER if "harder" in event["hint"] else 1.0
                    )
                elif event["event"] == "striker" and event["kind"] == "RELEASED" and place is not None:
                    time.sleep(self._rng.uniform(*REACTION_S))
                    impulse = self._impulses[place["strike_id"]] * (1 + self._rng.normal(0.0, IMPULSE_SD))
                    self._world.push(place["impact_point_world"], (impulse, 0.0, 0.0), TOUCH_S)
