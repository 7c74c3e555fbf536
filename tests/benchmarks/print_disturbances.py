"""Disturbed strikes of `make bench-print`: camera, lens, rest pose, light, blur, shutter and video."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from acquire.virtual.world import World
from tests.benchmarks.print_sessions import (
    Scene,
    StrikeRow,
    analyse,
    chosen,
    renderer_of,
    scene,
)
from tests.benchmarks.print_strikes import Filming, Placement, film, struck, turned_station

STRIKES = 2
"""strikes of each object and seed, of two axes"""
READOUT_S = 8e-3
"""readout time of the rolling shutter [s]"""


@dataclass(frozen=True)
class Disturbance:
    """What differs from a strike with the camera along the edge, put down as planned."""

    camera_turn: float = 0.0
    """angle of the camera off the edge's direction, as calibrated [rad]"""
    lens: float = 0.0
    """relative error of the stated focal length"""
    placed: Placement = field(default_factory=Placement)
    energy: float = 1.15
    filming: Filming = field(default_factory=Filming)
    glossy: bool = False
    """True if a highlight lies on the print"""
    contact_known: bool = True
    """False if no time of contact is given, as with a phone"""


DISTURBANCES = {
    "none": Disturbance(),
    "camera 5 deg": Disturbance(camera_turn=math.radians(5)),
    "camera 10 deg": Disturbance(camera_turn=math.radians(10)),
    "camera 15 deg": Disturbance(camera_turn=math.radians(15)),
    "lens 0.3 %": Disturbance(lens=3e-3),
    "rest 1 deg": Disturbance(placed=Placement(yaw=math.radians(1.0))),
    "rest 2 mm": Disturbance(placed=Placement(x=1.4e-3, y=1.4e-3)),
    "rest 1 deg 2 mm": Disturbance(placed=Placement(math.radians(1.0), 1.4e-3, 1.4e-3)),
    "rocked back": Disturbance(energy=0.9),
    "blur 2 ms": Disturbance(filming=Filming(exposure_us=2000.0)),
    "blur 5 ms": Disturbance(filming=Filming(exposure_us=5000.0)),
    "moving shadow": Disturbance(filming=Filming(shadow=True)),
    "arm across": Disturbance(filming=Filming(arm_across=True)),
    "gloss": Disturbance(glossy=True),
    "h264 crf 23": Disturbance(filming=Filming(crf=23)),
    "h264 crf 28": Disturbance(filming=Filming(crf=28)),
    "rolling shutter": Disturbance(filming=Filming(readout_s=READOUT_S)),
    "no contact time": Disturbance(contact_known=False),
}
"""all disturbances, by name"""


@dataclass(frozen=True)
class DisturbedRow:
    """Errors of one disturbed strike by one road."""

    disturbance: str
    strike: StrikeRow


def run_disturbed(case: tuple[str, int, tuple[str, ...], str]) -> list[DisturbedRow]:
    """Strike, film and analyse an object's strikes under one disturbance.

    Args:
        case: name of the object, seed, roads, and name of the disturbance.
    """
    name, seed, roads, title = case
    cv2.setNumThreads(1)
    disturbance = DISTURBANCES[title]
    rng = np.random.default_rng((seed, 0xD157, *name.encode()))
    on = _disturbed(scene(name, seed, False, rng), disturbance)
    world = World(on.thing, lambda *_: 0.0, table_tilt=(0.0, on.tilt), arm_angle=-2.5)
    renderers = {road: renderer_of(on, road, seed, disturbance.glossy) for road in roads}
    rows: list[DisturbedRow] = []
    for planned in chosen(on.plan, STRIKES):
        motion = struck(world, on.thing, planned, disturbance.placed, (disturbance.energy, 0.003))
        phase = int(rng.integers(1 << 30))
        for road in roads:
            draw = np.random.default_rng(phase)
            frames = film(renderers[road], motion, planned.heading_rad, disturbance.filming, draw)
            row, _ = analyse(on, road, planned, motion, frames, disturbance.contact_known)
            rows.append(DisturbedRow(title, replace(row, name=name, seed=seed)))
    return rows


def _disturbed(on: Scene, disturbance: Disturbance) -> Scene:
    """Scene with the disturbance's camera: turned, and with a lens other than stated."""
    place = turned_station(on.place, disturbance.camera_turn)
    K = place.K.copy()
    K[:2, :2] *= 1 + disturbance.lens
    line_time = disturbance.filming.readout_s / on.camera.height
    camera = replace(on.camera, K=K, T_world_camera=place.T_world_camera, line_time_s=line_time)
    return replace(on, place=place, camera=camera)
