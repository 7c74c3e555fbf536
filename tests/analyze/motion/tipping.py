"""Independent simulation of a tip, and its view by a camera: a body that rolls on its rounding.

Its motion (method, section 3) is solved by scipy's adaptive integrator. Models a box with a circular edge
rounding that rolls without slip, started by a speed; no striker, no air, no friction limit. Slip, lift and
twist may be added as given motions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from analyze.tracking.camera_model import distort, project_ideal, world_to_camera
from analyze.types import CameraModel, Marker, MarkerTrack, TipAngle
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range

G = 9.80665
W, D, H = 0.06, 0.05, 0.2
SIZE = 0.03


@dataclass(frozen=True)
class Tip:
    time: np.ndarray
    theta: np.ndarray
    phi: float
    k: float
    contact: float


@cache
def simulate(
    energy=1.05, rho=0.002, com=(0.03, 0.1), rate=120.0, rest=0.25, length=1.2, speed_change=None, phase=0.3
):
    """Tip of a box with the centre of mass `com`: (x behind the virtual corner, z over the table) [m].

    `speed_change`: time after the contact [s], and factor on the angular speed then.
    """
    a, b = com[0] - rho, com[1] - rho
    R, phi = np.hypot(a, b), np.arctan2(a, b)
    inertia = (W * W + H * H) / 12

    def s(th):
        return rho + R * np.cos(phi - th)

    def s1(th):
        return R * np.sin(phi - th)

    def rate_of(_, y):
        th, om = y
        M = inertia + s(th) ** 2 + s1(th) ** 2
        dM = 2 * s1(th) * (s(th) - R * np.cos(phi - th))
        return [om, (-G * s1(th) - 0.5 * dM * om * om) / M]

    k = G * R / (inertia + (R + rho) ** 2)
    omega = np.sqrt(2 * G * (R + rho - s(0)) * energy / (inertia + s(0) ** 2 + s1(0) ** 2))
    contact = rest + phase / rate
    time = np.arange(int((rest + length) * rate)) / rate
    theta = np.zeros_like(time)

    def landed(_, y):
        return y[0] - np.pi / 2

    def back(t, y):
        return y[0] if t > 0.02 else 1.0

    landed.terminal = back.terminal = True
    start, y0, stop_value = 0.0, [0.0, omega], None
    pieces = (
        [(start, length)] if speed_change is None else [(0.0, speed_change[0]), (speed_change[0], length)]
    )
    for begin, end in pieces:
        if begin:
            y0[1] *= speed_change[1]
        out = solve_ivp(
            rate_of, (begin, end), y0, rtol=1e-10, atol=1e-12, dense_output=True, events=[landed, back]
        )
        inside = (time - contact >= begin) & (time - contact <= out.t[-1])
        theta[inside] = out.sol(time[inside] - contact)[0]
        y0 = list(out.y[:, -1])
        stop_value = (out.t[-1], out.y[0, -1], out.status)
    if stop_value[2] == 1:
        theta[time - contact > stop_value[0]] = stop_value[1]
    return Tip(time, theta, phi, k, contact)


def camera():
    T = np.eye(4)
    T[:3, :3] = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # x right, y down = -z, z forward = +y
    T[:3, 3] = [0.03, -0.55, 0.08]
    return CameraModel(
        656,
        492,
        np.array([[1430.0, 0, 327.5], [0, 1430.0, 245.5], [0, 0, 1]]),
        np.array([-0.12, 0.05, 3e-4, -2e-4, 0.0]),
        T,
    )


def marker(marker_id=3, x=0.0, z=0.03, spin=0.0):
    """Marker on the face y = -D/2 of a box centred on O, which faces the camera; `spin` [rad] turns it."""
    T = np.eye(4)
    T[:3, :3] = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    c, s = np.cos(spin), np.sin(spin)
    T[:3, :3] = T[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    T[:3, 3] = [x, -D / 2, z]
    return Marker(marker_id, SIZE, T)


def planned(rho=0.002, phi=0.28, rolls=False):
    return PlannedStrike(
        id="s1",
        plane_id="bottom",
        axis_id="bottom/right",
        R_world_object=np.eye(3).tolist(),
        p_world_object=[-(W / 2 - rho), 0.0, H / 2],
        pivot=Pivot(
            point=[W / 2 - rho, 0.0, -(H / 2 - rho)], direction=[0.0, 1.0, 0.0], radius_m=rho, sd_m=0.0
        ),
        impact=Impact(point=[-W / 2, 0.0, 0.04], direction=[1.0, 0.0, 0.0]),
        impact_height_m=0.14,
        impulse_n_s=Range(min=0.01, target=0.02, max=0.03),
        tip_speed_m_s=Range(min=0.1, target=0.5, max=1.0),
        energy_ratio=1.05,
        phi_predicted_rad=phi,
        phi_predicted_sd_rad=0.05,
        i_edge_predicted_kg_m2=7e-4,
        visible_markers=[3],
        camera_pose=camera().T_world_camera.tolist(),
        friction_needed=0.2,
        rolls=rolls,
    )


def marker_poses(tip, mark=None, rho=0.002, yaw=0.0, offset=(0.0, 0.0), slip=None, lift=None, twist=None):
    """Rotation (n, 3, 3) and position (n, 3) [m] of the marker in the camera frame, in each frame.

    The object stands turned by `yaw` [rad] and shifted by `offset` [m] against the plan.
    """
    mark = mark or marker()
    plan = planned(rho)
    R_cw, t_cw = world_to_camera(camera())
    pivot = np.array([0.0, 0.0, rho])
    p0 = np.array(plan.p_world_object)

    def about(axis, angle):
        axis = np.asarray(axis, float)
        K = np.cross(np.eye(3), axis)
        return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K

    place = about([0, 0, 1.0], yaw)
    Rs, ps = [], []
    for i, theta in enumerate(tip.theta):
        R = place @ about([0, 1.0, 0], theta)
        move = np.array([rho * theta, 0.0, 0.0])
        if slip is not None:
            move[0] += slip[i]
        if lift is not None:
            move[2] += lift[i]
        if twist is not None:
            R = about([0, 0, 1.0], twist[i]) @ R
        p = R @ (p0 - pivot) + place @ (pivot + move) + np.array([*offset, 0.0])
        T = mark.T_object_marker
        Rs.append(R_cw @ R @ T[:3, :3])
        ps.append(R_cw @ (R @ T[:3, 3] + p) + t_cw)
    return np.array(Rs), np.array(ps)


def track_of(tip, rng, sd=0.011, mark=None, **how):
    """Marker track of a simulated tip with corner noise of 1 sigma `sd` [px]; its poses are the true ones."""
    mark = mark or marker()
    cam = camera()
    R, p = marker_poses(tip, mark, **how)
    h = SIZE / 2
    corners = np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])
    ideal = project_ideal(cam, np.einsum("nij,kj->nki", R, corners) + p[:, None])
    seen = distort(cam, ideal + rng.normal(0, sd, ideal.shape))
    n = len(tip.time)
    return MarkerTrack(
        mark.id, np.rint(tip.time * 1e9).astype(np.int64) + 10**18, seen, np.full(n, sd), R, p, n
    )


def free_part(energy, noise_deg, rng, past_deg=25.0, com=(0.03, 0.1)):
    """Simulated tip, and a noisy TipAngle of its part in which only gravity acts."""
    tip = simulate(energy, com=com)
    used = (tip.time > tip.contact + 0.016) & (tip.theta < tip.phi + np.radians(past_deg))
    first = int(np.argmax(used))
    stop = first + int(np.argmin(used[first:])) if not np.all(used[first:]) else len(used)
    if energy < 1:
        top = first + int(np.argmax(tip.theta[first:]))
        stop = top + int(np.argmax(tip.theta[top:] < 0.015))
    sd = np.radians(noise_deg)
    theta = tip.theta[first:stop] + rng.normal(0, sd, stop - first)
    n = len(theta)
    time_ns = np.rint(tip.time[first:stop] * 1e9).astype(np.int64)
    return tip, TipAngle(time_ns, theta, np.full(n, sd), np.zeros(n), np.zeros(n))
