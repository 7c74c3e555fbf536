"""Corners of the tags of a thrown body in a camera's images, from an independent simulation (scipy).

The air presses on every panel of a box with a power of its own of the speed along the normal, and sucks on
the lee side, unlike the estimator's law.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from analyze.flight.air_drag import hull_panels
from analyze.flight.flight_model import COM, SHAPE, FlightModel, ThrownBody, TossStart
from analyze.flight.toss_fit import FlightPrior
from analyze.flight.views import TagSet, TossViews, tag_set
from analyze.geometry.second_moments import log_cholesky, scale_free
from analyze.types import CameraModel, Marker, MarkerTrack

FRAME_RATE = 120.0
R_WORLD_CAMERA = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
CAMERA = CameraModel(
    656,
    492,
    np.array([[1430.0, 0.0, 327.5], [0.0, 1430.0, 245.5], [0.0, 0.0, 1.0]]),
    np.zeros(5),
    np.vstack([np.column_stack([R_WORLD_CAMERA, [0.03, -0.55, 0.08]]), [0.0, 0.0, 0.0, 1.0]]),
)


@dataclass(frozen=True)
class ThrownBox:
    """Box with six tags, its mass, centre of mass and tensor about it."""

    size: np.ndarray
    mass: float
    com: np.ndarray
    inertia: np.ndarray
    tag_size: float = 0.035
    drag: float = 1.1

    @property
    def hull(self) -> np.ndarray:
        return np.array(list(product(*[(-a / 2, a / 2) for a in self.size])))

    def markers(self, place_sd: float = 3e-4, turn_sd: float = np.radians(0.3)) -> list[Marker]:
        found = []
        for axis, sign in product(range(3), (1, -1)):
            normal, along = np.zeros(3), np.zeros(3)
            normal[axis], along[(axis + 1) % 3] = sign, 1.0
            pose = np.eye(4)
            pose[:3, :3] = np.column_stack([along, np.cross(normal, along), normal])
            pose[:3, 3] = normal * self.size[axis] / 2
            found.append(Marker(len(found), self.tag_size, pose, place_sd, turn_sd))
        return found

    def _panels(self, cuts: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        points, normals, areas = [], [], []
        middle = (np.arange(cuts) + 0.5) / cuts - 0.5
        for axis, sign in product(range(3), (1, -1)):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            for u, v in product(middle, middle):
                point, normal = np.zeros(3), np.zeros(3)
                point[axis], point[b], point[c] = (
                    sign * self.size[axis] / 2,
                    u * self.size[b],
                    v * self.size[c],
                )
                normal[axis] = sign
                points.append(point)
                normals.append(normal)
                areas.append(self.size[b] * self.size[c] / cuts**2)
        return np.array(points), np.array(normals), np.array(areas)

    def path(
        self, R: np.ndarray, spin: np.ndarray, place: np.ndarray, velocity: np.ndarray, time: np.ndarray
    ):
        """Attitudes (n, 3, 3) and places of c (n, 3) at the times (n,)."""
        points, normals, areas = self._panels()
        arms, inverse = points - self.com, np.linalg.inv(self.inertia)

        def rates(_t: float, y: np.ndarray) -> np.ndarray:
            turn = Rotation.from_quat(y[:4])
            w, v = y[4:7], y[10:13]
            along = np.sum(normals * (turn.inv().apply(v) + np.cross(w, arms)), axis=1)
            # Three quarters of the force in front, a quarter behind.
            push = np.where(along > 0, 0.75 * along**2, -0.25 * along**2)
            forces = -0.6 * self.drag * (areas * push)[:, None] * normals
            moment = np.cross(arms, forces).sum(axis=0)
            q = y[:4]
            by = 0.5 * np.concatenate([q[3] * w + np.cross(q[:3], w), [-q[:3] @ w]])
            acceleration = np.array([0, 0, -9.81]) + turn.apply(forces.sum(axis=0)) / self.mass
            return np.concatenate([by, inverse @ (moment - np.cross(w, self.inertia @ w)), v, acceleration])

        start = np.concatenate([Rotation.from_matrix(R).as_quat(), spin, place, velocity])
        y = solve_ivp(rates, (time[0], time[-1]), start, t_eval=time, rtol=1e-9, atol=1e-11).y.T
        return Rotation.from_quat(y[:, :4]).as_matrix(), y[:, 7:10]


def tossed(
    box: ThrownBox,
    rng: np.random.Generator,
    noise_px: float = 0.1,
    flight_s: float = 0.4,
    turns_per_s: float = 2.5,
    axis: np.ndarray | None = None,
    moved: np.ndarray | None = None,
) -> tuple[TossViews, TagSet]:
    """Views of one toss: all tags whose face is seen at less than 70 degrees, with noise.

    Args:
        box: the body.
        rng: random numbers for start and noise.
        noise_px: 1 sigma of the corners.
        flight_s: time in the air.
        turns_per_s: spin.
        axis: axis of the spin in the object frame; None for any.
        moved: (6, 6) shift and turn of the tags against their stated places; None for none.
    """
    time = np.arange(round(flight_s * FRAME_RATE)) / FRAME_RATE
    start = true_start(box, rng, flight_s, turns_per_s, axis)
    attitudes, places = box.path(start.R_world_object, start.spin, start.place, start.velocity, time)
    markers = box.markers()
    tags = tag_set(markers)
    corners = tags.corners
    if moved is not None:
        turned = Rotation.from_rotvec(moved[:, 3:]).as_matrix()
        centres = tags.centres[:, None, :]
        corners = centres + moved[:, None, :3] + np.einsum("kij,kcj->kci", turned, corners - centres)
    R_camera_world = R_WORLD_CAMERA.T
    views = []
    for tag, marker in enumerate(markers):
        T = marker.T_object_marker
        for frame, (turn, where) in enumerate(zip(attitudes, places, strict=True)):
            in_camera = (where + (corners[tag] - box.com) @ turn.T - [0.03, -0.55, 0.08]) @ R_camera_world.T
            normal = R_camera_world @ turn @ T[:3, 2]
            centre = in_camera.mean(axis=0)
            if -normal @ centre / np.linalg.norm(centre) < 0.34:
                continue
            pixels = in_camera[:, :2] / in_camera[:, 2:] * 1430.0 + [327.5, 245.5]
            if pixels.min() < 3 or pixels[:, 0].max() > 653 or pixels[:, 1].max() > 489:
                continue
            noisy = pixels + rng.normal(0, noise_px, (4, 2))
            views.append((frame, tag, noisy, R_camera_world @ turn @ T[:3, :3], centre))
    frame, tag, pixels, turns, centres = (np.array(each) for each in zip(*views, strict=True))
    used, frame = np.unique(frame, return_inverse=True)
    stamps = np.rint(1e9 * time[used]).astype(np.int64)
    sd, rows = np.full(len(tag), noise_px), pixels[..., 1] - 245.5
    return TossViews(stamps, frame, tag, pixels, sd, turns, centres, rows), tags


def true_start(
    box: ThrownBox,
    rng: np.random.Generator,
    flight_s: float = 0.4,
    turns_per_s: float = 2.5,
    axis: np.ndarray | None = None,
) -> TossStart:
    """State at the first frame of the toss that `tossed` makes of the same random numbers."""
    axis = rng.normal(size=3) if axis is None else axis
    R = Rotation.random(random_state=rng).as_matrix()
    spin = 2 * np.pi * turns_per_s * axis / np.linalg.norm(axis)
    velocity = np.array([*rng.normal(0, 0.1, 2), 9.81 * flight_s / 2])
    place = np.array([rng.normal(0.03, 0.02), 0.6, 0.08 - 9.81 * flight_s**2 / 16])
    return TossStart(R, spin, place, velocity)


def lopsided_box() -> ThrownBox:
    """Box of 80 x 50 x 160 mm and 120 g: a heavy shell and a turned block beside its middle."""
    size, block = np.array([0.08, 0.05, 0.16]), np.array([0.04, 0.03, 0.06])
    turn = Rotation.from_rotvec([0.3, 0.5, 0.2]).as_matrix()
    places = np.zeros(3), np.array([0.015, -0.008, -0.025])
    com = 0.5 * (places[0] + places[1])
    inertia = np.zeros((3, 3))
    for place, own in zip(places, (1.5 * _solid(size), turn @ _solid(block) @ turn.T), strict=True):
        arm = place - com
        inertia += 0.06 * (own + (arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return ThrownBox(size, 0.12, com, inertia)


def _solid(size: np.ndarray) -> np.ndarray:
    square = size**2
    return np.diag(square.sum() - square) / 12


def known(box: ThrownBox) -> tuple[ThrownBody, FlightPrior]:
    """What is known of a box before its flights."""
    numbers = log_cholesky(_solid(box.size))
    prior = FlightPrior(np.zeros(3), box.size, scale_free(numbers)[0], 9.81, 1e-3)
    return ThrownBody(hull_panels(box.hull), box.mass, float(numbers[0])), prior


def first_numbers(box: ThrownBox, prior: FlightPrior, tags: TagSet, model: FlightModel) -> np.ndarray:
    """Unknowns with the true body, tags as stated, and the model's first guesses."""
    x = np.concatenate([prior.mean_and_sd(tags)[0], *(start.numbers for _, start in model.tosses)])
    x[COM], x[SHAPE] = box.com, scale_free(log_cholesky(box.inertia / box.mass))[0]
    return x


