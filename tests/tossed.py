"""Tosses of the virtual rig without daemon, buses or wall clock: rendered frames and true poses.

A planned toss becomes what a person's hand makes of it, moves in the virtual world, and is drawn by the
virtual camera's renderer as in a session: the same lens, blur by motion, and noise. The camera is taken as
calibrated; errors of calibration are the caller's to draw.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.objects import VirtualObject
from acquire.virtual.render import Renderer
from acquire.virtual.station import HEIGHT_PX, WIDTH_PX, station
from acquire.virtual.toss import TossKind, TossMotion, hand_toss
from acquire.virtual.world import TICK_NS, World
from acquire.virtual.world_state import WorldState
from analyze.geometry.object_model import load_object_model
from analyze.planning.examine import Bench
from analyze.planning.followed_squares import side_squares
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.tosses import plan_tosses
from analyze.types import CameraModel, ImageFrame, Marker
from schemas.planned_toss import PlannedToss

FRAME_NS = 8_333_333
HOLD_S, AFTER_S = 0.25, 0.25
"""time rendered before the release and after the first touch of the cushion [s]"""
T0_NS = 1_700_000_000_000_000_000
"""log time of the world time 0 [ns]"""


@dataclass(frozen=True)
class TossedObject:
    """One toss: true states at 1 kHz from the hand to the cushion, and the camera that films it."""

    thing: VirtualObject
    planned: PlannedToss
    motion: TossMotion
    """what the hand made of the planned toss"""
    kind: TossKind
    seed: int
    states: tuple[WorldState, ...]
    """true states, one per millisecond; `time_ns` is world time"""
    release_ns: int
    """world time at which the object left the hand [ns]"""
    landing_ns: int
    """world time of its first touch of the cushion [ns]; that of the last state if it touched nothing"""

    @cached_property
    def camera(self) -> CameraModel:
        """True camera of the virtual rig with this toss's seed."""
        place = station(self.seed, self.thing.camera_distance_m)
        return CameraModel(WIDTH_PX, HEIGHT_PX, place.K, place.distortion, place.T_world_camera)

    @property
    def markers(self) -> list[Marker]:
        """Markers of the object at their true places."""
        return [
            Marker(marker.name, marker.size_m, np.array(marker.T_object_marker))
            for marker in self.thing.spec.marker
            if marker.T_object_marker is not None
        ]

    def frames(
        self,
        exposure_us: float = 1500.0,
        first_ns: int | None = None,
        last_ns: int | None = None,
        frame_ns: int = FRAME_NS,
        noise_seed: int = 0,
    ) -> Iterator[ImageFrame]:
        """Yield rendered frames; a frame's `time_ns` is T0_NS plus the world time of its mid-exposure.

        Args:
            exposure_us: exposure [us].
            first_ns, last_ns: world times between which frames are taken [ns]; None for all states, without
                the first and last millisecond.
            frame_ns: time between frames [ns].
            noise_seed: seed of background, noise and the frames' phase.
        """
        cv2.setNumThreads(1)
        renderer = Renderer(self.thing, station(self.seed, self.thing.camera_distance_m), noise_seed)
        phase = int(np.random.default_rng((noise_seed, 0xFA5E)).integers(0, frame_ns))
        half = round(exposure_us * 500)
        begin = max(self.states[0].time_ns + TICK_NS, first_ns or 0) + phase + half
        end = min(self.states[-1].time_ns - TICK_NS, last_ns or self.states[-1].time_ns) - half
        for sequence, middle in enumerate(range(begin, end, frame_ns)):
            image = self._image(renderer, middle - half, exposure_us)
            yield ImageFrame(T0_NS + middle, sequence, image)

    def _image(self, renderer: Renderer, start_ns: int, exposure_us: float) -> np.ndarray:
        """Image of one exposure, from as many poses as the virtual camera's process takes."""
        exposure_ns = exposure_us * 1e3
        count = renderer.subexposures_needed(*self._poses(np.array([start_ns, start_ns + exposure_ns])))
        poses = self._poses(start_ns + (np.arange(count) + 0.5) * exposure_ns / count)
        return renderer.render(*poses, exposure_us, 0.0)

    @cached_property
    def _rows(self) -> np.ndarray:
        """Times [ns from the first state], origins, quaternions wxyz, arm angles and hinges (n, 12)."""
        start = self.states[0].time_ns
        return np.array(
            [
                [s.time_ns - start, *s.p_world_object, *s.q_world_object_wxyz, s.arm_angle, *s.p_world_hinge]
                for s in self.states
            ]
        )

    def _poses(self, times_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        rows = self._rows
        wanted = times_ns - self.states[0].time_ns
        before = np.clip(np.searchsorted(rows[:, 0], wanted, side="right") - 1, 0, len(rows) - 2)
        share = ((wanted - rows[before, 0]) / (rows[before + 1, 0] - rows[before, 0]))[:, None]
        a, b = rows[before, 1:], rows[before + 1, 1:].copy()
        b[:, 3:7] *= np.sign(np.sum(a[:, 3:7] * b[:, 3:7], axis=1, keepdims=True))
        mixed = a + share * (b - a)
        mixed[:, 3:7] /= np.linalg.norm(mixed[:, 3:7], axis=1, keepdims=True)
        return mixed[:, :3], mixed[:, 3:7], mixed[:, 7], mixed[:, 8:11]

    def com_and_rotation(self, times_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True places of c (n, 3) [m] and rotations (n, 3, 3) from O to W at log times (n,) [ns]."""
        p, q, _, _ = self._poses(np.asarray(times_ns) - T0_NS)
        R = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
        return p + R @ self.thing.body.com_object, R


def planned_tosses(thing: VirtualObject, count: int) -> list[PlannedToss]:
    """Tosses that `analyze plan` plans for an object before the nominal camera of its virtual rig."""
    shape = thing.shape_file or ("", None)
    model = load_object_model(thing.spec, shape[1], shape[0])
    place = station(0, thing.camera_distance_m)
    camera = CameraModel(WIDTH_PX, HEIGHT_PX, place.K, np.zeros(5), place.T_world_camera)
    sides = () if thing.spec.marker else side_squares(model)
    return plan_tosses(thing.spec, hypothesis(model), Bench(StrikerModel(), camera, 0.6), count, sides)


def toss(
    thing: VirtualObject,
    planned: PlannedToss,
    seed: int,
    kind: TossKind = TossKind.GOOD,
    table_tilt: tuple[float, float] = (0.0, 0.0),
) -> TossedObject:
    """Toss an object once in the virtual world.

    Args:
        thing: the object.
        planned: the toss as planned.
        seed: seed of the hand's scatter, and of the camera's place.
        kind: what is wrong with the toss.
        table_tilt: (2,) rotation of gravity about x and y of W [rad].
    """
    rng = np.random.default_rng((seed, 0x7055, *planned.id.encode()))
    motion = hand_toss(planned, thing, rng, kind)
    states: list[WorldState] = []
    world = World(thing, lambda angle, rate, _: -angle - 0.05 * rate, 0, states.append, table_tilt=table_tilt)
    world.toss(motion, HOLD_S)
    world.step_to(round(HOLD_S * 1e9))
    while not world.has_landed and world.time_ns < 3_000_000_000:
        world.step_to(world.time_ns + TICK_NS)
    landing_ns = world.time_ns - TICK_NS
    world.step_to(world.time_ns + round(AFTER_S * 1e9))
    return TossedObject(thing, planned, motion, kind, seed, tuple(states), round(HOLD_S * 1e9), landing_ns)
