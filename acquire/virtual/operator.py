"""Virtual operator: answers the daemon's prompts by placing or tossing the object in the virtual world.

The daemon is the process that runs the rig; its prompts ask a person to place the object for the next strike.
The placing has a person's accuracy: yaw and position of the object and the striker's stand are off by a
little each time. A prompt for a strike with the object turned about the vertical is answered with a refusal,
because the virtual striker stands on one side only. A toss has a person's scatter too (toss.py). Not
modelled: a wrong face, an object that slips from the hand, an operator who forgets. In a rehearsal it only
places and tosses the object, and a person answers the prompts (except those that are refused).
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acquire.daemon.operator_client import OperatorClient
from acquire.errors import AcquireError
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.processes import end_rig
from acquire.virtual.toss import HOLD_S, TossKind

POSITION_SD_M = 0.0005
"""standard deviation of the object's position [m], along x and y"""
YAW_SD_RAD = np.radians(0.3)
"""standard deviation of the object's yaw [rad]"""
LONG_S = 1e6
"""time for which the object is held unless the prompt is answered [s]"""
STAND_SD_M = 0.0003
"""standard deviation of the distance and height at which the striker's stand is set [m]"""


class VirtualOperator:
    """Thread that answers the daemon's `place` and `toss` prompts from construction to `close`.

    Args:
        daemon_socket: path of the daemon's socket.
        world: client of the virtual world's control socket.
        seed: seed of the placing errors.
        answers: True to answer the prompts; False to place only, and leave the answer to a person. Prompts
            for strikes with the object turned about the vertical are refused in either case.
        tosses: what is wrong with each toss that is asked for, in order; the last one holds for all further.

    Raises:
        DaemonError: no daemon takes the connection.
    """

    def __init__(
        self,
        daemon_socket: Path,
        world: OperatorLink,
        seed: int,
        *,
        answers: bool = True,
        tosses: Sequence[TossKind] = (TossKind.GOOD,),
    ) -> None:
        self._answers = answers
        self._tosses, self._tossed = tuple(tosses), 0
        self._held = 0
        """number of the prompt for whose toss the object is held"""
        self._world = world
        self._rng = np.random.default_rng((seed, 0x0E7A))
        self._daemon = OperatorClient(daemon_socket)
        self._thread = threading.Thread(target=self._run, name="virtual-operator")
        self._thread.start()

    @property
    def connected(self) -> bool:
        """True until the daemon has ended or `close` was called."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Stop answering: close the connection to the daemon and wait for the thread to end."""
        self._daemon.close()
        self._thread.join()

    def _run(self) -> None:
        try:
            for event in self._daemon.events():
                if event["event"] == "answered" and event["prompt_id"] == self._held and event["ok"]:
                    self._world.let_go(HOLD_S)
                if event["event"] == "prompt" and not self._prepare(event):
                    return
        except AcquireError as error:
            end_rig(error)  # a session would wait for ever for an answer

    def _prepare(self, prompt: dict[str, Any]) -> bool:
        """Do what a prompt asks for, and answer it; False if it cannot be done, and nothing more can be."""
        do = {"place": self._place, "toss": self._hold}.get(prompt["kind"])
        if do is None:
            return True
        if prompt.get("heading_rad"):
            text = (
                "the virtual striker stands on one side of the pivot line only: "
                "plan without turned strikes (without --gravity)"
            )
            self._daemon.answer(prompt["prompt_id"], ok=False, text=text)
            return True
        try:
            do(prompt)
        except AcquireError as error:  # nobody else would answer, and the session wait for ever
            self._daemon.answer(prompt["prompt_id"], ok=False, text=str(error))
            return False
        if self._answers:
            self._daemon.answer(prompt["prompt_id"], ok=True)
        return True

    def _hold(self, prompt: dict[str, Any]) -> None:
        """Hold the object ready for a toss; the answer to the prompt lets it go."""
        kind = self._tosses[min(self._tossed, len(self._tosses) - 1)]
        self._tossed += 1
        self._held = prompt["prompt_id"]
        self._world.toss(prompt["toss"], kind.value, LONG_S)

    def _place(self, prompt: dict[str, Any]) -> None:
        yaw = self._rng.normal(0.0, YAW_SD_RAD)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        shift = np.array([*self._rng.normal(0.0, POSITION_SD_M, 2), 0.0])
        R_world_object = turn @ np.asarray(prompt["R_world_object"])
        p_world_object = turn @ np.asarray(prompt["p_world_object"]) + shift
        impact = turn @ np.asarray(prompt["impact_point_world"]) + shift
        # The stand is set to the object as it lies: the hanging arm almost touches the face.
        impact = impact + np.array(
            [-abs(self._rng.normal(0.0, STAND_SD_M)), 0.0, self._rng.normal(0.0, STAND_SD_M)]
        )
        impact[1] = 0.0
        self._world.place(R_world_object, p_world_object, impact)
