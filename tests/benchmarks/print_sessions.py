"""Sessions for `make bench-print`: the same strikes analysed by tags and by print, against the truth."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.objects import VirtualObject, load_object, without_tags
from acquire.virtual.packaging import Packaging, PrintKind
from acquire.virtual.render import Renderer
from acquire.virtual.station import G_M_S2, HEIGHT_PX, WIDTH_PX, Station, station
from acquire.virtual.world import World
from analyze.errors import AnalyzeError, TrackingError
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.station import turned_camera
from analyze.motion.print_motion import analyse_images
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.sections import next_face_angle, rolling_outline, scanned_edge_sd, strike_supports
from analyze.types import CameraModel, ImageFrame, TipMotion
from schemas.object_spec import ObjectSpec, object_sha256
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import USABLE_VERDICTS
from tests.analyze.simulated_session import manifest
from tests.benchmarks.honesty.observed import T0
from tests.benchmarks.honesty.struck import StruckMotion
from tests.benchmarks.print_strikes import Filming, Placement, film, struck, true_theta
from tests.benchmarks.tosses import (
    CAMERA_SD,
    CAMERA_TURN_SD,
    FOCAL_SD,
    KNOWN_RADIUS_SD,
    KNOWN_TILT_SD,
    RADIUS_SD,
    TILT_SD,
    prepared,
    stated,
    tip_of,
)

YAW_SD, SHIFT_SD = math.radians(1.0), 2e-3
"""errors of the pose in which a hand puts the object down: turn about the vertical [rad], place [m]"""
STRAIN_SD = 1e-4
ROADS = ("tags", "print", "light", "blank")
"""ways to film and track an object: tags on blank faces, or no tags and print of a kind"""


@dataclass(frozen=True)
class StrikeRow:
    """Errors of one strike by one road."""

    name: str
    seed: int
    drawn: bool
    """True if the calibrations' errors are drawn"""
    road: str
    strike: str
    verdict: str
    """verdict, or "refused" """
    reason: str
    usable: bool
    frames: int = 0
    """frames between contact and landing"""
    seen: int = 0
    """those with a tipping angle"""
    rms: float = math.nan
    """rms error of theta there [rad]"""
    bias: float = math.nan
    """mean error of theta there [rad]"""
    z_theta: float = math.nan
    """rms of theta's errors over their standard deviations"""
    phi: float = math.nan
    """error of phi [rad]"""
    phi_z: float = math.nan
    k: float = math.nan
    """relative error of k"""
    k_z: float = math.nan
    seconds: float = 0.0
    """processor time of the tracker [s]"""


@dataclass(frozen=True)
class SessionRow:
    """Errors of one session's centre of mass and tensor by one road."""

    name: str
    seed: int
    drawn: bool
    road: str
    good: int
    struck: int
    com: tuple[float, ...] = ()
    """(3,) error of c [m]"""
    com_z: tuple[float, ...] = ()
    tensor: float = math.nan
    """largest error of the tensor over its largest moment"""
    tensor_z: tuple[float, ...] = ()
    refusal: str = ""


@dataclass(frozen=True)
class Scene:
    """Object, plan, cameras and object file of a session."""

    thing: VirtualObject
    """the true object, with tags"""
    model: ObjectModel
    plan: StrikePlan
    spec: ObjectSpec
    """the object file, with tags"""
    place: Station
    """the true camera"""
    camera: CameraModel
    """the camera as calibrated"""
    tilt: float
    """tilt of the table [rad]"""
    wider: float
    """true minus stated radius of the edges [m]"""
    drawn: bool


