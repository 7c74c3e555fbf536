"""Features of a virtual USB3 Vision camera: its description for clients, and its registers' first values.

Names after the standard naming convention (SFNC), as Aravis 0.8.26 and this program call them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from zlib import crc32

from acquire.virtual.genicam import Description
from acquire.virtual.usb3_registers import FEATURES, TEXT_BYTES, TEXTS, TIMESTAMP, TIMESTAMP_LATCH

WIDTH, HEIGHT, OFFSET_X, OFFSET_Y, SENSOR_WIDTH, SENSOR_HEIGHT, PIXEL_FORMAT, PERIOD_US = (
    FEATURES + each for each in range(0x00, 0x20, 4)
)
ACQUISITION, ACQUISITION_MODE, EXPOSURE_US, EXPOSURE_AUTO, EXPOSURE_MODE, GAIN, GAIN_AUTO, RATE_ENABLE = (
    FEATURES + each for each in range(0x20, 0x40, 4)
)
TRIGGER_SELECTOR, TRIGGER_MODE, TRIGGER_SOURCE, TRIGGER_ACTIVATION, LIMIT, LIMIT_MODE, USER_SET, LOAD = (
    FEATURES + each for each in range(0x40, 0x60, 4)
)
BINNING_X, BINNING_Y, REVERSE_X, GAMMA, CHUNKS = (FEATURES + each for each in range(0x60, 0x74, 4))
MONO8: Final = 0x01080001
DEFAULTS: Final = {BINNING_X: 1, BINNING_Y: 1, REVERSE_X: 0, GAMMA: 0, CHUNKS: 0, TRIGGER_MODE: 0}
"""values of what a camera remembers, in its "Default" user set"""
USED: Final = {BINNING_X: 2, REVERSE_X: 1, GAMMA: 1, CHUNKS: 1, TRIGGER_MODE: 1}
"""values that an earlier program has left"""
LOCKED: Final = frozenset({WIDTH, HEIGHT, OFFSET_X, OFFSET_Y, PERIOD_US, *DEFAULTS})
"""registers that cannot be written while images are sent"""
DB_SCALE: Final = 100
HIGHEST_LIMIT_BYTES_S: Final = 450_000_000
FASTEST_HZ: Final = 1000
VENDOR: Final = "Percuss"


@dataclass(frozen=True)
class Usb3Habits:
    """Properties of a camera that differ among makes, and its faults."""

    vendor: str = VENDOR
    model: str = "USB3-656"
    limit_bytes_s: int = 200_000_000
    """limit of its bandwidth [bytes/s] that it has when it is plugged in, and in its "Default" user set"""
    limit_locked: bool = False
    """True if the limit cannot be changed"""
    latches: bool = True
    """True if its clock can be latched"""
    stamps_end: bool = False
    """True if it stamps the end of an exposure, not its start"""
    memory_frames: int = 200
    """number of images that it keeps until the computer asks for them"""
    port_bytes_s: float = 380e6
    """what the port carries [bytes/s]"""
    open_status: int = 0
    """status of libusb with which programs are refused; 0 if they may open it"""
    left_streaming: bool = False
    """True if another program has left it streaming"""
    lacks_trailer_every: int = 0
    """number of frames of which the last arrives without its end; 0: none"""
    cut_every: int = 0
    """number of frames of which the last arrives with half of its image; 0: none"""


def usb3_serial(seed: int) -> str:
    """Serial number of the virtual rig's camera."""
    return f"VIRTUAL-{seed}"


def device_guid(serial: str) -> str:
    """Globally unique number of a camera: number of the maker, and 8 digits of its own."""
    return f"1209{crc32(serial.encode()):08X}"


def device_id(serial: str, vendor: str = VENDOR) -> str:
    """Device id by which Aravis opens a camera."""
    return f"{vendor}-{device_guid(serial)}-{serial}"


