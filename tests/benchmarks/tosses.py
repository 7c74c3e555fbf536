"""Tips and tosses of the virtual rig's objects: the whole tensor beside the truth.

    make bench-tosses                          # 5 objects x 20 seeds, twice (an hour)
    python -m tests.benchmarks.tosses --seeds 2 --bad 1

Tosses go through images: rendered, tracked, found, judged, fitted. Tips are drawn: phi and k of the planned
strikes with errors of each strike, and of each axis (face, air, play of the edge). With errors drawn, the
object file's tags lie where a person glued them, and camera, tag size, table, mass and the edges' radii are
as far off as calibrations are; as calibrated, the radius is known to 0.02 mm and the table's tilt to
0.1 mrad.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import click
import cv2
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.transform import Rotation

from acquire.virtual.objects import OBJECT_NAMES, VirtualObject, load_object
from acquire.virtual.toss import TossKind
from analyze.flight.toss import TossMotion, analyse_toss
from analyze.flight.views import tag_set
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.second_moments import log_cholesky, scale_free, symmetric_entries
from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.tosses import RESCAN_FRAMES, answer_of_flights, thrown_body
from analyze.planning.impact import StrikerModel
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.track import MarkerFollower
from schemas.object_spec import ObjectSpec, object_sha256
from schemas.session_manifest import CameraCalibrationSpec
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.toss_result import TossVerdict
from tests.analyze.planning.planned import make_plan
from tests.analyze.simulated_session import manifest, motion
from tests.tossed import TossedObject, planned_tosses, toss

PHI_SD, K_SD = 4e-4, 2e-3
"""errors of phi [rad] and k (relative) of one strike"""
AXIS_PHI_SD, AXIS_K_SD = 2e-4, 2e-3
"""errors of phi [rad] and k (relative) that all strikes over one edge share"""
RADIUS_SD, KNOWN_RADIUS_SD, OWN_RADIUS = 2e-4, 2e-5, 0.3
"""errors of the stated radius of all edges [m], drawn and as calibrated; of each edge, over that of all"""
PLACE_SD, TURN_SD = 3e-4, np.radians(0.3)
"""errors of a glued tag's place [m] and turn [rad]"""
CAMERA_SD, CAMERA_TURN_SD, FOCAL_SD, PRINT_SD = 5e-4, np.radians(0.1), 5e-4, 1e-3
"""errors of the camera's place [m] and turn [rad], of its focal length and of printed sizes (relative)"""
TILT_SD, KNOWN_TILT_SD = 1e-3, 1e-4
"""tilt of the table [rad], drawn and as calibrated"""
TOSSES = 3
"""tosses of a session"""


@dataclass(frozen=True)
class Score:
    """One session: errors of the tensor's entries and of c, with their standard deviations."""

    name: str
    seed: int
    drawn: bool
    good: int
    """tosses judged good"""
    used: bool
    """True if the tosses are part of the answer"""
    tensor: np.ndarray
    """(6,) errors of the entries, over the largest moment"""
    z: np.ndarray
    """(6,) errors over their standard deviations"""
    com: np.ndarray
    """(3,) error of c [m]"""
    com_z: np.ndarray
    """(3,) the same over its standard deviation"""
    flight: np.ndarray | None
    """(8,) errors of c and the tensor's shape by tosses alone, over their standard deviations"""
    flight_com: float
    """error of c by tosses alone [m]"""
    alone: float
    """largest error of the tensor without tosses, over the largest moment"""


@cache
def prepared(name: str) -> tuple[ObjectModel, StrikePlan]:
    """Shape and plan of an object; both are the same for all seeds."""
    thing = load_object(name, 0)
    shape = thing.shape_file or ("", None)
    model = load_object_model(thing.spec, shape[1], shape[0])
    sha = object_sha256(thing.spec, shape[1])
    return model, make_plan(model, thing.spec, sha, StrikerModel(fastest_m_s=5.0), strikes=9)


