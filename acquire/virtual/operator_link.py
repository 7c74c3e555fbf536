"""Client of the virtual world's control socket: places and tosses the object, asks for the true poses.

The protocol is one JSON line in each direction.
"""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from acquire.errors import AcquireError

TIMEOUT_S = 5.0
"""longest wait for an answer [s]"""


class OperatorLink:
    """Connection to the control socket of the virtual world's process; one thread owns it.

    Args:
        path: path of the socket (`world.sock`).

    Raises:
        AcquireError: no process listens on the socket.
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
                f"{path}: the virtual world does not answer ({error.strerror}): start "
                "acquire.virtual.world_process"
            ) from None
        self._lines = self._socket.makefile("rb")

    def place(
        self, R_world_object: ArrayLike, p_world_object: ArrayLike, impact_point_world: ArrayLike
    ) -> None:
        """Place the object and set the striker's stand; returns at once, the object settles within 10 ms.

        Args:
            R_world_object: (3, 3) rotation from O, the object's frame, to W, the world frame.
            p_world_object: (3,) position of the object's origin in W [m]; z is ignored, because the object is
                released just over the table.
            impact_point_world: (3,) point in W that the hanging arm's tip touches [m].

        Raises:
            AcquireError: the request was refused, or the world does not answer.
        """
        self._call(
            "place",
            R_world_object=np.asarray(R_world_object, dtype=float).tolist(),
            p_world_object=np.asarray(p_world_object, dtype=float).tolist(),
            impact_point_world=np.asarray(impact_point_world, dtype=float).tolist(),
        )

    def toss(self, toss: dict[str, Any], kind: str, hold_s: float) -> None:
        """Hold the object in the air, and toss it after a time; returns at once.

        Args:
            toss: planned toss, as in a plan (JSON).
            kind: what is wrong with the toss, or "good".
            hold_s: time for which the object is held still before [s].

        Raises:
            AcquireError: the request was refused, or the world does not answer.
        """
        self._call("toss", toss=toss, kind=kind, hold_s=hold_s)

    def let_go(self, after_s: float) -> None:
        """Toss the object that is held in the air after a time [s]; nothing happens if none is held.

        Raises:
            AcquireError: the world does not answer.
        """
        self._call("toss", after_s=after_s)

    def truth(self) -> str:
        """Path of the file with the world's true poses and contacts; all of them so far are in it on return.

        Raises:
            AcquireError: the world does not answer.
        """
        return self._call("truth")["path"]

    def close(self) -> None:
        """Close the connection; the virtual world's process continues."""
        self._lines.close()
        self._socket.close()

    def _call(self, method: str, **arguments: Any) -> dict[str, Any]:
        try:
            self._socket.sendall(json.dumps({"method": method, **arguments}).encode() + b"\n")
            line = self._lines.readline()
        except OSError as error:
            raise AcquireError(
                f"{self._path}: the virtual world does not answer '{method}' ({error}): start it again"
            ) from None
        if not line.endswith(b"\n"):
            raise AcquireError(
                f"{self._path}: the virtual world closed the connection during '{method}': see its "
                "standard error"
            )
        answer = json.loads(line)
        if "error" in answer:
            raise AcquireError(answer["error"])
        return answer
