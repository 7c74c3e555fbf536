"""Makes of cameras whose feature names, bounds, clocks and memory the virtual camera can take on.

Names and bounds after makers' documentation and Aravis 0.8.26 (arvcamera.c), which calls them by these names;
none of these cameras was connected. What a camera remembers is loaded away by its "Default" user set.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from acquire.virtual.genicam import Description

WIDTH, HEIGHT, OFFSET_X, OFFSET_Y = 0x100, 0x104, 0x130, 0x134
SENSOR_WIDTH, SENSOR_HEIGHT, PIXEL_FORMAT = 0x11C, 0x118, 0x128
EXPOSURE_US, GAIN, PERIOD_US = 0x120, 0x110, 0x138
PACKET_SIZE = 0xD04
ACQUISITION, ACQUISITION_MODE = 0x124, 0x12C
TRIGGER_MODE, TRIGGER_SOURCE, TRIGGER_ACTIVATION = 0x300, 0x304, 0x308
"""registers of Aravis's fake camera"""
TRIGGER_SELECTOR, RATE_ENABLE = 0x2000, 0x2004
EXPOSURE_AUTO, GAIN_AUTO, EXPOSURE_MODE = 0x2008, 0x200C, 0x2010
BINNING_X, BINNING_Y, REVERSE_X, GAMMA, CHUNKS = 0x2014, 0x2018, 0x201C, 0x2020, 0x2024
USER_SET, USER_SET_LOAD, TL_LOCK = 0x2028, 0x202C, 0x2030
"""registers beside them, of features that the fake camera lacks"""
DEFAULTS: Final = {
    BINNING_X: 1,
    BINNING_Y: 1,
    REVERSE_X: 0,
    GAMMA: 0,
    CHUNKS: 0,
    TRIGGER_MODE: 0,
    RATE_ENABLE: 0,
}
"""values of what is remembered, in the "Default" user set"""
RAW_GAIN_STEP_DB: Final = 0.0359
DB_SCALE: Final = 100