def stated(thing: VirtualObject, rng: np.random.Generator | None) -> ObjectSpec:
    """Object file: as the object is, or with tags as far off as a person glues them, and mass and print."""
    spec, markers = thing.spec, []
    print_error = 1.0 if rng is None else 1.0 + rng.normal(0, PRINT_SD)
    for marker in spec.marker:
        update: dict[str, object] = {"place_sd_m": 2e-5, "turn_sd_rad": 5e-4}
        if rng is not None and marker.T_object_marker is not None:
            pose = np.array(marker.T_object_marker)
            pose[:3, 3] += rng.normal(0, PLACE_SD, 3)
            pose[:3, :3] = Rotation.from_rotvec(rng.normal(0, TURN_SD, 3)).as_matrix() @ pose[:3, :3]
            update = {"T_object_marker": pose.tolist(), "place_sd_m": PLACE_SD, "turn_sd_rad": TURN_SD}
            update["size_m"] = marker.size_m * print_error
        markers.append(marker.model_copy(update=update))
    entries: dict[str, object] = {"marker": markers, "edge_radius_sd_m": KNOWN_RADIUS_SD}
    if rng is not None:
        weighed = spec.mass_kg + rng.normal(0, spec.mass_sd_kg)
        entries |= {"mass_kg": weighed, "edge_radius_sd_m": RADIUS_SD}
    return spec.model_copy(update=entries)


def calibrated(thrown: TossedObject, rng: np.random.Generator | None) -> CameraCalibrationSpec:
    """Camera as it is, or as far off as a calibration leaves it."""
    camera = thrown.camera
    K, T = camera.K.copy(), camera.T_world_camera.copy()
    if rng is not None:
        K[:2, :2] *= 1 + rng.normal(0, FOCAL_SD)
        T[:3, 3] += rng.normal(0, CAMERA_SD, 3)
        T[:3, :3] = Rotation.from_rotvec(rng.normal(0, CAMERA_TURN_SD, 3)).as_matrix() @ T[:3, :3]
    return CameraCalibrationSpec(
        width=camera.width,
        height=camera.height,
        K=K.tolist(),
        distortion=camera.distortion.tolist(),
        T_world_camera=T.tolist(),
    )


def tip_of(
    thing: VirtualObject, model: ObjectModel, strike: PlannedStrike, wider: float
) -> tuple[float, float]:
    """True phi [rad] and k [rad/s^2] about a planned strike's edge, `wider` [m] in radius than stated."""
    R, radius = np.array(strike.R_world_object), strike.pivot.radius_m + wider
    ends = (model.vertices - np.array(strike.pivot.point)) @ R.T
    height = ends[:, 2] - ends[:, 2].min()
    corner = ends[height < 1e-4, 0].max()
    # The wall at the edge ends at the next ring of vertices.
    ring = (height > 3e-3) & (height < height[height > 3e-3].min() + 1e-3)
    lean = float(np.arctan2(ends[ring, 0] - corner, height[ring]).max())
    # The centre of a rounding that touches table and wall, which leans outwards: up and back from the corner.
    back = (1 - np.sin(lean)) / np.cos(lean)
    arm = R @ (np.array(thing.body.com_object) - np.array(strike.pivot.point))
    arm -= wider * np.array([-back, 0.0, 1.0])
    arm[1] = 0.0
    distance, line = float(np.linalg.norm(arm)), np.array(strike.pivot.direction)
    mass = thing.body.mass_kg
    moment = line @ np.array(thing.body.inertia_com) @ line + mass * (distance + radius) ** 2
    return float(np.arctan2(-arm[0], arm[2])), mass * 9.81 * distance / moment


def session(name: str, seed: int, drawn: bool) -> tuple[Evidence, VirtualObject]:
    """Evidence of nine drawn tips and three tosses through images."""
    cv2.setNumThreads(1)
    thing = load_object(name, seed)
    model, plan = prepared(name)
    rng = np.random.default_rng((seed, 0x7055E5, drawn))
    errors = rng if drawn else None
    spec = stated(thing, errors)
    tilt_sd = TILT_SD if drawn else KNOWN_TILT_SD
    tilt = rng.normal(0, tilt_sd, 2)
    wider = rng.normal(0, RADIUS_SD if drawn else KNOWN_RADIUS_SD)
    motions, axes = [], {}
    for strike in plan.strikes:
        if strike.axis_id not in axes:
            axes[strike.axis_id] = rng.normal(0, (AXIS_PHI_SD, AXIS_K_SD, OWN_RADIUS * abs(wider)))
        shared = axes[strike.axis_id]
        phi, k = tip_of(thing, model, strike, wider + shared[2])
        phi += tilt[0] + shared[0] + rng.normal(0, PHI_SD)
        k *= 1 + shared[1] + rng.normal(0, K_SD)
        motions.append(motion(strike, phi, k, PHI_SD, K_SD * k, rng))
    sheet = None
    tosses: list[TossMotion] = []
    for planned in planned_tosses(thing, TOSSES):
        # Gravity leans towards +x by as much as a table tilted about y.
        thrown = toss(thing, planned, seed, table_tilt=(0.0, -float(tilt[0])))
        if sheet is None:
            sheet = manifest(spec).model_copy(update={"gravity_tilt_sd_rad": tilt_sd})
            cameras = [sheet.cameras[0].model_copy(update={"calibration": calibrated(thrown, errors)})]
            sheet = sheet.model_copy(update={"cameras": cameras})
        tosses.append(read(thrown, spec, model, sheet, seed))
    assert sheet is not None
    ids = tuple(each.strike_id for each in motions)
    head = RecordingHead(Path("r.mcap"), sheet, "c" * 64, ids, files=("r.mcap",))
    sha = object_sha256(spec, None if thing.shape_file is None else thing.shape_file[1])
    return Evidence((head,), spec, model, plan, sha, tuple(motions), tosses=tuple(tosses)), thing


