"""Errors of the shape's scale and faces as they move and stretch labelled parts, given the strikes.

A scan that is 0.3 mm off moves the parts' centroids, and so changes the masses with which they have the
measured centre of mass. The same error is in the measured centre of mass and moments, as pivot edges lie on
the faces. A part's face on which the object rests, or that rises from a pivot edge, therefore has the error
of that face in the joint estimate from all strikes. Every other face has an error of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from analyze.estimation.joint import JointSolution
from analyze.estimation.joint_model import COM, SCALE_TERM
from analyze.estimation.posterior import TENSOR, derived
from analyze.geometry.polyhedron import MassProperties
from analyze.types import Array

SAME_FACE_COSINE = float(np.cos(np.radians(1.0)))
"""Cosine of the angle between two normals up to which they are those of one face."""
SAME_FACE_FRACTION = 2e-3
"""Distance of two parallel faces, over the box's longest side, up to which they are one face."""


class Box(NamedTuple):
    """Centre and sides, each (3,) [m], of a box along the axes of the object frame O."""

    centre: Array
    """(3,) centre in O [m]."""
    sides: Array
    """(3,) lengths along the axes of O [m]."""


@dataclass(frozen=True)
class ShapeErrors:
    """Distribution of n errors of the shape given the strikes, and the motion of each part by each error.

    An error is that of the scale or of one face, in units of its standard deviation before any strike. The
    p parts are moved and stretched along the axes of the object frame O.
    """

    mean: Array
    """(n,) estimates; 0 for an error that the strikes do not contain."""
    covariance: Array
    """(n, n) covariance of the errors."""
    with_com: Array
    """(3, n) covariance with the centre of mass [m]."""
    with_tensor: Array
    """(6, n) covariance with the tensor per kilogram, xx, yy, zz, xy, xz, yz [m^2]."""
    shift: Array
    """(p, n, 3) displacement of each part's centroid by each error [m]."""
    stretch: Array
    """(p, n, 3) relative stretch of each part by each error, along x, y and z."""

    def moved(self, parts: Sequence[MassProperties], errors: Array) -> list[MassProperties]:
        """Parts moved and stretched by the errors (n,), given in units of their standard deviations."""
        return [
            _moved(part, errors @ shift, errors @ stretch)
            for part, shift, stretch in zip(parts, self.shift, self.stretch, strict=True)
        ]


def shape_errors(
    solution: JointSolution,
    parts: Sequence[MassProperties],
    boxes: Sequence[Box],
    faces: Mapping[str, Array],
) -> ShapeErrors | None:
    """Errors of scale and faces that move p parts, given the strikes; None for an exact shape.

    Each part lies in a box, whose opposite faces are off independently by the shape's standard deviation, so
    that the box is shifted and stretched, and the part with it. Parts in the same box share its errors.

    Args:
        solution: Solution of the joint problem of all strikes, with standard deviations of scale and faces.
        parts: Uniform solids, in the object frame O.
        boxes: Box of each part; that of its own faces, or of the whole object.
        faces: Planes (4,) of the faces that strikes may depend on, by id: outward unit normal n in O and
            offset d [m], with n.x + d = 0 on the face.
    """
    model, systematic = solution.model, solution.model.systematic
    unknowns: list[int | None] = []
    shifts: list[Array] = []
    stretches: list[Array] = []
    centroids = np.array([part.centroid for part in parts])
    if systematic.scale_sd > 0:
        unknowns.append(SCALE_TERM)
        shifts.append(systematic.scale_sd * centroids)
        stretches.append(np.full_like(centroids, systematic.scale_sd))
    keys = [(*box.centre.tolist(), *box.sides.tolist()) for box in boxes]
    for key in dict.fromkeys(keys) if systematic.face_sd > 0 else ():
        centre, sides = np.array(key[:3]), np.array(key[3:])
        inside = np.array([float(each == key) for each in keys])
        for axis in range(3):
            for sign in (-1.0, 1.0):
                outward: Array = sign * np.eye(3)[axis]
                name = _face_at(centre + outward * sides / 2, outward, faces, float(sides.max()))
                # A point half-way between two faces moves by half the error of each.
                towards = 0.5 + sign * (centroids[:, axis] - centre[axis]) / sides[axis]
                unknowns.append(model.face_terms.get(name))
                shifts.append((towards * inside)[:, None] * outward * systematic.face_sd)
                stretches.append(inside[:, None] * np.abs(outward) * systematic.face_sd / sides[axis])
    if not unknowns:
        return None
    known = [i for i, unknown in enumerate(unknowns) if unknown is not None]
    where = [unknown for unknown in unknowns if unknown is not None]
    mean, covariance = np.zeros(len(unknowns)), np.eye(len(unknowns))
    picked = np.zeros((len(unknowns), model.count))
    picked[known, where] = 1.0
    mean[known] = solution.x[where]
    covariance[np.ix_(known, known)] = solution.covariance[np.ix_(where, where)]
    _, by = derived(model, solution.x)
    with_both = np.vstack([by[COM], by[TENSOR]]) @ solution.covariance @ picked.T
    return ShapeErrors(
        mean,
        covariance,
        with_both[:3],
        with_both[3:],
        np.array(shifts).swapaxes(0, 1),
        np.array(stretches).swapaxes(0, 1),
    )


def box_of(part: MassProperties) -> Box:
    """Box with the centroid and the second moments of a uniform solid, along the axes of the object frame."""
    second = np.trace(part.unit_inertia) / 2 - np.diag(part.unit_inertia)
    return Box(part.centroid, np.sqrt(12 * second))


def _face_at(point: Array, outward: Array, faces: Mapping[str, Array], size: float) -> str:
    """Id of the face of a given outward normal (3,) nearest to a point (3,) [m]; "" if none is near.

    The face's normal may be 1 deg off, its distance less than 0.2 % (`SAME_FACE_FRACTION`) of `size` [m].
    `faces` holds planes (4,) by id: outward unit normal n and offset d [m], with n.x + d = 0 on the face.
    """
    near = [
        (abs(float(plane[:3] @ point + plane[3])), name)
        for name, plane in faces.items()
        if plane[:3] @ outward > SAME_FACE_COSINE
    ]
    distance, name = min(near, default=(np.inf, ""))
    return name if distance < SAME_FACE_FRACTION * size else ""


def _moved(part: MassProperties, shift: Array, stretch: Array) -> MassProperties:
    """Solid displaced by `shift` (3,) [m] and stretched about its centroid by 1 + `stretch` (3,).

    Its volume, which only bounds the mass, stays.
    """
    second = np.trace(part.unit_inertia) / 2 * np.eye(3) - part.unit_inertia
    second = second * np.outer(1 + stretch, 1 + stretch)
    return MassProperties(part.volume, part.centroid + shift, np.trace(second) * np.eye(3) - second)
