"""Strikes for `make bench-print`: physics of the virtual rig, filmed with tags or with print.

Bodies are struck in acquire/virtual/world.py without a wall clock; acquire/virtual/render.py draws the true
poses, with or without tags and print. The renderer and the trackers share no operation.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import av
import cv2
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from acquire.virtual.objects import VirtualObject
from acquire.virtual.render import Renderer
from acquire.virtual.station import G_M_S2, Station
from acquire.virtual.world import World
from analyze.types import ImageFrame
from schemas.strike_plan import PlannedStrike
from tests.benchmarks.contact_session import true_tip
from tests.benchmarks.honesty.observed import T0
from tests.benchmarks.honesty.struck import StruckMotion

MS = 1_000_000
SETTLE_NS, LONGEST_NS, AFTER_LANDING_NS = 600 * MS, 1_400 * MS, 60 * MS
RATE_HZ = 120.0
REST_S = 0.25
"""time filmed before the push [s]"""
USUAL_EXPOSURE_US = 1500.0
PARKED = -2.5
"""angle of an arm that is out of view [rad]"""
BANDS = 24
"""bands of rows of a rolling shutter that are drawn at one instant"""


@dataclass(frozen=True)
class Placement:
    """Error of the pose in which a hand puts the object down: turn about the vertical [rad], shift [m]."""

    yaw: float = 0.0
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True)
class Filming:
    """How a strike is filmed."""

    exposure_us: float = USUAL_EXPOSURE_US
    readout_s: float = 0.0
    """time from the first row's to the last row's exposure of a rolling shutter [s]; 0 for a global one"""
    shadow: bool = False
    """True if the edge of a soft shadow moves across the object"""
    arm_across: bool = False
    """True if the striker's arm swings between camera and object"""
    crf: int | None = None
    """rate factor of the H.264 video; None for raw images"""


def struck(
    world: World,
    thing: VirtualObject,
    planned: PlannedStrike,
    placed: Placement,
    push: tuple[float, float],
) -> StruckMotion:
    """True poses of one push, from its beginning until after the landing.

    Args:
        world: physics; its object is `thing`.
        thing: the object.
        planned: the strike.
        placed: error of the pose in which the object is put down.
        push: kinetic energy after the push over that needed to reach the balance, and duration [s].
    """
    R, p = np.array(planned.R_world_object), np.array(planned.p_world_object)
    turn = Rotation.from_euler("z", placed.yaw).as_matrix()
    pivot = R @ np.array(planned.pivot.point) + p
    R, p = turn @ R, turn @ (p - pivot) + pivot + [placed.x, placed.y, 0.0]
    point = R @ np.array(planned.impact.point) + p
    world.place(R, p, point + np.array([-0.5, 0.0, 0.3]))
    until = world.time_ns + SETTLE_NS
    while world.time_ns < until and not world.at_rest:
        world.step_to(world.time_ns + 20 * MS)
    tip = true_tip(thing, planned)
    energy, seconds = push
    impulse = math.sqrt(2 * thing.body.mass_kg * G_M_S2 * tip.rise * energy * tip.i_edge) / point[2]
    world.push(point, np.array([impulse, 0.0, 0.0]), seconds)
    begun, states = world.time_ns, [world.state()]
    end, over, last = begun + LONGEST_NS, False, 0.0
    while world.time_ns < end:
        world.step_to(world.time_ns + MS)
        states.append(world.state())
        theta = _tipped(states[-1].q_world_object_wxyz, R)
        over = over or theta > tip.phi + 0.1
        late = world.time_ns - begun > 150 * MS
        if late and end == begun + LONGEST_NS and theta < last and (over or theta < 0.005):
            end = world.time_ns + AFTER_LANDING_NS
        last = theta
    time = np.array([1e-9 * (state.time_ns - begun) for state in states])
    xyzw = np.array([state.q_world_object_wxyz for state in states])[:, [1, 2, 3, 0]]
    position = np.array([state.p_world_object for state in states])
    R_rest = Rotation.from_quat(xyzw[0]).as_matrix()
    return StruckMotion(time, position, xyzw, R_rest, tip, energy, over)


def true_theta(motion: StruckMotion, direction: np.ndarray) -> np.ndarray:
    """True tipping angle (n,) [rad] about a line (3,) in O, since rest."""
    turned = Rotation.from_quat(motion.quaternion) * Rotation.from_matrix(motion.R_rest).inv()
    axis, xyzw = motion.R_rest @ direction, turned.as_quat()
    return 2 * np.arctan2(xyzw[:, :3] @ axis * np.sign(xyzw[:, 3]), np.abs(xyzw[:, 3]))


