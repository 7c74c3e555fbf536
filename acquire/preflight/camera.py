"""Checks of the camera: answer, settings, frame rate and losses, clock, light, marker, object at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquire.errors import AcquireError, CameraSettingError
from acquire.preflight.check import (
    Check,
    Measured,
    failed_by_error,
    failed_check,
    passed_check,
    skipped_check,
)
from schemas.rig_limits import GOOD_TAG_EDGE_PX, MIN_TAG_EDGE_PX

if TYPE_CHECKING:
    from acquire.preflight.video import CheckVideo, VideoSource
    from schemas.rig import CameraConfig
    from schemas.watch_lines import WatchEvent

CAMERA_LINES = ("camera", "camera settings", "frames", "camera clock", "light", "marker", "object at rest")
"""names of the camera's checks, in order"""
RATE_TOLERANCE = 0.01
"""largest relative difference of the measured frame rate from the one set"""
MAPPING_SD_LIMIT_NS = 100_000
"""largest standard deviation of the frame times [ns]: at 3 rad/s, 0.1 ms are 0.02 deg, below one frame's
noise"""
SATURATED = 254
"""grey level from which a pixel counts as saturated"""
SATURATED_LIMIT = 0.02
"""largest saturated fraction of the image; a lamp's reflection stays below it, overexposed paper does not"""
BRIGHT_LIMIT = 60
"""smallest grey level of the image's 99th percentile; below it, white paper is too noisy"""


def check_camera(source: VideoSource, config: CameraConfig, folder: Path) -> Iterator[Check]:
    """Yield the checks that need the camera, in the order of CAMERA_LINES; then release the camera.

    After a failure of camera, settings or test video, the remaining checks are yielded as not checked. A test
    video that could not be recorded, or is damaged, fails the check "frames".

    Args:
        source: camera that can record a test video.
        config: the rig file's settings of the camera.
        folder: existing folder in which the test video is recorded; the video is deleted afterwards.
    """
    try:
        try:
            description = source.open()
        except CameraSettingError as error:
            yield passed_check("camera", f"answers at {config.address}")
            yield failed_by_error("camera settings", error)
            yield from _remaining("the camera's settings must be corrected first", 2)
            return
        except AcquireError as error:
            yield failed_by_error("camera", error)
            yield from _remaining("the camera must answer first", 1)
            return
        yield passed_check("camera", description)
        yield passed_check(
            "camera settings",
            f"{config.width} x {config.height} mono8 at {config.frame_rate_hz:g} Hz, "
            f"{config.exposure_us:g} us, "
            f"{_gain_text(config)}{_way_text(config)}: read back as set",
        )
        try:
            video = source.record(folder)
        except AcquireError as error:
            yield failed_by_error("frames", error)
            yield from _remaining("there is no usable test video", 3)
            return
        yield from (
            check_frames(video, config),
            check_clock(video),
            check_light(video),
            *check_scene(video.event),
        )
    finally:
        source.close()


def _way_text(config: CameraConfig) -> str:
    """Text of what belongs to the way of the images: packet size, or what is switched off."""
    if config.traits.on_network:
        return f", packets of {config.packet_size} B"
    return ", everything automatic off"


def _gain_text(config: CameraConfig) -> str:
    if config.gain_db is not None:
        return f"{config.gain_db:g} dB"
    return "lowest gain" if config.gain_raw is None else f"gain of {config.gain_raw} steps"


def _remaining(reason: str, first: int) -> Iterator[Check]:
    return (skipped_check(name, reason) for name in CAMERA_LINES[first:])


