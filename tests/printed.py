"""Untagged objects of the virtual rig with print, as strikes show them at rest, and tossed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.objects import VirtualObject, load_object, without_tags
from acquire.virtual.packaging import Packaging, PrintKind
from acquire.virtual.render import Renderer
from acquire.virtual.station import HEIGHT_PX, WIDTH_PX, station
from acquire.virtual.toss import TossKind
from analyze.geometry.station import turned_camera
from analyze.tracking.print_likeness import RestView, rest_view
from analyze.tracking.print_template import IdealImages
from analyze.tracking.printed_view import PrintedView, printed_views
from analyze.types import CameraModel
from tests.benchmarks.tosses import prepared
from tests.tossed import TossedObject, planned_tosses, toss

TURN_SD, SHIFT_SD = np.radians(0.06), 2.5e-4
"""errors of a pose at rest as strikes determine it: turn about the vertical [rad], place [m]"""
REST_IMAGES = 4
PARKED = np.array([-2.5]), np.array([[-1.5, 0.0, 0.3]])
"""angle and place of an arm out of view"""


@dataclass(frozen=True)
class PrintedObject:
    """Object of the virtual rig without tags."""

    name: str
    seed: int
    kind: PrintKind = PrintKind.PRINT
    print_seed: int | None = None
    """seed of the print; None for that of the object"""
    exact: bool = False
    """True if the poses at rest are known without error"""

    @cached_property
    def thing(self) -> VirtualObject:
        """The object, with its print."""
        plain = without_tags(load_object(self.name, self.seed))
        seed = self.seed if self.print_seed is None else self.print_seed
        return replace(plain, packaging=Packaging(self.kind, seed, False))

    @cached_property
    def camera(self) -> CameraModel:
        """The true camera."""
        place = station(self.seed, self.thing.camera_distance_m)
        return CameraModel(WIDTH_PX, HEIGHT_PX, place.K, place.distortion, place.T_world_camera)

    @cached_property
    def rest_views(self) -> dict[str, RestView]:
        """The object at rest before each planned strike, by the strike's id."""
        model, plan = prepared(self.name)
        renderer = Renderer(self.thing, station(self.seed, self.thing.camera_distance_m), self.seed)
        rng, images = np.random.default_rng((self.seed, 0x9215)), IdealImages(self.camera)
        found: dict[str, RestView] = {}
        for strike in plan.strikes:
            R, p = np.array(strike.R_world_object), np.array(strike.p_world_object)
            error = np.zeros(3) if self.exact else rng.normal(0, (TURN_SD, SHIFT_SD, SHIFT_SD))
            heading = Rotation.from_euler("z", strike.heading_rad)
            turned = heading * Rotation.from_euler("z", error[0]) * Rotation.from_matrix(R)
            place = heading.apply(p + np.append(error[1:], 0.0))
            q = turned.as_quat()[[3, 0, 1, 2]]
            taken = [
                images.ideal(renderer.render(place[None], q[None], *PARKED, 1500.0, 0.0).copy())
                for _ in range(REST_IMAGES)
            ]
            camera = turned_camera(self.camera, strike.heading_rad)
            found[strike.id] = rest_view(taken, camera, model.vertices, (R, p))
        return found

    @cached_property
    def views(self) -> tuple[PrintedView, ...]:
        """Views of the print that serve for following a toss."""
        model, _ = prepared(self.name)
        return printed_views(self.rest_views, model.vertices, model.faces)

    def tossed(self, number: int = 0, kind: TossKind = TossKind.GOOD) -> TossedObject:
        """The object, tossed as planned."""
        planned = planned_tosses(self.thing, number + 1)[number]
        return toss(self.thing, planned, self.seed, kind)