def film(
    renderer: Renderer, motion: StruckMotion, heading: float, how: Filming, rng: np.random.Generator
) -> list[ImageFrame]:
    """Images of a strike; the time of an image is that of the middle of its exposure.

    Args:
        renderer: renderer of the object.
        motion: true poses.
        heading: angle by which object and striker are turned about the vertical [rad].
        how: exposure, shutter and disturbances.
        rng: generator of the frames' phase.
    """
    times = np.arange(-round(REST_S * RATE_HZ), int(motion.time[-1] * RATE_HZ)) / RATE_HZ
    times = times + rng.random() / RATE_HZ
    times = times[times < motion.time[-1] - 0.01]
    path = FilmPath(motion, heading, how.arm_across)
    images = [_exposed(renderer, path, time, how) for time in times]
    if how.shadow:
        images = [_shadowed(image, time) for image, time in zip(images, times, strict=True)]
    if how.crf is not None:
        images = list(_through_h264(images, how.crf))
    return [
        ImageFrame(T0 + round(1e9 * time), number, image)
        for number, (time, image) in enumerate(zip(times, images, strict=True))
    ]


class FilmPath:
    """Poses of object and arm at any time, as `Renderer.render` takes them."""

    def __init__(self, motion: StruckMotion, heading: float, arm_across: bool = False) -> None:
        turn = Rotation.from_euler("z", heading)
        self._motion = motion
        self._rotations = Slerp(motion.time, turn * Rotation.from_quat(motion.quaternion))
        self._positions = turn.apply(motion.position)
        self._across = arm_across

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Positions (k, 3), quaternions (k, 4), arm angles (k,) and axes (k, 3) at times (k,) [s]."""
        time = self._motion.time
        inside = np.clip(times, time[0], time[-1])
        p = np.stack([np.interp(inside, time, axis) for axis in self._positions.T], axis=1)
        q = self._rotations(inside).as_quat()[:, [3, 0, 1, 2]]
        if self._across:
            return p, q, np.clip(-1.2 + 6.0 * times, -1.2, 1.2), np.tile([-0.02, -0.12, 0.22], (len(p), 1))
        return p, q, np.full(len(p), PARKED), np.tile([-1.5, 0.0, 0.3], (len(p), 1))


def _exposed(renderer: Renderer, path: FilmPath, time: float, how: Filming) -> np.ndarray:
    moved = not np.array_equal(path.at(np.array([time - 0.02]))[0], path.at(np.array([time + 0.02]))[0])
    if not how.readout_s or not (moved or how.arm_across):
        return _at_once(renderer, path, time, how)
    bands = [
        _at_once(renderer, path, time + ((band + 0.5) / BANDS - 0.5) * how.readout_s, how)
        for band in range(BANDS)
    ]
    edges = np.round(np.linspace(0, len(bands[0]), BANDS + 1)).astype(int)
    return np.concatenate([bands[n][edges[n] : edges[n + 1]] for n in range(BANDS)])


def _at_once(renderer: Renderer, path: FilmPath, time: float, how: Filming) -> np.ndarray:
    exposure = 1e-6 * how.exposure_us
    count = renderer.subexposures_needed(*path.at(time + np.array([-0.5, 0.5]) * exposure))
    poses = path.at(time + ((np.arange(count) + 0.5) / count - 0.5) * exposure)
    gain_db = -20 * math.log10(how.exposure_us / USUAL_EXPOSURE_US)
    return renderer.render(*poses, how.exposure_us, gain_db).copy()


def _shadowed(image: np.ndarray, time: float) -> np.ndarray:
    """Image with a soft shadow over its left part, whose edge moves to the right by 600 px a second."""
    edge = 120 + 600 * max(time, 0.0)
    dark = 1.0 - 0.3 / (1.0 + np.exp((np.arange(image.shape[1]) - edge) / 8.0))
    return np.clip(np.rint(image * dark), 0, 255).astype(np.uint8)


def _through_h264(images: list[np.ndarray], crf: int) -> Iterator[np.ndarray]:
    """Yield the images as they come back from an H.264 video."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as file:
        stream = file.add_stream("libx264", rate=120, options={"crf": str(crf), "preset": "medium"})
        stream.height, stream.width = images[0].shape
        stream.pix_fmt = "yuv420p"
        for image in images:
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB), format="rgb24")
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    buffer.seek(0)
    with av.open(buffer) as file:
        for frame in file.decode(video=0):
            yield cv2.cvtColor(frame.to_ndarray(format="rgb24"), cv2.COLOR_RGB2GRAY)


def turned_station(place: Station, angle: float) -> Station:
    """Station whose camera is turned about the vertical through the pivot by an angle [rad]."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
    return replace(place, T_world_camera=turn @ place.T_world_camera)


def _tipped(wxyz: tuple[float, ...], R_rest: np.ndarray) -> float:
    w, x, y, z = wxyz
    turned = Rotation.from_quat([x, y, z, w]).as_matrix() @ R_rest.T
    return float(np.arctan2(turned[0, 2], turned[2, 2]))
