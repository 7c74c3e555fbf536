"""Client of the virtual world's control socket: put the object down, ask how things are, fetch the truth, quit. One JSON line each way."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from acquire.errors import AcquireError

TIMEOUT_S = 5.0


class OperatorLink:
    """A connection to `world.sock`; one thread owns it.

    Raises:
        AcquireError: nobody listens there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(TIMEOUT_S)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise AcquireError(
                f"{path}: the virtual world does not answer ({error.strerror}): start acquire.virtual.world_process"
            ) from None
        self._lines = self._socket.makefile("rb")

    def place(self, R_world_object: ArrayLike, p_world_object: ArrayLike, impact_point_world: ArrayLike) -> None:
        """Put the object down and set the striker's stand; returns at once, the object settles within 10 ms.

        Args:
            R_world_object: (3, 3).
            p_world_object: (3,) m; the object is let go just over the table whatever its z.
            impact_point_world: (3,) m, where the hanging arm's tip touches.

        Raises:
            AcquireError: refused, or the world is gone.
        """
        self._call(
            "place",
            R_world_object=np.asarray(R_world_object, dtype=float).tolist(),
            p_world_object=np.asarray(p_world_object, dtype=float).tolist(),
            impact_point_world=np.asarray(impact_point_world, dtype=float).tolist(),
        )

    def push(self, p_world: ArrayLike, impulse_world: ArrayLike, duration_s: float) -> None:
        """Push the object with a finger; returns at once.

        Args:
            p_world: (3,) m, where.
            impulse_world: (3,) N s.
            duration_s: of the touch.

        Raises:
            AcquireError: refused, or the world is gone.
        """
        self._call(
            "push",
            p_world=np.asarray(p_world, dtype=float).tolist(),
            impulse_world=np.asarray(impulse_world, dtype=float).tolist(),
            duration_s=duration_s,
        )

    def state(self) -> dict[str, Any]:
        """Now: time_ns, at_rest, arm_angle, arm_velocity, p_world_object, q_world_object_wxyz.

        stale_ns: since it was last asked, the worst by which the servo's answers were older than they say; 0 where the computer kept up.
        """
        return self._call("state")

    def truth(self) -> str:
        """Path of the world's log (see truth_file), complete up to now."""
        return self._call("truth")["path"]

    def servo(self, what: str) -> None:
        """Break the servo or mend it: "unplug", "plug in", "overload" (which a restart of the servo clears).

        Raises:
            AcquireError: it cannot do that now.
        """
        self._call("servo", what=what)

    def quit(self) -> None:
        """Ask the process to end."""
        self._call("quit")

    def close(self) -> None:
        """Hang up; the world goes on."""
        self._lines.close()
        self._socket.close()

    def _call(self, method: str, **arguments: Any) -> dict[str, Any]:
        try:
            self._socket.sendall(json.dumps({"method": method, **arguments}).encode() + b"\n")
            line = self._lines.readline()
        except OSError as error:
            raise AcquireError(f"{self._path}: the virtual world does not answer to '{method}' ({error}): start it anew") from None
        if not line.endswith(b"\n"):
            raise AcquireError(f"{self._path}: the virtual world hung up on '{method}': look at its standard error")
        answer = json.loads(line)
        if "error" in answer:
            raise AcquireError(answer["error"])
        return answer
