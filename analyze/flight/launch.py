"""Attitude and spin of a thrown body from the first frames of its flight, without a law of its rotation.

The spin in the object frame O is a polynomial of time, w(t) = w0 + w1 t + w2 t^2, about the middle of the
frames; its integral is the attitude. Euler's equations, and with them the inertia tensor, do not enter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.rotations import matrix_from_vector, vector_from_matrix

if TYPE_CHECKING:
    from analyze.flight.tracked_attitude import TrackedAttitudes
    from analyze.types import Array

SPIN_TERMS = 3
"""number of coefficients of the spin along each axis"""
MIN_FRAMES = 8
"""least number of frames"""
_PIECES = 8
"""steps of the integration between two frames"""
_MAX_STEPS = 15
"""Gauss-Newton steps"""
_DERIVATIVE_STEP = 1e-4
"""step of the numerical derivatives [rad, rad/s, rad/s^2, rad/s^3]"""
_LEAST_STEP = 1e-7
"""largest step, in the same units, that ends the fit"""


@dataclass(frozen=True)
class Launch:
    """Rotation of a thrown body at one time, in the middle of the frames it was fitted to."""

    time: float
    """time since the flight's first frame [s]"""
    R_world_object: Array
    """(3, 3) rotation from O to W"""
    spin: Array
    """(3,) angular velocity in O [rad/s]"""

    def place(self, track: TrackedAttitudes, com: Array, gravity: Array) -> tuple[Array, Array]:
        """Place [m] and velocity [m/s] of a centre of mass (3,) at the launch's time, in W.

        The parabola of given gravity is fitted to the places of this point in all frames of the track.

        Args:
            track: poses in the frames that the launch was fitted to.
            com: centre of mass in O [m], of the body that is thrown.
            gravity: (3,) gravity in W [m/s^2].
        """
        t = track.time - self.time
        lifted = track.p_world_object + track.R_world_object @ com - 0.5 * t[:, None] ** 2 * gravity
        line, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(t), t]), lifted, rcond=None)
        return line[0], line[1]


def fitted_launch(track: TrackedAttitudes) -> Launch:
    """Attitude and spin in the middle of a track's frames, by weighted least squares on its attitudes.

    The spin is w(t) = w0 + w1 t + w2 t^2 in O; the tensor is not used. It is best determined in the middle,
    where it depends least on the terms left out.

    Args:
        track: attitudes in the first frames of a flight, `MIN_FRAMES` or more.
    """
    middle = int(np.argmin(np.abs(track.time - 0.5 * (track.time[0] + track.time[-1]))))
    time, R = track.time - track.time[middle], track.R_world_object
    turns = vector_from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / np.diff(time)[:, None]
    halfway = 0.5 * (time[1:] + time[:-1])
    powers = halfway[:, None] ** np.arange(SPIN_TERMS, dtype=np.float64)
    terms: Array = np.asarray(np.linalg.lstsq(powers, turns, rcond=None)[0], dtype=np.float64)
    x: Array = np.concatenate([np.zeros(3), terms.ravel()])
    whiten = np.linalg.inv(np.linalg.cholesky(track.turn_covariance))
    for _ in range(_MAX_STEPS):
        paths = _attitudes(np.vstack([x, x + _DERIVATIVE_STEP * np.eye(len(x))]), time, R[middle])
        back = np.swapaxes(paths[0], 1, 2)
        off = np.einsum("nij,nj->ni", whiten, vector_from_matrix(R @ back))
        by = np.einsum("nij,knj->nik", whiten, vector_from_matrix(paths[1:] @ back)) / _DERIVATIVE_STEP
        flat = by.reshape(-1, by.shape[-1])
        step: Array = np.asarray(np.linalg.lstsq(flat, off.ravel(), rcond=None)[0], dtype=np.float64)
        x = x + step
        if float(np.abs(step).max()) < _LEAST_STEP:
            break
    return Launch(float(track.time[middle]), R[middle] @ matrix_from_vector(x[:3]), x[3:6])


def _attitudes(x: Array, time: Array, R_middle: Array) -> Array:
    """Attitudes (v, n, 3, 3) at times (n,) [s] for v sets of unknowns (v, 3 + 3 SPIN_TERMS).

    Args:
        x: turn at time 0 against the middle frame's attitude [rad, in O], coefficients of the spin.
        time: ascending times, one of which is 0.
        R_middle: (3, 3) attitude of the frame at time 0.
    """
    middle = int(np.argmin(np.abs(time)))
    found = np.empty((len(x), len(time), 3, 3))
    found[:, middle] = R_middle @ matrix_from_vector(x[:, :3])
    terms = x[:, 3:].reshape(len(x), SPIN_TERMS, 3)
    for order in (range(middle + 1, len(time)), range(middle - 1, -1, -1)):
        before = middle
        for frame in order:
            step = (time[frame] - time[before]) / _PIECES
            turned = found[:, before]
            for piece in range(_PIECES):
                powers = (time[before] + (piece + 0.5) * step) ** np.arange(SPIN_TERMS)
                turned = turned @ matrix_from_vector(step * np.einsum("p,vpi->vi", powers, terms))
            found[:, frame] = turned
            before = frame
    return found