@dataclass(frozen=True)
class CameraMake:
    """One make: names, bounds and habits."""

    vendor: str
    model: str
    exposure: str = "ExposureTime"
    """name of the exposure's feature"""
    raw_gain: tuple[int, int] | None = None
    """lowest and highest gain in steps (GainRaw); None for a gain in dB"""
    rate: str = "AcquisitionFrameRate"
    """name of the frame rate's feature"""
    rate_enable: bool = True
    """True if the frame rate has a switch, AcquisitionFrameRateEnable"""
    triggers: tuple[str, ...] = ("FrameStart",)
    """entries of TriggerSelector"""
    activation: bool = True
    """True if it has TriggerActivation"""
    ticks_hz: int = 1_000_000_000
    """frequency of its clock"""
    stamp_at: Literal["exposure_start", "exposure_end"] = "exposure_start"
    """instant of a frame that it stamps"""
    locks_payload: bool = False
    """True if it has TLParamsLocked: while that is 1, or images are sent, what changes an image's size or
    packets is denied"""
    trigger_locks_rate: bool = False
    """True if the frame rate and its switch are denied while a trigger is on (Alvium: Aravis #778, #879)"""
    remembered: dict[int, int] = field(default_factory=dict[int, int])
    """registers that another program has left at other values than the defaults"""

    def gain_db(self, register: int) -> float:
        """Gain [dB] over the lowest one, by the value of its register."""
        if self.raw_gain is None:
            return (register - 1) / DB_SCALE
        return (register - self.raw_gain[0]) * RAW_GAIN_STEP_DB

    def xml(self, width: int, height: int) -> str:
        """Description of the camera for clients, with the size of its sensor [px]."""
        made = Description(self.vendor, self.model)
        for name, address, length in (
            ("DeviceVendorName", 0x48, 32),
            ("DeviceModelName", 0x68, 32),
            ("DeviceVersion", 0x88, 32),
            ("DeviceID", 0xD8, 16),
        ):
            made.text(name, address, length)
        made.integer("SensorWidth", SENSOR_WIDTH, 1, width)
        made.integer("SensorHeight", SENSOR_HEIGHT, 1, height)
        lock = ""
        if self.locks_payload:
            lock = "TLParamsLocked"
            made.integer(lock, TL_LOCK, 0, 1)
        made.integer("Width", WIDTH, 8, width, 8, lock)
        made.integer("Height", HEIGHT, 2, height, 2, lock)
        made.integer("OffsetX", OFFSET_X, 0, width)
        made.integer("OffsetY", OFFSET_Y, 0, height)
        made.choice("PixelFormat", PIXEL_FORMAT, {"Mono8": 0x01080001, "Mono16": 0x01100007}, lock)
        made.command("AcquisitionStart", ACQUISITION, 1)
        made.command("AcquisitionStop", ACQUISITION, 0)
        made.choice("AcquisitionMode", ACQUISITION_MODE, {"Continuous": 1, "SingleFrame": 2})
        made.product("PayloadSize", "Width", "Height")
        made.bit_command("GevSCPSFireTestPacket", PACKET_SIZE, 0)
        self._add_timing(made)
        made.remembered(
            exposure_mode=EXPOSURE_MODE,
            binning=(BINNING_X, BINNING_Y),
            reverse_x=REVERSE_X,
            gamma=GAMMA,
            chunks=CHUNKS,
            user_set=USER_SET,
            load=USER_SET_LOAD,
        )
        return made.xml()

    def _add_timing(self, made: Description) -> None:
        made.number(self.exposure, EXPOSURE_US, (10, 1e7), "FROM", "TO")
        made.choice("ExposureAuto", EXPOSURE_AUTO, {"Off": 0, "Continuous": 1})
        made.choice("GainAuto", GAIN_AUTO, {"Off": 0, "Continuous": 1})
        if self.raw_gain is None:
            made.number("Gain", GAIN, (0, 24), f"FROM * {DB_SCALE} + 1", f"(TO - 1) / {DB_SCALE}.0")
        else:
            made.integer("GainRaw", GAIN, *self.raw_gain)
        made.number(self.rate, PERIOD_US, (0.1, 1000), "1000000 / FROM", "1000000.0 / TO")
        if self.rate_enable:
            made.switch("AcquisitionFrameRateEnable", RATE_ENABLE)
        made.choice("TriggerSelector", TRIGGER_SELECTOR, {name: i for i, name in enumerate(self.triggers)})
        made.choice("TriggerMode", TRIGGER_MODE, {"Off": 0, "On": 1})
        made.choice("TriggerSource", TRIGGER_SOURCE, {"Line1": 0, "Software": 1})
        if self.activation:
            made.choice("TriggerActivation", TRIGGER_ACTIVATION, {"RisingEdge": 0, "FallingEdge": 1})


USED: Final = {BINNING_X: 2, REVERSE_X: 1, GAMMA: 1, CHUNKS: 1}
"""what an earlier program has left in a camera"""
MAKES: Final = {
    "basler-ace": CameraMake(
        "Basler",
        "acA640-100gm",
        exposure="ExposureTimeAbs",
        raw_gain=(192, 1023),
        rate="AcquisitionFrameRateAbs",
        triggers=("AcquisitionStart", "FrameStart"),
        ticks_hz=125_000_000,
        remembered=USED,
    ),
    "mako": CameraMake(
        "Allied Vision Technologies",
        "Mako G-030B (GigE)",
        exposure="ExposureTimeAbs",
        rate="AcquisitionFrameRateAbs",
        rate_enable=False,
        triggers=("FrameStart", "AcquisitionStart"),
        ticks_hz=36_000_000,
        remembered=USED,
    ),
    "alvium-g1": CameraMake(
        "Allied Vision",
        "Alvium G1-040m",
        trigger_locks_rate=True,
        remembered=USED | {TRIGGER_MODE: 1, RATE_ENABLE: 1},
    ),
    "blackfly-s": CameraMake(
        "FLIR",
        "Blackfly S BFS-PGE-04S2M",
        triggers=("AcquisitionStart", "FrameStart", "FrameBurstStart"),
        ticks_hz=1_000_000_000,
        stamp_at="exposure_end",
        locks_payload=True,
        remembered=USED,
    ),
    "hikrobot": CameraMake(
        "Hikrobot",
        "MV-CA004-10GM",
        triggers=("FrameBurstStart",),
        activation=False,
        ticks_hz=100_000_000,
        remembered=USED,
    ),
    "imaging-source": CameraMake(
        "The Imaging Source Europe GmbH",
        "DMK 33GP031",
        exposure="ExposureTime",
        rate="FPS",
        rate_enable=False,
        locks_payload=True,
        remembered=USED,
    ),
}
"""makes by name"""
