"""Strikes of a specimen in a contact simulator (MuJoCo), and the bank that keeps their poses.

The body is a free body that touches the table with its spheres, under dry friction. The table top is a plate
on a spring: a strike presses the edge into it, and it throws the edge up by some tenths of a millimetre, as a
real one does. A strike is a half-sine push at the planned height. What the model leaves out: air, an elastic
body, a striker with mass.
"""

# mujoco takes its names from a compiled module that pyright cannot analyse.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
import os
import zlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tests.benchmarks.honesty.bodies import Specimen, TrueBody
from tests.benchmarks.honesty.statics import G, TrueTip, gravity_direction, true_tip

VERSION = 1
"""changed whenever the simulation changes, so that no motion of an earlier one is read"""
STEP = 1e-4
"""time step [s]"""
KEPT = 10
"""steps per kept pose"""
SETTLING = 0.06
"""time to settle before the push [s]"""
LONGEST = 1.6
"""longest simulated motion [s]"""
AFTER_LANDING = 0.12
"""time kept after the tip has gone far past balance [s]"""
PAST_BALANCE = math.radians(50)
TRIES = 8
"""attempts to make a strike tip over, each with more energy"""
SPARE_TURN, SPARE_STEP, SPARE_HEIGHT = math.radians(12), math.radians(2), 8e-3
"""turns beyond those of a tip, their step, and height [m] up to which spheres may touch the table"""
MOST_SETTLING = math.cos(math.radians(8))
"""cosine of the angle by which a body may settle against the planned pose"""
SAME_FACE, SAME_PLANE = math.cos(math.radians(0.05)), 2e-5
"""cosine of the angle, and distance [m], up to which facets of the hull are one face"""
LONG_EDGE = 0.3
"""length of an edge over its face's extent, from which on a user puts the body down along it"""
SNAP = math.cos(math.radians(6))
"""largest angle between a planned face or edge and the true one that it stands for"""


@dataclass(frozen=True)
class StruckMotion:
    """True poses of one strike; the push begins at time 0."""

    time: np.ndarray
    """(n,) [s], from 0"""
    position: np.ndarray
    """(n, 3) O's origin in W [m]"""
    quaternion: np.ndarray
    """(n, 4) rotation from O to W (x, y, z, w)"""
    R_rest: np.ndarray
    """(3, 3) rest pose before the push"""
    tip: TrueTip
    energy: float
    """energy ratio aimed at"""
    over: bool
    """True if the body passed its balance"""


@lru_cache(maxsize=16)
def faces_of(body: TrueBody) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Outward normals (f, 3) of the hull's faces, the edge directions (e, 3) and the area (f,) of each."""
    hull = ConvexHull(np.unique(np.concatenate([p.reshape(-1, 3) for p in body.pieces]), axis=0))
    normals, label = np.unique(np.round(hull.equations[:, :3], 5), axis=0, return_inverse=True)
    corners = hull.points[hull.simplices]
    sides = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    label = label.ravel()
    edges = []
    for face in range(len(normals)):
        found = []
        for triangle in np.flatnonzero(label == face):
            for other in range(3):
                if label[hull.neighbors[triangle][other]] != face:
                    a, b = np.delete(hull.simplices[triangle], other)
                    edge = hull.points[b] - hull.points[a]
                    found.append(edge / np.linalg.norm(edge))
        edges.append(np.array(found))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True), edges, np.bincount(label, sides)


def settled_pose(specimen: Specimen, R_planned: np.ndarray) -> np.ndarray | None:
    """True rest rotation (3, 3), from O to W, of a body put down as planned and left to settle.

    It rests on the face of the hull of its contact spheres that lies nearest to the table and holds the
    centre of mass; None if that is tilted by more than `MOST_SETTLING` against the plan. A long edge of the
    face nearly square to the tip is put square to it.
    """
    hull = _contact_hull(specimen.body)
    normals, up, along = hull.equations[:, :3], R_planned[2], R_planned[1]
    near = np.flatnonzero(-normals @ up > MOST_SETTLING)
    for facet in near[np.argsort(normals[near] @ up)]:
        a, b, c = hull.points[hull.simplices[facet]]
        shares = np.linalg.lstsq(np.stack([a - c, b - c]).T, specimen.com - c, rcond=None)[0]
        if min(*shares, 1 - shares.sum()) >= 0:
            break
    else:
        return None
    up = -normals[facet]
    same = np.flatnonzero(
        (normals @ normals[facet] > SAME_FACE)
        & (np.abs(hull.equations[:, 3] - hull.equations[facet, 3]) < SAME_PLANE)
    )
    corners = hull.points[np.unique(hull.simplices[same])]
    sides = [
        np.delete(hull.simplices[i], k) for i in same for k in range(3) if hull.neighbors[i][k] not in same
    ]
    edges = np.array([hull.points[second] - hull.points[first] for first, second in sides])
    long = edges[np.linalg.norm(edges, axis=1) > LONG_EDGE * float(np.ptp(corners, axis=0).max())]
    along = along - up * (along @ up)
    along /= np.linalg.norm(along)
    if len(long):
        long = long / np.linalg.norm(long, axis=1, keepdims=True)
        best = long[int(np.argmax(np.abs(long @ along)))]
        if abs(best @ along) > SNAP:
            along = best * np.sign(best @ along)
    return np.stack([np.cross(along, up), along, up])


