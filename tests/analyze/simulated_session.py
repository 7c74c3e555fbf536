"""Session on a virtual box without images: motions of a Runge-Kutta pendulum with frame noise.

It is independent of the estimators.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analyze.geometry.object_model import load_object_model
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.types import MotionFit, Phases, TipAngle, TipMotion
from schemas.object_spec import Box, MarkerSpec, ObjectSpec, Shape, object_sha256
from schemas.session_manifest import CameraCalibrationSpec, ManifestCamera, SessionManifest, TimeSource
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import Verdict
from tests.analyze.estimation.bodies import GRAVITY, SIX_AXES, Body, box_body, planned_strike, tip

FRAME_S = 1 / 120


def session(
    body: Body,
    rng: np.random.Generator,
    repeats: int = 2,
    sd: tuple[float, float] = (4e-4, 2e-3),
    tilt: float = 0.0,
    slow: float = 1.0,
    time_source: TimeSource = TimeSource.DEVICE_MAPPED,
    axes: tuple[tuple[int, int, int, int], ...] = SIX_AXES,
) -> Evidence:
    """Evidence from strikes on `axes` of `body`, with drawn errors.

    phi [rad] and k (relative) have errors of 1 sigma `sd`; `tilt` [rad] of the table is added to all phi;
    times are stretched by `slow`.
    """
    sd_phi, sd_k = sd
    spec = object_spec(body)
    strikes = [planned_strike(body, *axis, repeat) for axis in axes for repeat in range(repeats)]
    motions = []
    for strike in strikes:
        phi, k = tip(body, strike)
        k /= slow**2
        motions.append(
            motion(
                strike,
                phi + tilt + rng.normal(0, sd_phi),
                k * (1 + rng.normal(0, sd_k)),
                sd_phi,
                sd_k * k,
                rng,
            )
        )
    plan = StrikePlan(object_name=spec.name, object_sha256=object_sha256(spec, None), strikes=strikes)
    model = load_object_model(spec, None, spec.name)
    head = RecordingHead(
        Path("r.mcap"),
        manifest(spec, time_source),
        "c" * 64,
        tuple(motion.strike_id for motion in motions),
        files=("r.mcap",),
    )
    return Evidence((head,), spec, model, plan, object_sha256(spec, None), tuple(motions))


def motion(
    strike: PlannedStrike, phi: float, k: float, sd_phi: float, sd_k: float, rng: np.random.Generator
) -> TipMotion:
    """Motion of one strike with rest, both stages and the landing, and 0.05 degrees of frame noise."""
    truth, omega = tipping(phi, k)
    passed = int(np.argmax(np.array(truth) > phi))
    landed = len(truth)
    truth += [truth[-1] + 0.01 * np.sin(i) for i in range(12)]
    noise = rng.normal(0, np.radians(0.05), len(truth))
    time_ns = (1_000_000_000 + np.arange(len(truth)) * FRAME_S * 1e9).astype(np.int64)
    n = len(truth)
    angle = TipAngle(time_ns, np.array(truth) + noise, np.full(n, np.radians(0.05)), np.zeros(n), np.zeros(n))
    phases = Phases((0, 30), (30, 33), (33, passed), (passed, landed), (landed, n))
    window = (33, landed)
    fit = MotionFit(
        "pivot_fit",
        phi,
        k,
        np.diag([sd_phi**2, sd_k**2]),
        0.0,
        omega,
        int(time_ns[30]),
        window,
        noise[33:landed],
    )
    rough = MotionFit(
        "sign_change",
        phi + rng.normal(0, 0.02),
        None,
        np.diag([0.02**2, 0.0]),
        0.0,
        0.0,
        0,
        window,
        np.zeros(0),
    )
    return TipMotion(f"{strike.id}.1", strike.id, Verdict.GOOD, "", angle, phases, fit, (rough,), 1.05)


def tipping(phi: float, k: float, energy: float = 1.05) -> tuple[list[float], float]:
    """Tipping angles [rad] at 120 frames per second, and the angular speed at their start [rad/s].

    The strike is just after frame 29; the angles end 0.6 rad past the balance.
    """
    omega = float(np.sqrt(2 * k * (1 - np.cos(phi)) * energy))
    truth, theta, rate = [0.0] * 30, 0.0, omega
    while theta < phi + 0.6 and len(truth) < 400:
        for _ in range(20):
            step = FRAME_S / 20
            middle = rate + step / 2 * -k * np.sin(phi - theta)
            theta, rate = theta + step * middle, rate - step * k * np.sin(phi - theta - step / 2 * rate)
        truth.append(theta)
    return truth, omega


def object_spec(body: Body) -> ObjectSpec:
    """Object file that a user would write for `body`."""
    return ObjectSpec(
        name="test box",
        mass_kg=body.mass,
        mass_sd_kg=1e-4,
        shape=Shape(box=Box(size_m=body.size.tolist()), surface_sd_m=0.0),
        edge_radius_m=body.edge_radius,
        edge_radius_sd_m=1e-4,
        shell_thickness_m=body.pitch,
        marker=[MarkerSpec(id=0, size_m=0.03)],
    )


def manifest(spec: ObjectSpec, time_source: TimeSource = TimeSource.DEVICE_MAPPED) -> SessionManifest:
    """Manifest of a recording by a rig with one camera and a table level to 0.05 degrees."""
    calibration = CameraCalibrationSpec(
        width=656,
        height=492,
        K=[[1430, 0, 328], [0, 1430, 246], [0, 0, 1]],
        T_world_camera=np.eye(4).tolist(),
    )
    return SessionManifest(
        recording_id="r1",
        created="2026-01-01T00:00:00Z",
        software="percuss 0.1.0",
        wall_anchor_ns=0,
        time_source=time_source,
        time_source_sd_ns=10_000,
        g_m_s2=GRAVITY,
        g_sd_m_s2=1e-3,
        gravity_tilt_sd_rad=1e-3,
        cameras=[ManifestCamera(name="main", frame_rate_hz=120, exposure_us=1500, calibration=calibration)],
        object=spec,
        object_sha256=object_sha256(spec, None),
        plan_sha256="p" * 64,
    )


def carton(edge_radius: float = 1e-3) -> Body:
    """Box of 80 x 60 x 150 mm and 44 g, with three regions and a slanted dividing plane."""
    return box_body((0.08, 0.06, 0.15), (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), edge_radius)
