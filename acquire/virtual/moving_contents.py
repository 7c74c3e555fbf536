"""Motion of an object's contents in the simulated world: one point mass inside a convex body.

The point mass is a child of the object in MuJoCo's model, with three slides along the axes of O (the object's
frame), so that every force on it acts on the object in the opposite direction. The boundary of the convex
body pushes it back by a stiff damped spring, and along the boundary dry and viscous friction act. The part of
a liquid that does not move is a second child, fixed in the object; whenever the object is set down, the
liquid is divided anew.
"""
# mujoco takes its names from a compiled module that pyright cannot analyse.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.optimize import minimize

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.contents import Contents, MovingPart

WALL_RATE = 400.0
"""angular frequency of the contents on the spring of a wall [rad/s]: 0.06 mm deep at rest"""
WALL_DAMPING = 0.7
"""damping ratio on that spring"""
CREEP_M_S = 2e-3
"""speed from which dry friction is the full one [m/s]"""
REST_M_S = 0.03
"""speed within the object below which contents count as at rest [m/s]: a liquid needs ten seconds to be
still"""
PLACE_SHARE = 0.3
"""largest distance of a lump from the middle when the object is set down, as a share of the way to a wall"""


def contents_xml(contents: Contents | None) -> str:
    """Text of the contents' body in MJCF (MuJoCo's XML), a child of the object's; empty without contents."""
    if contents is None:
        return ""
    slides = "".join(
        f'<joint name="contents_{name}" type="slide" axis="{axis}"/>'
        for name, axis in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
    )
    # Point masses; MuJoCo requires moments of inertia above 0.
    tiny = f"{1e-9 * contents.mass_kg:.6g}"
    inertial = f'<inertial pos="0 0 0" mass="{contents.mass_kg:.12g}" diaginertia="{tiny} {tiny} {tiny}"/>'
    still = f'<body name="still_contents">{inertial}</body>'
    return f'<body name="contents">{slides}{inertial}</body>{still}'


