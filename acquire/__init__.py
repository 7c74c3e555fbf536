"""The hardware daemon and its clients: strike an object, film it, write the recording.

The daemon drives striker and camera and stamps frames and strikes with their times. Scripts reach a running
daemon through `acquire.connect()`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from acquire.console.web.client import ConsoleClient
    from acquire.daemon.client import DaemonClient

__all__ = ["connect", "connect_console"]


def connect(socket: Path | str | None = None) -> DaemonClient:
    """Connect to the running daemon and return a client of it.

    A script can read the state, listen to events, strike and stop::

        with acquire.connect() as daemon:
            print(daemon.call("status")["striker"])
            for method in ("striker.home", "striker.arm", "striker.cock"):
                daemon.call(method)
            print(daemon.call("striker.strike", strike_id="1", tip_speed_m_s=0.3))

        with acquire.connect() as listener:
            for event in listener.events():  # prompts, session states, what the newest image shows, problems
                print(event)

    `call("striker.stop")` stops the striker at any time, also from another client. While a session is open,
    only its client may give commands. `close`, or the end of the `with` block, ends the connection.

    Args:
        socket: path of the daemon's socket; None for the default, as in a rig file without [daemon] socket.

    Raises:
        DaemonNotRunning: no daemon listens there.
        DaemonSilent: the daemon does not answer.
        DaemonError: the socket belongs to another user.
    """
    from pathlib import Path

    from acquire.daemon.client import DaemonClient
    from schemas.daemon_config import DaemonConfig

    return DaemonClient(Path(socket) if socket is not None else DaemonConfig().socket_path())


def connect_console(socket: Path | str | None = None) -> ConsoleClient:
    """Connect to the running console (`acquire console`) and return a client of it.

    It can do what the page can: follow a session, answer prompts, start and pause::

        with acquire.connect_console() as console:
            print(console.state().session)
            console.stop()  # as every browser may
            console.take_over()  # become the operator
            console.pause("after_strike")

    Args:
        socket: path of the daemon's socket; None for the default, as in a rig file without [daemon] socket.

    Raises:
        DaemonNotRunning: no console runs for this rig.
    """
    from pathlib import Path

    from acquire.console.web.client import ConsoleClient
    from schemas.daemon_config import DaemonConfig

    return ConsoleClient(Path(socket) if socket is not None else DaemonConfig().socket_path())
