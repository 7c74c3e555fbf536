"""Connection to the virtual world with which tests push the object, read the state and cause faults."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from acquire.virtual.operator_link import OperatorLink


class WorldLink(OperatorLink):
    """Connection to the control socket of the virtual world's process, with all its requests."""

    def push(self, p_world: ArrayLike, impulse_world: ArrayLike, duration_s: float) -> None:
        """Start to push the object like a finger; returns at once.

        Args:
            p_world: (3,) point of contact in W, the world frame [m].
            impulse_world: (3,) total impulse in W [N s].
            duration_s: duration of the contact, 0.002 to 0.1.

        Raises:
            AcquireError: the duration is out of range, another push is under way, or the world does not
                answer.
        """
        self._call(
            "push",
            p_world=np.asarray(p_world, dtype=float).tolist(),
            impulse_world=np.asarray(impulse_world, dtype=float).tolist(),
            duration_s=duration_s,
        )

    def state(self) -> dict[str, Any]:
        """Current state of the virtual world.

        Keys: time_ns (host monotonic), at_rest (True if the object rests), arm_angle [rad], arm_velocity
        [rad/s], p_world_object (3 values, m), q_world_object_wxyz (4 values, from the object's frame to the
        world's), and stale_ns: the largest delay of the physics behind the servo's answers since the last
        call, 0 if the computer kept up.

        Raises:
            AcquireError: the world does not answer.
        """
        return self._call("state")

    def servo(self, what: str) -> None:
        """Cause or end a fault of the virtual servo.

        Args:
            what: "unplug" (remove its port), "plug in" (restore the port), or "overload" (a hardware error,
                which a reboot of the servo clears).

        Raises:
            AcquireError: the request is unknown or impossible now, or the world does not answer.
        """
        self._call("servo", what=what)

    def quit(self) -> None:
        """Ask the virtual world's process to end; returns before it has ended.

        Raises:
            AcquireError: the world does not answer.
        """
        self._call("quit")
