"""Does the camera answer, take its settings, deliver every frame, and see a marker at rest in good light?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquire.errors import AcquireError, CameraSettingError
from acquire.preflight.check import Check, Measured, failed, failed_as, not_checked, passed
from schemas.rig_limits import SMALLEST_TAG_PX

if TYPE_CHECKING:
    from acquire.config import CameraConfig
    from acquire.preflight.film import Film, Filming
    from schemas.watch_lines import WatchEvent

CAMERA_LINES = ("camera", "camera settings", "frames", "camera clock", "light", "marker", "object at rest")
RATE_TOLERANCE = 0.01
MAPPING_SD_LIMIT_NS = 100_000
"""3 rad/s times 0.1 ms is 0.02 deg, below a frame's noise"""
SATURATED = 254
SATURATED_LIMIT = 0.02
"""of the image: a lamp's reflection, not the tag's paper"""
BRIGHT_LIMIT = 60
"""grey level that the brightest hundredth must reach; below it white paper drowns in noise"""


def check_camera(filming: Filming, config: CameraConfig, folder: Path) -> Iterator[Check]:
    """All lines that need the camera, as they are known; it is released in the end."""
    try:
        try:
            who = filming.open()
        except CameraSettingError as error:
            yield passed("camera", f"answers at {config.address}")
            yield failed_as("camera settings", error)
            yield from _rest("its settings come first", 2)
            return
        except AcquireError as error:
            yield failed_as("camera", error)
            yield from _rest("the camera comes first", 1)
            return
        yield passed("camera", who)
        yield passed(
            "camera settings",
            f"{config.width} x {config.height} mono8 at {config.frame_rate_hz:g} Hz, {config.exposure_us:g} us, {config.gain_db:g} dB, "
            f"packets of {config.packet_size} B: read back as set",
        )
        try:
            film = filming.shoot(folder)
        except AcquireError as error:
            yield failed_as("frames", error)
            yield from _rest("there is no film", 3)
            return
        yield from (check_frames(film, config), check_clock(film), check_light(film), *check_scene(film.event))
    finally:
        filming.close()


def _rest(reason: str, first: int) -> Iterator[Check]:
    return (not_checked(name, reason) for name in CAMERA_LINES[first:])


def check_frames(film: Film, config: CameraConfig) -> Check:
    """Every frame, at the rate that was set."""
    rate = (film.frames - 1) / film.seconds if film.seconds > 0 else 0.0
    found = f"{film.frames} in {film.seconds:.2f} s: {rate:.2f} Hz of {config.frame_rate_hz:g} Hz set, {film.lost} lost"
    if film.lost:
        remedy = "look at receive buffer and packet size above, then at cable, switch and other programs on this computer"
        return failed("frames", found, remedy, Measured(film.lost, 0, "frames"))
    measured = Measured(rate, config.frame_rate_hz, "Hz")
    if abs(rate - config.frame_rate_hz) > RATE_TOLERANCE * config.frame_rate_hz:
        remedy = "the exposure must be shorter than the frame; lower frame_rate_hz or the region, or raise the camera's bandwidth limit"
        return failed("frames", found, remedy, measured)
    return passed("frames", found, measured)


def check_clock(film: Film) -> Check:
    """How well frame times are known on the host's clock."""
    sd_us = film.content.mapping_sd_ns * 1e-3
    if not film.content.clock_samples:
        return passed("camera clock", "cannot be latched: frame times are arrival times, and the recording says so")
    measured = Measured(film.content.mapping_sd_ns * 1e-9, MAPPING_SD_LIMIT_NS * 1e-9, "s")
    found = f"mapped to the host's to {sd_us:.0f} us (1 sigma), {MAPPING_SD_LIMIT_NS // 1000} us will do"
    if film.content.mapping_sd_ns > MAPPING_SD_LIMIT_NS:
        return failed("camera clock", found, "connect the camera without a busy switch; end what loads this computer", measured)
    return passed("camera clock", found, measured)


def check_light(film: Film) -> Check:
    """Neither saturated nor black."""
    saturated = float(np.mean(film.content.image >= SATURATED))
    bright = float(np.percentile(film.content.image, 99))
    found = f"{100 * saturated:.1f} % of the image saturated, its brightest hundredth at {bright:.0f} of 255"
    if saturated > SATURATED_LIMIT:
        return failed(
            "light", found, "shorten exposure_us, close the lens, or turn reflections away", Measured(saturated, SATURATED_LIMIT, "1")
        )
    if bright < BRIGHT_LIMIT:
        return failed(
            "light", found, "take the cap off, add light, open the lens, or raise gain_db", Measured(bright, BRIGHT_LIMIT, "grey levels")
        )
    return passed("light", found, Measured(saturated, SATURATED_LIMIT, "1"))


def check_scene(event: WatchEvent | None) -> list[Check]:
    """A marker in view, large enough, and nothing moves."""
    if event is None:
        remedy = "is `analyze` installed beside `acquire`? try `analyze watch --help`"
        return [
            failed("marker", "`analyze watch` said nothing about the film", remedy),
            not_checked("object at rest", "`analyze watch` is silent"),
        ]
    return [_marker(event), _rest_of(event)]


def _marker(event: WatchEvent) -> Check:
    edges = {marker.id: mean_edge(marker.corners_px) for marker in event.markers}
    if not edges:
        return failed("marker", "none in view", "place the object with a tag towards the camera; check focus and light")
    largest = max(edges, key=lambda marker: edges[marker])
    others = f", {len(edges) - 1} more" if len(edges) > 1 else ""
    found = f"tag {largest} is {edges[largest]:.0f} px wide{others}; {SMALLEST_TAG_PX:g} px are wanted"
    measured = Measured(edges[largest], SMALLEST_TAG_PX, "px")
    if edges[largest] < SMALLEST_TAG_PX:
        return failed("marker", found, "print a larger tag, move the camera nearer, or use a longer lens", measured)
    return passed("marker", found, measured)


def _rest_of(event: WatchEvent) -> Check:
    if not event.at_rest:
        return failed(
            "object at rest", "something moves in the image", "let the object settle; is the camera's mount firm, does a light flicker?"
        )
    return passed("object at rest", "nothing has moved for a quarter of a second")


def mean_edge(corners_px: list[list[float]]) -> float:
    """Mean edge [px] of a square given by its four corners in order."""
    return sum(math.dist(corners_px[i], corners_px[i - 1]) for i in range(4)) / 4