def read(thrown: TossedObject, spec: ObjectSpec, model: ObjectModel, sheet, seed: int) -> TossMotion:
    """Track, find, fit and judge one toss."""
    camera, markers = camera_from_spec(sheet.cameras[0].calibration), placed_markers(spec)
    follower = MarkerFollower(camera, markers, rescan_every=RESCAN_FRAMES, rigid=True)
    for frame in thrown.frames(noise_seed=seed):
        follower.add(frame)
    ids = thrown.planned.id, thrown.planned.id
    body, prior = thrown_body(spec, model, sheet)
    return analyse_toss(ids, follower.report().tracks, camera, tag_set(markers), body, prior)


def score(case: tuple[str, int, bool]) -> Score:
    """Estimate one session, and compare with the truth."""
    name, seed, drawn = case
    evidence, thing = session(name, seed, drawn)
    true, com = np.array(thing.body.inertia_com), np.array(thing.body.com_object)
    largest = float(np.linalg.eigvalsh(true).max())
    estimate = estimate_evidence(evidence)
    without = estimate_evidence(replace(evidence, tosses=()))
    found, sd = estimate.inertial, np.sqrt(np.diag(estimate.inertial.covariance))[4:]
    flight = answer_of_flights(evidence, placed_markers(evidence.spec), frozenset())
    numbers, off = np.append(com, scale_free(log_cholesky(true / thing.body.mass_kg))[0]), None
    if flight is not None:
        off = (flight.estimate.mean - numbers) / np.sqrt(np.diag(flight.estimate.covariance))
    error = symmetric_entries(found.inertia - true)
    return Score(
        name,
        seed,
        drawn,
        sum(each.verdict is TossVerdict.GOOD for each in evidence.tosses),
        flight is not None and estimate.flight is not None and estimate.flight.agrees,
        error / largest,
        error / sd,
        found.com.position - com,
        (found.com.position - com) / np.sqrt(np.diag(found.com.covariance)),
        off,
        np.nan if flight is None else float(np.linalg.norm(flight.estimate.mean[:3] - com)),
        float(np.abs(symmetric_entries(without.inertial.inertia - true)).max()) / largest,
    )


def bad_toss(case: tuple[str, int, TossKind]) -> tuple[TossKind, str, float]:
    """Verdict on a bad toss, and the largest error over its sd of what it alone would give if not refused."""
    name, seed, kind = case
    cv2.setNumThreads(1)
    thing = load_object(name, seed)
    model, _ = prepared(name)
    spec, planned = stated(thing, None), planned_tosses(thing, TOSSES)[seed % TOSSES]
    thrown = toss(thing, planned, seed, kind)
    sheet = manifest(spec)
    cameras = [sheet.cameras[0].model_copy(update={"calibration": calibrated(thrown, None)})]
    sheet = sheet.model_copy(update={"cameras": cameras})
    found = read(thrown, spec, model, sheet, seed)
    if found.verdict is not TossVerdict.GOOD:
        return kind, found.verdict.value, 0.0
    head = RecordingHead(Path("r.mcap"), sheet, "c" * 64, (), files=("r.mcap",))
    evidence = Evidence((head,), spec, model, prepared(name)[1], "", (), tosses=(found,))
    flight = answer_of_flights(evidence, placed_markers(spec), frozenset())
    assert flight is not None
    true = np.array(thing.body.inertia_com) / thing.body.mass_kg
    numbers = np.append(np.array(thing.body.com_object), scale_free(log_cholesky(true))[0])
    off = (flight.estimate.mean - numbers) / np.sqrt(np.diag(flight.estimate.covariance))
    return kind, found.verdict.value, float(np.abs(off).max())