def check_frames(video: CheckVideo, config: CameraConfig) -> Check:
    """Check that no frame of the test video is lost and that the frame rate is as set.

    The relative difference of the two rates may be up to RATE_TOLERANCE.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    rate = (video.frames - 1) / video.seconds if video.seconds > 0 else 0.0
    rates = f"{rate:.2f} Hz of {config.frame_rate_hz:g} Hz set"
    found = f"{video.frames} in {video.seconds:.2f} s: {rates}, {video.lost} lost"
    if video.lost:
        remedy = (
            "check receive buffer and packet size above, then cable, switch and other programs"
            if config.traits.on_network
            else "give the camera a USB port of its own, without a hub; end other programs"
        )
        return failed_check("frames", found, remedy, Measured(video.lost, 0, "frames"))
    measured = Measured(rate, config.frame_rate_hz, "Hz")
    if abs(rate - config.frame_rate_hz) > RATE_TOLERANCE * config.frame_rate_hz:
        remedy = (
            "the exposure must be shorter than the frame period; lower frame_rate_hz or the image size, "
            "or raise the camera's bandwidth limit"
        )
        return failed_check("frames", found, remedy, measured)
    return passed_check("frames", found, measured)


def check_clock(video: CheckVideo) -> Check:
    """Check that the sd of the frames' times on the host's clock is at most MAPPING_SD_LIMIT_NS.

    A camera whose clock cannot be read passes: the time of a frame is then its arrival at the host.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    sd_us = video.content.mapping_sd_ns * 1e-3
    if not video.content.clock_samples:
        return passed_check(
            "camera clock", "cannot be latched: frame times are arrival times, as the recording states"
        )
    measured = Measured(video.content.mapping_sd_ns * 1e-9, MAPPING_SD_LIMIT_NS * 1e-9, "s")
    found = f"mapped to the host's clock to {sd_us:.0f} us (1 sigma; limit {MAPPING_SD_LIMIT_NS // 1000} us)"
    if video.content.mapping_sd_ns > MAPPING_SD_LIMIT_NS:
        remedy = "connect the camera without a busy switch; end other programs that load this computer"
        return failed_check("camera clock", found, remedy, measured)
    return passed_check("camera clock", found, measured)


def check_light(video: CheckVideo) -> Check:
    """Check that the last image of the test video is neither saturated nor dark.

    At most the fraction SATURATED_LIMIT of the pixels may be saturated, and the 99th percentile of the grey
    levels must reach BRIGHT_LIMIT.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    saturated = float(np.mean(video.content.image >= SATURATED))
    bright = float(np.percentile(video.content.image, 99))
    found = (
        f"{100 * saturated:.1f} % of the image saturated, brightest 1 % of the pixels at {bright:.0f} of 255"
    )
    measured = Measured(saturated, SATURATED_LIMIT, "1")
    if saturated > SATURATED_LIMIT:
        remedy = "shorten exposure_us, close the aperture, or turn reflections away"
        return failed_check("light", found, remedy, measured)
    if bright < BRIGHT_LIMIT:
        remedy = "take the lens cap off, add light, open the aperture, or raise gain_db"
        return failed_check("light", found, remedy, Measured(bright, BRIGHT_LIMIT, "grey levels"))
    return passed_check("light", found, measured)


def check_scene(event: WatchEvent | None) -> list[Check]:
    """Check that a marker is in view and large enough, and that the object is at rest.

    Args:
        event: last report of `analyze watch` on the test video (markers seen, whether anything moves); None
            if there was none.

    Returns:
        Results of the two checks; without a report the first fails and the second is not made.
    """
    if event is None:
        remedy = "check that `analyze` is installed beside `acquire`: `analyze watch --help`"
        return [
            failed_check("marker", "`analyze watch` reported nothing about the test video", remedy),
            skipped_check("object at rest", "`analyze watch` reported nothing"),
        ]
    return [_marker(event), _object_at_rest(event)]


def _marker(event: WatchEvent) -> Check:
    edges = {marker.id: mean_edge(marker.corners_px) for marker in event.markers}
    if not edges:
        return failed_check(
            "marker", "none in view", "place the object with a tag towards the camera; check focus and light"
        )
    largest = max(edges, key=lambda marker: edges[marker])
    others = f", {len(edges) - 1} more" if len(edges) > 1 else ""
    found = f"tag {largest} is {edges[largest]:.0f} px wide{others}; {MIN_TAG_EDGE_PX:g} px are required"
    measured = Measured(edges[largest], MIN_TAG_EDGE_PX, "px")
    if edges[largest] < MIN_TAG_EDGE_PX:
        return failed_check(
            "marker", found, "print a larger tag, move the camera nearer, or use a longer lens", measured
        )
    if edges[largest] < GOOD_TAG_EDGE_PX:
        found += f"; from {GOOD_TAG_EDGE_PX:g} px on angles are more precise"
    return passed_check("marker", found, measured)


def _object_at_rest(event: WatchEvent) -> Check:
    if not event.at_rest:
        remedy = "let the object settle; check that the camera's mount is firm and that no light flickers"
        return failed_check("object at rest", "something moves in the image", remedy)
    return passed_check("object at rest", "nothing has moved for a quarter of a second")


def mean_edge(corners_px: list[list[float]]) -> float:
    """Mean edge length [px] of a square with corners (4, 2) [px] in order around it."""
    return sum(math.dist(corners_px[i], corners_px[i - 1]) for i in range(4)) / 4
