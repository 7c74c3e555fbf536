"""Virtual hand: strikes the object when a manual striker waits for it; it listens to the daemon's events.

It taps the planned point with the planned impulse, a few per cent off, some tenths of a second after the
request, and harder or less hard if the session asks for that. What it does not model: a finger that follows
the object, a tap at an angle, a second contact.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError
from acquire.virtual.operator_link import OperatorLink

REACTION_S = (0.3, 0.8)
"""range of the time from the release to the tap"""
IMPULSE_SD = 0.03
"""relative standard deviation of the impulse"""
CONTACT_S = 0.006
"""duration of the contact"""
HARDER, SOFTER = 1.15, 0.85
"""factors on the last impulse if the session asks for more or less"""


class VirtualHand:
    """Thread that taps the object at every release until closed.

    Args:
        daemon_socket: socket of the daemon.
        world: control link of the virtual world.
        impulses_n_s: impulses by the plan's strike ids.
        seed: seed of reaction time and impulse.
    """

    def __init__(
        self, daemon_socket: Path, world: OperatorLink, impulses_n_s: Mapping[str, float], seed: int
    ) -> None:
        self._world = world
        self._impulses = dict(impulses_n_s)
        self._rng = np.random.default_rng((seed, 0x4A2D))
        self._listener = DaemonClient(daemon_socket)
        self._thread = threading.Thread(target=self._run, name="virtual-hand")
        self._thread.start()

    def close(self) -> None:
        """Stop tapping."""
        self._listener.close()
        self._thread.join()

    def _run(self) -> None:
        place = None
        with contextlib.suppress(AcquireError):
            for event in self._listener.events():
                if event["event"] == "prompt" and event["kind"] == "place":
                    place = event
                    self._impulses[event["strike_id"]] *= _impulse_factor(event["hint"])
                elif event["event"] == "striker" and event["kind"] == "RELEASED" and place is not None:
                    time.sleep(self._rng.uniform(*REACTION_S))
                    impulse = self._impulses[place["strike_id"]] * (1 + self._rng.normal(0.0, IMPULSE_SD))
                    self._world.push(place["impact_point_world"], (impulse, 0.0, 0.0), CONTACT_S)


def _impulse_factor(hint: str) -> float:
    if "less hard" in hint:
        return SOFTER
    return HARDER if "harder" in hint else 1.0
