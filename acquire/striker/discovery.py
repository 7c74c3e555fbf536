"""Search for servos on serial ports: every baud rate, protocols 1 and 2.

Nothing is written to a servo and nothing moves: only pings and readings of model and firmware are sent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from dynamixel_sdk import COMM_SUCCESS, Protocol1PacketHandler
from serial.serialutil import SerialException
from serial.tools import list_ports

from acquire.errors import StrikerError
from acquire.striker.packets import BlockingPort, StrictPacketHandler
from acquire.striker.port_problem import port_problem
from schemas.servo_models import LEAST_FIRMWARE, model_of, unsuited_text

BAUD_RATES: Final = (1_000_000, 57_600, 2_000_000, 3_000_000, 4_000_000, 115_200, 9_600, 4_500_000)
"""baud rates at which servos are asked [bit/s]: the most usual first"""
OLD_BAUD_RATES: Final = (1_000_000, 57_600, 115_200)
OLD_IDS: Final = range(1, 21)
"""ids at which servos of protocol 1 are asked; they do not answer a ping to all"""


@dataclass(frozen=True)
class FoundServo:
    """Servo that answered."""

    port: str
    baud_rate: int
    """bit/s"""
    id: int
    model_number: int
    firmware: int | None
    """version of the firmware; None with protocol 1"""
    protocol: int

    @property
    def remedy(self) -> str:
        """Reason why it cannot drive the striker, with what to do; empty if it can."""
        if model_of(self.model_number) is None:
            return unsuited_text(self.model_number)
        if self.protocol == 1:
            return "it speaks protocol 1: set Protocol Type to 2 with DYNAMIXEL Wizard 2.0"
        if self.firmware is not None and self.firmware < LEAST_FIRMWARE:
            return (
                f"firmware {self.firmware}: update it to {LEAST_FIRMWARE} or later with DYNAMIXEL Wizard 2.0"
            )
        return ""

    @property
    def name(self) -> str:
        """Name of the model, or its number if it cannot drive the striker."""
        return model_of(self.model_number) or f"model {self.model_number}"

    def rig_lines(self) -> str:
        """Lines of a rig file's section [striker] for this servo."""
        return f'port = "{self.port}"\nbaud_rate = {self.baud_rate}\nid = {self.id}\nmodel = "{self.name}"\n'


def serial_ports() -> list[str]:
    """Paths of the serial ports of USB adapters, in order."""
    return sorted(port.device for port in list_ports.comports() if port.vid is not None)


def discover_servos(ports: list[str], progress: Callable[[str], None]) -> Iterator[FoundServo]:
    """Search ports for servos.

    Args:
        ports: paths of serial ports.
        progress: called with a text before each search.

    Yields:
        Servos in the order found.

    Raises:
        StrikerError: a port cannot be opened.
    """
    for path in ports:
        for baud_rate in BAUD_RATES:
            progress(f"{path} at {baud_rate} bit/s")
            yield from _search(path, baud_rate)


def _search(path: str, baud_rate: int) -> Iterator[FoundServo]:
    port = BlockingPort(path, baud_rate)
    try:
        if not port.openPort():
            return  # this adapter does not know the rate
        found, _ = StrictPacketHandler().broadcastPing(port)
        for servo_id, (number, firmware) in sorted(found.items()):
            yield FoundServo(path, baud_rate, servo_id, number, firmware, 2)
        if baud_rate in OLD_BAUD_RATES:
            yield from _search_old(port, path, baud_rate)
    except (OSError, SerialException) as error:
        raise StrikerError(f"{path}: {port_problem(path, error)}") from None
    finally:
        if port.is_open:
            port.closePort()


def _search_old(port: Any, path: str, baud_rate: int) -> Iterator[FoundServo]:
    handler = Protocol1PacketHandler()
    for servo_id in OLD_IDS:
        number, result, _ = handler.ping(port, servo_id)
        if result == COMM_SUCCESS:
            yield FoundServo(path, baud_rate, servo_id, number, None, 1)
