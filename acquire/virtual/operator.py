"""Virtual operator: answers the daemon's prompts by placing the object in the virtual world.

The daemon is the process that runs the rig; its prompts ask a person to place the object for the next strike.
The placing has a person's accuracy: yaw and position of the object and the striker's stand are off by a
little each time. A prompt for a strike with the object turned about the vertical is answered with a refusal,
because the virtual striker stands on one side only. Not modelled: a wrong face, an object that slips from the
hand, an operator who forgets. In a rehearsal it only places the object, and a person answers the prompts
(except those that are refused).
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np

from acquire.daemon.operator_client import OperatorClient
from acquire.errors import AcquireError
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.processes import end_rig

POSITION_SD_M = 0.0005
"""standard deviation of the object's position [m], along x and y"""
YAW_SD_RAD = np.radians(0.3)
"""standard deviation of the object's yaw [rad]"""
STAND_SD_M = 0.0003
"""standard deviation of the distance and height at which the striker's stand is set [m]"""


class VirtualOperator:
    """Thread that answers the daemon's `place` prompts from construction to `close`.

    Args:
        daemon_socket: path of the daemon's socket.
        world: client of the virtual world's control socket.
        seed: seed of the placing errors.
        answers: True to answer the prompts; False to place only, and leave the answer to a person. Prompts
            for strikes with the object turned about the vertical are refused in either case.

    Raises:
        DaemonError: no daemon takes the connection.
    """

    def __init__(self, daemon_socket: Path, world: OperatorLink, seed: int, *, answers: bool = True) -> None:
        self._answers = answers
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
                if event["event"] == "prompt" and event["kind"] == "place":
                    if event.get("heading_rad"):
                        text = (
                            "the virtual striker stands on one side of the pivot line only: "
                            "plan without turned strikes (without --gravity)"
                        )
                        self._daemon.answer(event["prompt_id"], ok=False, text=text)
                        continue
                    try:
                        self._place(event)
                    except AcquireError as error:  # nobody else would answer, and the session wait for ever
                        self._daemon.answer(event["prompt_id"], ok=False, text=str(error))
                        return
                    if self._answers:
                        self._daemon.answer(event["prompt_id"], ok=True)
        except AcquireError as error:
            end_rig(error)  # a session would wait for ever for an answer

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