@lru_cache(maxsize=4)
def _contact_hull(body: TrueBody) -> ConvexHull:
    return ConvexHull(body.centres)


def true_rest_pose(specimen: Specimen, R_planned: np.ndarray) -> np.ndarray:
    """True rest rotation (3, 3), from O to W: that nearest to the plan's with a true face on the table.

    An edge of this face is square to the tip.

    Where no true face or edge is within 6 degrees of the planned one, the planned one is used (a round rim).
    """
    normals, edges, _ = faces_of(specimen.body)
    up, along = R_planned[2], R_planned[1]
    face = int(np.argmax(-normals @ up))
    if -normals[face] @ up > SNAP:
        up = -normals[face]
        near = edges[face] @ along
        best = int(np.argmax(np.abs(near)))
        if abs(near[best]) > SNAP and len(edges[face]) < 12:
            along = edges[face][best] * np.sign(near[best])
    along = along - up * (along @ up)
    along /= np.linalg.norm(along)
    return np.stack([np.cross(along, up), along, up])


def model_xml(specimen: Specimen, tilt: np.ndarray, touching: np.ndarray | None = None) -> str:
    """MuJoCo model (MJCF) of the specimen on the springy table top, with the `touching` spheres or all."""
    I = specimen.inertia  # noqa: E741 - the field's name
    mass, frequency, damping = specimen.plate
    spring = f'stiffness="{mass * frequency**2:.6g}" damping="{2 * damping * frequency * mass:.6g}"'
    body = specimen.body
    friction = f'friction="{specimen.friction:.6g} 0.005 0.0001"'
    contact = 'solref="0.001 1" solimp="0.995 0.9995 0.0001"'
    spheres = "\n".join(
        f'<geom type="sphere" size="{body.radii[i]:.9g}" contype="0" conaffinity="1" {friction}'
        f' pos="{_text(body.centres[i])}"/>'
        for i in (range(len(body.radii)) if touching is None else touching)
    )
    inertia = _text([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
    return f"""<mujoco>
<option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="100" tolerance="1e-12"
        iterations="50" gravity="{_text(G * gravity_direction(tilt))}"/>
<compiler balanceinertia="false"/>
<worldbody>
<body name="plate" pos="0 0 -0.05" gravcomp="1">
<joint type="slide" axis="0 0 1" {spring}/>
<inertial pos="0 0 0" mass="{mass:.6g}" diaginertia="1 1 1"/>
<geom type="box" size="1 1 0.05" contype="1" conaffinity="0" priority="1" {friction} {contact}/>
</body>
<body name="object" pos="0 0 0">
<freejoint/>
<inertial pos="{_text(specimen.com)}" mass="{specimen.masses.sum():.9g}" fullinertia="{inertia}"/>
{spheres}
</body>
</worldbody>
</mujoco>"""


def _text(values: np.ndarray | list[float]) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)


class Bank:
    """Struck motions by specimen, rest pose, height and variant, kept in a folder across runs.

    Args:
        folder: folder of the bank; None to keep nothing on disk.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self.simulated = 0

    def motion(
        self, specimen: Specimen, R_planned: np.ndarray, height: float, tilt: np.ndarray, variant: str
    ) -> StruckMotion | None:
        """Poses of a strike, from the bank or simulated; None if the body does not stand in this pose.

        Args:
            specimen: the body struck.
            R_planned: (3, 3) planned rest pose; the body stands on its true face nearest to it.
            height: height of the push over the table [m], used to the millimetre.
            tilt: (2,) tilt of the table [rad].
            variant: "over" or "back" with a number: energy and duration of the push are drawn from it.
        """
        settles = specimen.body.settles
        R_rest = (settled_pose if settles else true_rest_pose)(specimen, R_planned)
        if R_rest is None:
            return None
        height = round(height, 3)
        tip = true_tip(specimen, R_rest, tilt)
        if tip is None:
            return None
        numbers = (
            np.round(
                [*R_rest.ravel(), height, *specimen.com, *specimen.plate, *tilt, *specimen.body.radii], 6
            )
            + 0.0
        )
        key = zlib.crc32(numbers.tobytes() + f"{VERSION} {variant}".encode())
        path = None
        if self._folder is not None:
            path = self._folder / f"{specimen.body.name}-{specimen.number}" / f"{variant}-{key:08x}.npz"
            if (kept := _read(path)) is not None:
                return StruckMotion(*kept[:3], R_rest, tip, float(kept[3]), bool(kept[4]))
        found = _strike(specimen, R_rest, tip, height, tilt, variant, key)
        self.simulated += 1
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_suffix(f".{os.getpid()}.partial")
            with partial.open("wb") as file:
                np.savez(
                    file,
                    time=found.time,
                    position=found.position,
                    quaternion=found.quaternion,
                    energy=found.energy,
                    over=found.over,
                )
            partial.replace(path)
        return found


def _read(path: Path) -> list[np.ndarray] | None:
    try:
        with np.load(path) as kept:
            return [kept[name] for name in ("time", "position", "quaternion", "energy", "over")]
    except (OSError, ValueError, KeyError, zlib.error):
        return None


def _strike(
    specimen: Specimen,
    R_rest: np.ndarray,
    tip: TrueTip,
    height: float,
    tilt: np.ndarray,
    variant: str,
    seed: int,
) -> StruckMotion:
    """Simulate a strike, with more energy each time until the body tips over if it is to."""
    rng = np.random.default_rng(seed)
    back = variant.startswith("back")
    energy = rng.uniform(0.85, 0.97) if back else rng.uniform(1.03, 1.3)
    seconds = rng.uniform(0.002, 0.004)
    height = min(height * rng.uniform(0.98, 1.02), 0.98 * _tall(specimen, R_rest))
    touching = _touching(specimen.body, R_rest, tip.phi) if specimen.body.settles else None
    model = mujoco.MjModel.from_xml_string(model_xml(specimen, tilt, touching))
    motion = None
    for _ in range(1 if back else TRIES):
        impulse = math.sqrt(2 * specimen.masses.sum() * G * tip.rise * energy * tip.i_edge) / height
        poses = _poses(model, specimen, R_rest, tip, (impulse, height, seconds))
        motion = StruckMotion(*poses, R_rest, tip, energy, over=_largest(poses[2], R_rest) > tip.phi + 0.1)
        if motion.over:
            break
        energy *= 1.07
    assert motion is not None
    return motion


def _touching(body: TrueBody, R_rest: np.ndarray, phi: float) -> np.ndarray:
    """Numbers of the spheres that a tip can bring near the table: it turns, rolls aside, and lands."""
    theta, roll = np.meshgrid(
        np.arange(-SPARE_TURN, phi + PAST_BALANCE + SPARE_TURN, SPARE_STEP),
        np.arange(-SPARE_TURN, SPARE_TURN + SPARE_STEP, SPARE_STEP),
    )
    turned = Rotation.from_euler("XY", np.stack([roll.ravel(), theta.ravel()], axis=-1)).as_matrix()
    height = body.centres @ (turned[:, 2] @ R_rest).T
    return np.flatnonzero((height - height.min(axis=0) < SPARE_HEIGHT).any(axis=1))


def _tall(specimen: Specimen, R_rest: np.ndarray) -> float:
    heights = specimen.body.centres @ R_rest[2]
    return float(np.ptp(heights) + specimen.body.radii.min() * 2)


def _largest(quaternion: np.ndarray, R_rest: np.ndarray) -> float:
    turned = (Rotation.from_quat(quaternion) * Rotation.from_matrix(R_rest).inv()).as_matrix()
    return float(np.arctan2(turned[:, 0, 2], turned[:, 2, 2]).max())


def _poses(
    model: mujoco.MjModel,
    specimen: Specimen,
    R_rest: np.ndarray,
    tip: TrueTip,
    push: tuple[float, float, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (n,), position (n, 3) and quaternion (n, 4) after a push of (impulse, height, seconds)."""
    impulse, height, seconds = push
    data = mujoco.MjData(model)
    # The centre line of the edge lies over y, as planned; the plan's impact point is at y = 0.
    low = float((specimen.body.centres @ R_rest[2] - specimen.body.radii).min())
    beside = float(R_rest[1] @ np.array(specimen.body.struck_beside))
    data.qpos[1:4] = (-float(R_rest[0] @ tip.line), -beside, -low)
    x, y, z, w = Rotation.from_matrix(R_rest).as_quat()
    data.qpos[4:8] = (w, x, y, z)
    for _ in range(round(SETTLING / STEP)):
        mujoco.mj_step(model, data)
    number = model.body("object").id
    first = np.array([0.0, 0.0, height]) - data.xipos[number]
    found, end, steps = [], LONGEST, 0
    while steps * STEP < end:
        now = steps * STEP
        if steps % KEPT == 0:
            found.append((now, *data.qpos[1:4], *data.qpos[5:8], data.qpos[4]))
            upright = data.xmat[number].reshape(3, 3) @ R_rest.T
            if end == LONGEST and math.atan2(upright[0, 2], upright[2, 2]) > tip.phi + PAST_BALANCE:
                end = now + AFTER_LANDING
        if now <= seconds:
            force = impulse * math.pi / (2 * seconds) * math.sin(math.pi * now / seconds)
            data.xfrc_applied[number] = (force, 0, 0, 0, force * first[2], -force * first[1])
        else:
            data.xfrc_applied[number] = 0.0
        mujoco.mj_step(model, data)
        steps += 1
    table = np.array(found)
    return table[:, 0], table[:, 1:4], table[:, 4:8]