def tracks(views: TossViews, tags: TagSet) -> list[MarkerTrack]:
    """Views as the tracker's tracks."""
    found = []
    for tag, name in enumerate(tags.names):
        mine = views.tag == tag
        if mine.any():
            times = views.time_ns[views.frame[mine]]
            poses = views.R_camera_tag[mine], views.p_camera_tag[mine]
            found.append(MarkerTrack(name, times, views.corners[mine], views.sd[mine], *poses, len(views)))
    return found


def held_before(views: TossViews, frames: int) -> TossViews:
    """Views with frames before them in which the body is held as in the first one."""
    step = int(np.median(np.diff(views.time_ns)))
    first = np.flatnonzero(views.frame == 0)
    again = np.tile(first, frames)
    rng = np.random.default_rng(frames)
    noise = rng.normal(0, 1, (len(again), 4, 2)) * views.sd[again, None, None]
    before = views.time_ns[0] - step * np.arange(frames, 0, -1)
    return TossViews(
        np.concatenate([before, views.time_ns]),
        np.concatenate([np.repeat(np.arange(frames), len(first)), views.frame + frames]),
        np.concatenate([views.tag[again], views.tag]),
        np.concatenate([views.corners[again] + noise, views.corners]),
        np.concatenate([views.sd[again], views.sd]),
        np.concatenate([views.R_camera_tag[again], views.R_camera_tag]),
        np.concatenate([views.p_camera_tag[again], views.p_camera_tag]),
        np.concatenate([views.rows[again], views.rows]),
    )