class MovingContents:
    """Forces on the contents of one object, and the time steps of a model with or without contents.

    Args:
        contents: what moves inside; None for a rigid object.
        model: the world's MuJoCo model, with the body of `contents_xml`.
        data: its state.
    """

    def __init__(
        self,
        contents: Contents | None,
        model: mujoco.MjModel,
        data: mujoco.MjData,
    ) -> None:
        self._contents, self._model, self._data = contents, model, data
        if contents is None:
            return
        self._rng = np.random.default_rng((contents.seed, 0x1A51DE))
        first = model.joint("contents_x")
        self._place = slice(int(first.qposadr[0]), int(first.qposadr[0]) + 3)
        self._speed = slice(int(first.dofadr[0]), int(first.dofadr[0]) + 3)
        self._normals = np.ascontiguousarray(contents.planes[:, :3])
        self._offsets = contents.planes[:, 3].copy()
        self._stale = True
        self._moving, self._still = model.body("contents").id, model.body("still_contents").id
        self._share, self._base, self._mass = 1.0, np.zeros(3), contents.mass_kg
        # The mass at p moves on K as the place base + share * p does.

    @property
    def at_rest(self) -> bool:
        """True if nothing moves within the object."""
        return self._contents is None or bool(np.abs(self._data.qvel[self._speed]).max() < REST_M_S)

    def stop(self) -> None:
        """Let the contents rest where they are."""
        if self._contents is not None:
            self._data.qvel[self._speed] = 0.0

    def settle(self, R_world_object: NDArray[np.float64]) -> None:
        """Put the contents where they rest in an object that is turned so (3, 3), without motion.

        A lump comes to rest anywhere on the lowest wall, up to PLACE_SHARE of the way from its middle.
        """
        contents = self._contents
        if contents is None:
            return
        gravity = R_world_object.T @ self._model.opt.gravity
        strength = float(np.linalg.norm(gravity))
        down = gravity / strength
        centroid = contents.lowest(down)
        self._divide(contents, centroid, contents.moving_part(down))
        place = (centroid - self._base) / self._share
        if not contents.smooth_m:
            aside = self._rng.normal(size=3)
            aside -= (aside @ down) * down
            aside /= np.linalg.norm(aside)
            way = self._rng.uniform(0, PLACE_SHARE) * contents.reach(contents.middle, aside)
            shifted = contents.middle + way * aside
            place = shifted + contents.reach(shifted, down) * down

        def potential(offset: NDArray[np.float64]) -> float:
            wall = self._wall(contents, place + offset)
            depth = 0.0 if wall is None else float(wall[0][0])
            return 0.5 * WALL_RATE**2 * depth**2 - float(gravity @ offset)

        sunk = strength / WALL_RATE**2 * down
        if contents.smooth_m:
            found = minimize(potential, sunk, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12})
            sunk = found.x
        self._data.qpos[self._place] = place + sunk
        self._data.qvel[self._speed] = 0.0
        self._data.qfrc_applied[self._speed] = 0.0

    def _divide(self, contents: Contents, centroid: NDArray[np.float64], part: MovingPart) -> None:
        """Give moving and fixed mass their parts and places, so that together they have the centroid (3,)."""
        model, rest = self._model, 1 - part.share
        self._share, self._mass = part.share, part.share * contents.mass_kg
        self._base = centroid - part.share * (centroid + part.shift)
        self._offsets = (contents.planes[:, 3] - self._normals @ self._base) / self._share
        model.body_mass[self._moving] = self._mass
        model.body_mass[self._still] = rest * contents.mass_kg
        model.body_pos[self._still] = centroid - (part.shift * part.share / rest if rest > 0 else 0.0)
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def step(self, count: int = 1) -> None:
        """Take time steps of the whole model; the contents' forces are computed anew in every second one."""
        if self._contents is None:
            mujoco.mj_step(self._model, self._data, nstep=count)
            return
        for _ in range(count):
            if self._stale:
                self._data.qfrc_applied[self._speed] = self._force(self._contents)
            self._stale = not self._stale
            mujoco.mj_step(self._model, self._data)

    def _force(self, contents: Contents) -> NDArray[np.float64]:
        """Force (3,) [N] on the contents by the boundary, in O."""
        velocity = self._data.qvel[self._speed]
        wall = self._wall(contents, self._data.qpos[self._place])
        if wall is None:
            return np.zeros(3)
        depths, normals = wall
        stiffness, damping = self._mass * WALL_RATE**2, 2 * WALL_DAMPING * self._mass * WALL_RATE
        pushes = np.maximum(stiffness * depths + damping * (normals @ velocity), 0.0)
        force = -(pushes @ normals)
        push = math.sqrt(force @ force)
        if push == 0.0:
            return force
        inward = force / push
        along = velocity - (velocity @ inward) * inward
        speed = math.sqrt(along @ along)
        # Dry friction takes at most half of the speed between two computations.
        most = 0.25 * self._mass / self._model.opt.timestep
        dry = min(contents.friction * push / max(speed, CREEP_M_S), most)
        return force - (dry + self._mass * contents.damping_per_s) * along

    def _wall(
        self, contents: Contents, place: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Depths (w,) [m] beyond walls and their outward normals (w, 3) at a place (3,); None inside of all.

        The planes of a smooth boundary are blended to one.
        """
        beyond = self._normals @ place - self._offsets
        most = float(beyond.max())
        if not contents.smooth_m:
            if most <= 0:
                return None
            passed = beyond > 0
            return beyond[passed], self._normals[passed]
        smooth = contents.smooth_m / self._share
        if most <= -8 * smooth:
            return None
        near = (beyond > most - 8 * smooth).nonzero()[0]
        weight = np.exp((beyond[near] - most) / smooth)
        total = float(weight.sum())
        depth = most + smooth * math.log(total)
        if depth <= 0:
            return None
        return np.array([depth]), (weight @ self._normals[near])[None] / total
