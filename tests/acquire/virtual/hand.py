"""Virtual hand: taps the object in the virtual world whenever the manual striker waits for a person.

It follows the events of the daemon (the process that runs the rig) and taps the planned point with the
planned impulse, a few per cent off, some tenths of a second after the striker's release, and harder or less
hard if the session asks for that. Not modelled: a finger that follows the object, a tap at an angle, a second
contact.
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
from tests.acquire.virtual.world_link import WorldLink

REACTION_S = (0.3, 0.8)
"""range of the time from the release to the tap [s]"""
IMPULSE_SD = 0.03
"""relative standard deviation of the impulse"""
CONTACT_S = 0.006
"""duration of the contact [s]"""
HARDER, SOFTER = 1.15, 0.85
"""factors on the last impulse if the session asks for more or less"""


class VirtualHand:
    """Thread that taps the object at every release of the manual striker, from construction to `close`.

    Args:
        daemon_socket: path of the daemon's socket.
        world: control link of the virtual world.
        impulses_n_s: planned impulses [N s] by strike id; a copy is kept.
        seed: seed of reaction times and impulse errors.

    Raises:
        DaemonError: no daemon takes the connection.
    """

    def __init__(
        self, daemon_socket: Path, world: WorldLink, impulses_n_s: Mapping[str, float], seed: int
    ) -> None:
        self._world = world
        self._impulses = dict(impulses_n_s)
        self._rng = np.random.default_rng((seed, 0x4A2D))
        self._listener = DaemonClient(daemon_socket)
        self._thread = threading.Thread(target=self._run, name="virtual-hand")
        self._thread.start()

    def close(self) -> None:
        """Stop tapping: close the connection to the daemon and wait for the thread to end."""
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