def first_values(habits: Usb3Habits, width: int, height: int) -> dict[int, int]:
    """Values of a used camera's registers by address; `width` and `height` are those of its sensor [px]."""
    sizes = {SENSOR_WIDTH: width, SENSOR_HEIGHT: height, WIDTH: width, HEIGHT: height}
    timing = {EXPOSURE_US: 5000, PERIOD_US: 20_000, GAIN: 1, EXPOSURE_AUTO: 1, GAIN_AUTO: 1}
    limit = {LIMIT: habits.limit_bytes_s, LIMIT_MODE: 1}
    return sizes | timing | limit | {PIXEL_FORMAT: MONO8, ACQUISITION_MODE: 1} | USED


def description(habits: Usb3Habits, width: int, height: int) -> str:
    """Description of the camera (GenICam XML); `width` and `height` are those of its sensor [px]."""
    made = Description(habits.vendor, habits.model, "U3V")
    for name, address in TEXTS.items():
        made.text(name, address, TEXT_BYTES)
    made.integer("SensorWidth", SENSOR_WIDTH, 1, width)
    made.integer("SensorHeight", SENSOR_HEIGHT, 1, height)
    made.integer("Width", WIDTH, 8, width, 8)
    made.integer("Height", HEIGHT, 2, height, 2)
    made.integer("OffsetX", OFFSET_X, 0, width)
    made.integer("OffsetY", OFFSET_Y, 0, height)
    made.choice("PixelFormat", PIXEL_FORMAT, {"Mono8": MONO8, "Mono16": 0x01100007})
    made.command("AcquisitionStart", ACQUISITION, 1)
    made.command("AcquisitionStop", ACQUISITION, 0)
    made.choice("AcquisitionMode", ACQUISITION_MODE, {"Continuous": 1, "SingleFrame": 2})
    made.product("PayloadSize", "Width", "Height")
    _add_timing(made, habits)
    made.remembered(
        exposure_mode=EXPOSURE_MODE,
        binning=(BINNING_X, BINNING_Y),
        reverse_x=REVERSE_X,
        gamma=GAMMA,
        chunks=CHUNKS,
        user_set=USER_SET,
        load=LOAD,
    )
    return made.xml()


def _add_timing(made: Description, habits: Usb3Habits) -> None:
    made.number("ExposureTime", EXPOSURE_US, (10, 1e7), "FROM", "TO")
    made.choice("ExposureAuto", EXPOSURE_AUTO, {"Off": 0, "Continuous": 1})
    made.number("Gain", GAIN, (0, 24), f"FROM * {DB_SCALE} + 1", f"(TO - 1) / {DB_SCALE}.0")
    made.choice("GainAuto", GAIN_AUTO, {"Off": 0, "Continuous": 1})
    made.integer("DeviceLinkThroughputLimit", LIMIT, 1_000_000, HIGHEST_LIMIT_BYTES_S)
    made.choice("DeviceLinkThroughputLimitMode", LIMIT_MODE, {"Off": 0, "On": 1})
    variables = {"ON": "DeviceLinkThroughputLimitModeRegister", "LIMIT": "DeviceLinkThroughputLimit"}
    made.formula(
        "HighestRate",
        f"(ON = 1) ? (LIMIT * 1.0 / SIZE) : {FASTEST_HZ}",
        variables | {"SIZE": "PayloadSize"},
    )
    made.number("AcquisitionFrameRate", PERIOD_US, (0.1, "HighestRate"), "1000000 / FROM", "1000000.0 / TO")
    made.switch("AcquisitionFrameRateEnable", RATE_ENABLE)
    made.choice("TriggerSelector", TRIGGER_SELECTOR, {"FrameStart": 0, "AcquisitionStart": 1})
    made.choice("TriggerMode", TRIGGER_MODE, {"Off": 0, "On": 1})
    made.choice("TriggerSource", TRIGGER_SOURCE, {"Line1": 0, "Software": 1})
    made.choice("TriggerActivation", TRIGGER_ACTIVATION, {"RisingEdge": 0, "FallingEdge": 1})
    if habits.latches:
        made.command("TimestampLatch", TIMESTAMP_LATCH, 1)
        made.counter("TimestampLatchValue", TIMESTAMP)