def scene(name: str, seed: int, drawn: bool, rng: np.random.Generator) -> Scene:
    """Session's scene, with the errors of its calibrations if they are drawn."""
    model, plan = prepared(name)
    thing, errors = load_object(name, seed), rng if drawn else None
    wider = float(rng.normal(0, RADIUS_SD if drawn else KNOWN_RADIUS_SD))
    thing = replace(thing, edge_radius_m=thing.edge_radius_m + wider)
    place = station(seed)
    K, T = place.K.copy(), place.T_world_camera.copy()
    if drawn:
        K[:2, :2] *= 1 + rng.normal(0, FOCAL_SD)
        T[:3, 3] += rng.normal(0, CAMERA_SD, 3)
        T[:3, :3] = Rotation.from_rotvec(rng.normal(0, CAMERA_TURN_SD, 3)).as_matrix() @ T[:3, :3]
    camera = CameraModel(WIDTH_PX, HEIGHT_PX, K, place.distortion, T, strain_sd=STRAIN_SD)
    tilt = float(rng.normal(0, TILT_SD if drawn else KNOWN_TILT_SD))
    return Scene(thing, model, plan, stated(thing, errors), place, camera, tilt, wider, drawn)


def renderer_of(on: Scene, road: str, seed: int, glossy: bool = False) -> Renderer:
    """Renderer of a road's pictures: tags on blank faces, or print without tags."""
    thing = on.thing
    if road != "tags":
        thing = replace(without_tags(thing), packaging=Packaging(PrintKind(road), seed, glossy))
    return Renderer(thing, on.place, seed)


def run_session(
    case: tuple[str, int, bool, tuple[str, ...], int],
) -> tuple[list[StrikeRow], list[SessionRow]]:
    """Strike, film and estimate one session by several roads.

    Args:
        case: name of the object, seed, whether errors are drawn, roads, and most strikes.
    """
    name, seed, drawn, roads, most = case
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, 0x9121117, drawn, *name.encode()))
    on = scene(name, seed, drawn, rng)
    world = World(on.thing, lambda *_: 0.0, table_tilt=(0.0, on.tilt), arm_angle=-2.5)
    planned = chosen(on.plan, most)
    motions: dict[str, list[TipMotion]] = {road: [] for road in roads}
    renderers = {road: renderer_of(on, road, seed) for road in roads}
    rows: list[StrikeRow] = []
    for each in planned:
        placed = Placement(*rng.normal(0, (YAW_SD, SHIFT_SD, SHIFT_SD)))
        push = float(rng.uniform(1.05, 1.3)), float(rng.uniform(0.002, 0.004))
        motion = struck(world, on.thing, each, placed, push)
        phase = int(rng.integers(1 << 30))
        for road in roads:
            frames = film(renderers[road], motion, each.heading_rad, Filming(), np.random.default_rng(phase))
            row, found = analyse(on, road, each, motion, frames)
            rows.append(replace(row, name=name, seed=seed))
            if found is not None:
                motions[road].append(found)
    sessions = [_session_row(on, road, motions[road], len(planned), (name, seed)) for road in roads]
    return rows, sessions


def chosen(plan: StrikePlan, most: int) -> list[PlannedStrike]:
    """The first strikes of a plan, one of each axis before a second one."""
    times: dict[str, int] = {}
    order: list[tuple[int, int]] = []
    for number, strike in enumerate(plan.strikes):
        times[strike.axis_id] = times.get(strike.axis_id, -1) + 1
        order.append((times[strike.axis_id], number))
    return [plan.strikes[number] for _, number in sorted(order)[:most]]


def analyse(
    on: Scene,
    road: str,
    planned: PlannedStrike,
    motion: StruckMotion,
    frames: list[ImageFrame],
    contact_known: bool = True,
) -> tuple[StrikeRow, TipMotion | None]:
    """Analyse a filmed strike by tags or print; row of its errors, and the motion unless refused."""
    camera = turned_camera(on.camera, planned.heading_rad)
    task = StrikeTask(
        f"{planned.id}.1",
        planned,
        T0 if contact_known else 0,
        None,
        rolling_outline(on.model, planned),
        next_face_angle(on.model, planned),
        supports=strike_supports(on.model, planned),
        plan_strikes=tuple(on.plan.strikes),
        edge_sd=scanned_edge_sd(on.spec, on.model, planned),
    )
    begun = time.process_time()
    empty = StrikeRow("", 0, on.drawn, road, planned.id, "refused", "", False)
    try:
        markers = placed_markers(on.spec) if road == "tags" else []
        found, _ = analyse_images(frames, camera, markers, (on.model.vertices, on.model.faces), task)
    except TrackingError as error:
        return replace(empty, reason=str(error), seconds=time.process_time() - begun), None
    row = replace(
        empty,
        verdict=found.verdict.value,
        reason=found.reason,
        usable=found.verdict in USABLE_VERDICTS and found.fit is not None,
        seconds=time.process_time() - begun,
    )
    return _with_errors(row, on, planned, motion, found, frames), found