def rows(scores: list[Score]) -> Iterator[list[str]]:
    """Rows of the table, per object and for all."""
    for name in (*dict.fromkeys(each.name for each in scores), "all"):
        some = [each for each in scores if name in (each.name, "all")]
        tensor = np.abs([each.tensor for each in some])
        worst, z = tensor.max(axis=1), np.array([each.z for each in some])
        com = np.linalg.norm([each.com for each in some], axis=1)
        com_z = np.array([each.com_z for each in some])
        flown = [each for each in some if each.flight is not None]
        flight = np.array([each.flight for each in flown])
        yield [
            name,
            f"{len(some)}",
            f"{np.mean([each.good for each in some]):.2f}",
            f"{sum(each.used for each in some)}",
            f"{100 * np.median([each.alone for each in some]):.2f}",
            f"{100 * np.median(worst):.2f} / {100 * np.quantile(worst, 0.95):.2f}",
            f"{100 * np.mean(worst <= 0.02):.0f}",
            f"{100 * np.median(tensor[:, 3:]):.3f}",
            " ".join(f"{each:.2f}" for each in np.sqrt(np.mean(z**2, axis=0))),
            f"{100 * np.mean(np.abs(z) < 1.96):.0f}",
            f"{1e3 * np.median(com):.3f} / {1e3 * com.max():.3f}",
            f"{np.sqrt(np.mean(com_z**2)):.2f}",
            f"{1e3 * np.median([each.flight_com for each in flown]):.3f}" if flown else "",
            f"{np.sqrt(np.mean(flight**2)):.2f}" if flown else "",
            f"{100 * np.mean(np.abs(flight) < 1.96):.0f}" if flown else "",
        ]


COLUMNS = (
    ("object", "left"),
    ("sessions", "right"),
    ("good tosses", "right"),
    ("used", "right"),
    ("tensor without tosses [%]", "right"),
    ("with, median / 95 % [%]", "right"),
    ("within 2 % [%]", "right"),
    ("products [%]", "right"),
    ("rms z of xx yy zz xy xz yz", "right"),
    ("intervals hold [%]", "right"),
    ("c, median / largest [mm]", "right"),
    ("rms z of c", "right"),
    ("c by tosses [mm]", "right"),
    ("rms z of tosses", "right"),
    ("their intervals hold [%]", "right"),
)


@click.command()
@click.option("--seeds", default=20, help="seeds of each object")
@click.option("--objects", default=",".join(OBJECT_NAMES), help="names, separated by commas")
@click.option("--bad", default=8, help="bad tosses of each kind and object")
@click.option("--workers", default=2)
def main(seeds: int, objects: str, bad: int, workers: int) -> None:
    """Print the tables."""
    names, console = objects.split(","), Console(width=240)
    with ProcessPoolExecutor(workers) as pool:
        for drawn in (False, True):
            cases = list(product(names, range(1, seeds + 1), (drawn,)))
            title = "calibrations with errors" if drawn else "as calibrated"
            found = list(track(pool.map(score, cases), title, len(cases), console=Console(stderr=True)))
            table = Table(title=f"nine tips and three tosses, {title}; tensor over its largest moment")
            for column, justify in COLUMNS:
                table.add_column(column, justify=justify)
            for row in rows(found):
                table.add_row(*row)
            console.print(table)
        kinds = [kind for kind in TossKind if kind is not TossKind.GOOD]
        trials = list(product(names, range(1, bad + 1), kinds))
        tossed = list(
            track(pool.map(bad_toss, trials), "bad tosses", len(trials), console=Console(stderr=True))
        )
    for kind in kinds:
        mine = [each for each in tossed if each[0] is kind]
        verdicts = {name: sum(each[1] == name for each in mine) for name in {each[1] for each in mine}}
        wrong = sum(each[2] > 4.0 for each in mine)
        sys.stdout.write(f"{kind.value}: {verdicts}; called good with a value more than 4 sd off: {wrong}\n")


if __name__ == "__main__":
    main()
