"""Reports and identities of a striker board that forbid to go on, as errors with a remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.errors import StrikerFault
from acquire.striker.board_lines import BoardIdentity, BoardState, BoardStatus

if TYPE_CHECKING:
    from schemas.rig import StrikerConfig

SPEED_ROUNDING_M_S = 0.0005
"""half the unit in which a board states its speeds [m/s]"""


def refuse_other_speeds(config: StrikerConfig, identity: BoardIdentity) -> None:
    """Refuse a board that does not fire at all tip speeds in the rig file.

    Args:
        config: section `striker` of the rig file.
        identity: identity of the board.

    Raises:
        StrikerFault: it does not; the message has both ranges.
    """
    limits = config.tip_speeds()
    slowest, fastest = 1e-3 * identity.slowest_mm_s, 1e-3 * identity.fastest_mm_s
    above = slowest - SPEED_ROUNDING_M_S <= limits.slowest_m_s
    if above and limits.fastest_m_s <= fastest + SPEED_ROUNDING_M_S:
        return
    raise StrikerFault(
        f"{config.port}: the board fires at {slowest:g} to {fastest:g} m/s, the rig file has "
        f"speed_range_m_s = [{limits.slowest_m_s:g}, {limits.fastest_m_s:g}]; correct it to speeds between "
        "these, and plan again"
    )


def refuse_fault(port: str, status: BoardStatus) -> None:
    """Refuse a board in state FAULT.

    Args:
        port: path of the serial port, for the message.
        status: report of the board.

    Raises:
        StrikerFault: it is in that state; the message has the board's reason.
    """
    if status.state is BoardState.FAULT:
        raise StrikerFault(
            f"{port}: the board reports the fault {status.reason}; correct it, then home the striker"
        )


def refuse_unarmed(port: str, status: BoardStatus) -> None:
    """Refuse a board that should be armed and is not.

    Args:
        port: path of the serial port, for the message.
        status: report of the board.

    Raises:
        StrikerFault: its state is neither ARMED nor LOADING.
    """
    refuse_fault(port, status)
    if status.state not in {BoardState.ARMED, BoardState.LOADING}:
        raise StrikerFault(
            f"{port}: the board is {status.state.value} and not armed: it disarmed itself or was reset; "
            "check its supply, and take load off the host"
        )


def refuse_ended(port: str, status: BoardStatus) -> None:
    """Refuse a board that left state FIRED by itself during a strike.

    Args:
        port: path of the serial port, for the message.
        status: report of the board.

    Raises:
        StrikerFault: its state is another one.
    """
    refuse_fault(port, status)
    if status.state is not BoardState.FIRED:
        raise StrikerFault(
            f"{port}: the board became {status.state.value} during a strike: it was reset, or this host "
            "paused; check its supply, and take load off the host"
        )