def _with_errors(
    row: StrikeRow,
    on: Scene,
    planned: PlannedStrike,
    motion: StruckMotion,
    found: TipMotion,
    frames: list[ImageFrame],
) -> StrikeRow:
    true = true_theta(motion, np.array(planned.pivot.direction))
    landing = next_face_angle(on.model, planned) or math.inf
    ended = np.flatnonzero((true > landing) | ((motion.time > 0.1) & (true < math.radians(0.3))))
    end = motion.time[ended[0]] if len(ended) else motion.time[int(np.argmax(true))]
    filmed = np.array([1e-9 * (frame.time_ns - T0) for frame in frames])
    row = replace(row, frames=int(np.sum((filmed > 0) & (filmed < end))))
    if found.angle is not None:
        at = 1e-9 * (found.angle.time_ns - T0)
        used = (at > 0) & (at < end)
        error = found.angle.theta[used] - np.interp(at[used], motion.time, true)
        if used.any():
            sd = np.hypot(found.angle.sd[used], math.hypot(found.angle.zero_sd, found.angle.slow_sd))
            row = replace(
                row,
                seen=int(used.sum()),
                rms=float(np.sqrt(np.mean(error**2))),
                bias=float(error.mean()),
                z_theta=float(np.sqrt(np.mean((error / sd) ** 2))),
            )
    if found.fit is not None:
        phi, k = tip_of(on.thing, on.model, planned, on.wider)
        off = found.fit.phi - phi - on.tilt
        row = replace(row, phi=off, phi_z=off / math.sqrt(found.fit.covariance[0, 0]))
        if found.fit.k is not None:
            change = found.fit.k - k
            row = replace(row, k=change / k, k_z=change / math.sqrt(found.fit.covariance[1, 1]))
    return row


def _session_row(
    on: Scene, road: str, motions: list[TipMotion], struck_count: int, case: tuple[str, int]
) -> SessionRow:
    good = sum(each.verdict in USABLE_VERDICTS and each.fit is not None for each in motions)
    empty = SessionRow(*case, on.drawn, road, good, struck_count)
    spec = on.spec if road == "tags" else on.spec.model_copy(update={"marker": []})
    shape = None if on.thing.shape_file is None else on.thing.shape_file[1]
    sha = object_sha256(spec, shape)
    tilt_sd = TILT_SD if on.drawn else KNOWN_TILT_SD
    sheet = manifest(spec).model_copy(
        update={"gravity_tilt_sd_rad": tilt_sd, "g_m_s2": G_M_S2, "object_sha256": sha}
    )
    ids = tuple(each.strike_id for each in motions)
    head = RecordingHead(Path("r.mcap"), sheet, "c" * 64, ids, files=("r.mcap",))
    try:
        estimate = estimate_evidence(Evidence((head,), spec, on.model, on.plan, sha, tuple(motions)))
    except AnalyzeError as error:
        return replace(empty, refusal=str(error))
    found, body = estimate.inertial, on.thing.body
    off = found.com.position - np.array(body.com_object)
    sd = np.sqrt(np.diag(found.com.covariance))
    true = np.array(body.inertia_com)
    change = (found.inertia - true)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    tensor_sd = np.sqrt(np.diag(found.covariance))[4:]
    return replace(
        empty,
        com=tuple(off.tolist()),
        com_z=tuple((off / sd).tolist()),
        tensor=float(np.abs(change).max() / np.linalg.eigvalsh(true).max()),
        tensor_z=tuple((change / tensor_sd).tolist()),
    )
