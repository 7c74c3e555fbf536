"""Sessions of five virtual objects that stand anywhere on a table: their plans, and videos of their strikes.

Plans are those of the planner, for a phone. The motion is that of a rigid body that rolls on a rounded edge;
nothing of it is shared with the estimators. The pictures show tags and the object's outline. Not modelled:
slip, bounce, parts of the object that hide a tag.
"""

from __future__ import annotations

import copy
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.rotations import inverse_transform, matrix_from_vector, transform
from analyze.geometry.station import turned_camera
from analyze.importing.tip_view import TipView, TurningLine
from analyze.planning.examine import Bench
from analyze.planning.impact import HAND
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.possible_tips import PossibleTips
from analyze.planning.prepared import prepare_object
from analyze.types import Array, CameraModel
from schemas.document import canonical_json
from schemas.object_spec import MarkerSpec, ObjectSpec, object_sha256, parse_object_spec
from schemas.strike_plan import PlannedStrike, StrikePlan
from tests import make_phone_videos as renderer
from tests.analyze.importing.tip_videos import write_video

GRAVITY, ENERGY, RADIUS_M = 9.81, 1.12, 1e-3
RATE_HZ, REST_S = 120, 0.3
OFF_LINE_M, SKEW_RAD, HAND_RAD = 0.05, math.radians(8.0), 0.02
"""largest distance of an object from the line, along and across it [m]; largest angle between the line and
the camera's direction of sight, and standard deviation of an object's heading against the line [rad]"""
GLUE_M, GLUE_RAD = 1e-4, 1e-3
"""standard deviations of a tag's place and turn, as registration leaves them"""
EYE, LOOK_AT = np.array([0.02, -0.44, 0.13]), np.array([0.02, 0.0, 0.06])
SHAPES = ("box", "cylinder", "frustum", "L", "wedge")
TAG_M = 0.036


@dataclass(frozen=True)
class Session:
    """Strikes of one object as planned, and as they were made: placements on the table."""

    text: str
    """content of the object file"""
    shape: bytes | None
    """content of the shape file; None for a primitive"""
    spec: ObjectSpec
    model: ObjectModel
    com: Array
    """(3,) true centre of mass in O [m]"""
    inertia: Array
    """(3, 3) true inertia about it [kg m^2]"""
    plan: StrikePlan
    """plan of the strikes, with the mean heading in which those over one edge were made"""
    placed: list[Array]
    """(4, 4) pose of the station's frame as each strike was made, in W [m]: heading and place on the table"""
    tags: list[renderer.Side]
    """tags as they are glued"""
    camera: CameraModel
    """phone, with its true pose in W"""


def camera() -> CameraModel:
    """Phone on its stand, tilted a little, that looks along the line."""
    forward = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
    right = np.cross(forward, [0.02, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R_camera_world = np.array([right, np.cross(forward, right), forward])
    distortion = np.array([renderer.K1, 0, 0, 0, 0])
    T = transform(R_camera_world.T, EYE)
    return CameraModel(renderer.WIDTH, renderer.HEIGHT, renderer.K, distortion, T)


def session(shape: str, seed: int, strikes: int = 6) -> Session:
    """Session of one of `SHAPES`; every object is planned, filled and placed otherwise."""
    random = np.random.default_rng([seed, len(shape)])
    text, data = object_file(shape)
    spec = parse_object_spec(text, f"{shape}.toml")
    model = load_object_model(spec, data, f"{shape}.stl")
    extent, mass = model.extent, spec.mass_kg
    com = model.centroid + random.uniform(-0.05, 0.05, 3) * extent
    solid = mass / 12 * (np.sum(extent**2) * np.eye(3) - np.diag(extent**2))
    lopsided = random.uniform(-0.03, 0.03, (3, 3)) * np.trace(solid) / 3
    inertia = 0.9 * solid + (lopsided + lopsided.T) / 2
    phone = camera()
    prepared = prepare_object(model, spec, Bench(HAND, phone, 0.6))
    plan = plan_strikes(prepared, object_sha256(spec, data), PlanRequest(strikes))
    skew = random.uniform(-SKEW_RAD, SKEW_RAD)
    turned = [random.random() < 0.4 and bool(_seen_turned(strike, spec)) for strike in plan.strikes]
    off = random.normal(0, HAND_RAD, len(turned))
    alike = [(strike.axis_id, back) for strike, back in zip(plan.strikes, turned, strict=True)]
    mean = [skew + float(np.mean(off[[each == other for other in alike]])) for each in alike]
    made = [
        _made(strike, spec, phone, heading, back)
        for strike, heading, back in zip(plan.strikes, mean, turned, strict=True)
    ]
    placed = [
        transform(
            matrix_from_vector(np.array([0.0, 0.0, skew + by_hand + math.pi * back])),
            np.array([*random.uniform(-OFF_LINE_M, OFF_LINE_M, 2), 0.0]),
        )
        for by_hand, back in zip(off, turned, strict=True)
    ]
    tags = [_glued(marker, random) for marker in spec.marker]
    plan = plan.model_copy(update={"strikes": made})
    return Session(text, data, spec, model, com, inertia, plan, placed, tags, phone)


def _made(
    strike: PlannedStrike, spec: ObjectSpec, phone: CameraModel, heading: float, turned: bool
) -> PlannedStrike:
    """Strike as it was made: with a heading, and turned by 180 degrees more or not."""
    if turned:
        strike = strike.model_copy(update={"visible_markers": _seen_turned(strike, spec)})
        heading += math.pi
    pose = turned_camera(phone, heading).T_world_camera.tolist()
    return strike.model_copy(update={"heading_rad": heading, "camera_pose": pose})


def _seen_turned(strike: PlannedStrike, spec: ObjectSpec) -> list[int | str]:
    """Names of the tags that face the camera if the object is turned by 180 degrees."""
    along = np.array(strike.pivot.direction)
    return [
        marker.name
        for marker in spec.marker
        if marker.T_object_marker is not None
        and float(np.array(marker.T_object_marker)[:3, 2] @ along) > math.cos(math.radians(12))
    ]


# --- objects


def object_file(shape: str) -> tuple[str, bytes | None]:
    """Object file and shape file of one of `SHAPES`, with a tag on every side."""
    data, form, tags = None, f'file = "{shape}.stl"\nunit = "m"', list[tuple[Array, Array]]()
    if shape == "box":
        size = np.array([0.075, 0.065, 0.12])
        form = f"box = {{ size_m = {size.tolist()} }}"
        tags = [(size / 2 * out, out) for axis in np.eye(3) for out in (axis, -axis)]
    elif shape == "cylinder":
        form = "cylinder = { radius_m = 0.04, height_m = 0.1 }"
        tags = [(0.04 * out, out) for out in _around(4)]
    elif shape == "frustum":
        data = _mesh([(0.045, -0.06), (0.03, 0.06)])
        lean = math.atan2(0.015, 0.12)
        tags = [(0.0375 * out, math.cos(lean) * out + [0, 0, math.sin(lean)]) for out in _around(4)]
    elif shape == "L":
        data = _l_mesh()
        y, x, z = np.eye(3)[1], np.eye(3)[0], np.eye(3)[2]
        tags = [
            (np.array([-0.03, 0.03, -0.02]), y),
            (np.array([-0.03, -0.03, -0.02]), -y),
            (np.array([-0.05, 0.0, 0.0]), -x),
            (np.array([0.05, 0.0, -0.04]), x),
            (np.array([0.0, 0.0, -0.06]), -z),
            (np.array([-0.03, 0.0, 0.06]), z),
        ]
    else:
        points = np.array([[x, y, 0.0] for x in (-0.045, 0.045) for y in (-0.035, 0.035)])
        top = np.array([[x, y, 0.11] for x in (-0.025, 0.045) for y in (-0.03, 0.03)])
        hull = trimesh.convex.convex_hull(np.concatenate([points, top]) - [0, 0, 0.055])
        data = _stl(hull)
        tags = _on_faces(hull)
    lines = [f'name = "{shape}"', "mass_kg = 0.18", "mass_sd_kg = 0.0001", f"edge_radius_m = {RADIUS_M}"]
    lines += ["edge_radius_sd_m = 0.0001", "", "[shape]", form]
    for number, (middle, out) in enumerate(tags):
        lines += ["", "[[marker]]", f"id = {number}", f"size_m = {TAG_M}"]
        lines += [
            f"T_object_marker = {_facing(middle, out).tolist()}",
            "place_sd_m = 0.0001",
            "turn_sd_rad = 0.001",
        ]
    return "\n".join(lines) + "\n", data


def _around(many: int) -> list[Array]:
    """Horizontal unit vectors in equal steps."""
    angles = 2 * np.pi * np.arange(many) / many
    return [np.array([math.cos(each), math.sin(each), 0.0]) for each in angles]


def _facing(middle: Array, out: Array) -> Array:
    """Pose (4, 4) of a tag whose middle and outward normal are given."""
    up = np.array([0.0, 0.0, 1.0]) if abs(out[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, out)
    right /= np.linalg.norm(right)
    return transform(np.stack([right, np.cross(out, right), out], axis=-1), middle)


def _on_faces(hull: trimesh.Trimesh) -> list[tuple[Array, Array]]:
    """Middle and normal of each flat face of a convex mesh."""
    found = []
    for facet, normal in zip(hull.facets, hull.facets_normal, strict=True):
        areas = hull.area_faces[facet]
        found.append((areas @ hull.triangles_center[facet] / areas.sum(), np.asarray(normal)))
    return found


def _stl(mesh: trimesh.Trimesh) -> bytes:
    """Mesh as a binary STL file."""
    buffer = io.BytesIO()
    mesh.export(buffer, file_type="stl")
    return buffer.getvalue()


def _mesh(rings: list[tuple[float, float]]) -> bytes:
    """Convex body of revolution about z, by radius and height of its rings [m]."""
    angles = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    points = [[r * math.cos(a), r * math.sin(a), z] for r, z in rings for a in angles]
    return _stl(trimesh.convex.convex_hull(np.array(points)))


def _l_mesh() -> bytes:
    """L of two bars, 60 mm thick: 100 mm long below, 120 mm tall at -x."""
    low = trimesh.creation.box(bounds=[[-0.05, -0.03, -0.06], [0.05, 0.03, -0.02]])
    high = trimesh.creation.box(bounds=[[-0.05, -0.03, -0.02], [-0.01, 0.03, 0.06]])
    return _stl(trimesh.boolean.union([low, high], engine="manifold"))


def _glued(marker: MarkerSpec, random: np.random.Generator) -> renderer.Side:
    """Tag on its white card, a little off the place that the object file states."""
    T = np.array(marker.T_object_marker) @ transform(
        matrix_from_vector(np.array([0.0, 0.0, random.normal(0, GLUE_RAD)])),
        np.array([*random.normal(0, GLUE_M, 2), 0.0]),
    )
    cells = 160
    rim = round(0.15 * cells)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    tag = cv2.aruco.generateImageMarker(dictionary, int(marker.id), cells)
    card = np.pad(np.where(tag > 127, 225, 25).astype(np.uint8), rim, constant_values=225)
    reach = marker.size_m / 2 * len(card) / cells
    right, up = reach * T[:3, 0], reach * T[:3, 1]
    return np.array(
        [T[:3, 3] - right + up, T[:3, 3] + right + up, T[:3, 3] + right - up, T[:3, 3] - right - up]
    ), card


# --- motion and pictures


def tipping(one: Session, strike: PlannedStrike, rate_hz: int = RATE_HZ) -> Iterator[float]:
    """Tipping angle [rad] per frame, by the equation of motion of a body that rolls on a rounded edge."""
    axis, radius, mass = np.array(strike.pivot.direction), strike.pivot.radius_m, one.spec.mass_kg
    lever = np.array(strike.R_world_object) @ (one.com - np.array(strike.pivot.point))
    across, phi = math.hypot(lever[0], lever[2]), math.atan2(-lever[0], lever[2])
    about_c = float(axis @ one.inertia @ axis)

    def moment(theta: float) -> float:
        return about_c + mass * (across**2 + radius**2 + 2 * radius * across * math.cos(phi - theta))

    theta, turn = 0.0, math.sqrt(2 * ENERGY * mass * GRAVITY * across * (1 - math.cos(phi)) / moment(0.0))
    for _ in range(round(REST_S * rate_hz)):
        yield 0.0
    steps = 32
    while theta < phi + 0.5:
        for _ in range(steps):
            sine = math.sin(phi - theta)
            turn -= mass * across * sine * (GRAVITY + radius * turn**2) / moment(theta) / rate_hz / steps
            theta += turn / rate_hz / steps
        yield theta


def turned_by(strike: PlannedStrike, theta: float) -> Array:
    """Pose (4, 4) of the object in the station's frame, turned by theta [rad] about its edge, rolling."""
    radius = strike.pivot.radius_m
    centre = np.array([0.0, 0.0, radius])
    R = matrix_from_vector(np.array([0.0, theta, 0.0]))
    rolled = transform(R, centre - R @ centre + [radius * theta, 0.0, 0.0])
    return rolled @ transform(np.array(strike.R_world_object), np.array(strike.p_world_object))


def pictures(one: Session, number: int, random: np.random.Generator) -> Iterator[renderer.Image]:
    """Images of one strike: outline of the object with its tags, through the phone's lens, with noise."""
    strike = one.plan.strikes[number]
    T_camera_station = inverse_transform(one.camera.T_world_camera) @ one.placed[number]
    scenery = np.full((2 * renderer.HEIGHT, 2 * renderer.WIDTH), 118, np.uint8)
    for theta in tipping(one, strike):
        T = T_camera_station @ turned_by(strike, theta)
        large = scenery.copy()
        outline = (one.model.hull_vertices @ T[:3, :3].T + T[:3, 3]) @ renderer.K.T
        pixels = 2 * outline[:, :2] / outline[:, 2:] + 0.5
        cv2.fillConvexPoly(large, cv2.convexHull(np.rint(pixels).astype(np.int32)), 150)
        for corners, texture in one.tags:
            seen = corners @ T[:3, :3].T + T[:3, 3]
            if np.cross(seen[1] - seen[0], seen[3] - seen[0]) @ seen.mean(axis=0) > 0:
                renderer.draw(large, texture, seen)
        yield renderer.filmed(large, random)


def write_files(one: Session, folder: Path, *, placed: bool) -> dict[str, Path]:
    """Write object, plan and camera file; the latter with the camera's pose if `placed`."""
    files = {name: folder / f"{name}.toml" for name in ("object", "camera")} | {"plan": folder / "plan.json"}
    files["object"].write_text(one.text, encoding="utf-8")
    if one.shape is not None and one.spec.shape.file is not None:
        (folder / one.spec.shape.file).write_bytes(one.shape)
    files["plan"].write_text(canonical_json(one.plan), encoding="utf-8")
    lens = ["[camera.calibration]", f"width = {renderer.WIDTH}", f"height = {renderer.HEIGHT}"]
    lens += [f"K = {renderer.K.tolist()}", f"distortion = [{renderer.K1}, 0, 0, 0, 0]"]
    lens += [f"T_world_camera = {one.camera.T_world_camera.tolist()}"] if placed else []
    files["camera"].write_text("\n".join(lens) + "\n", encoding="utf-8")
    return files


def write_videos(one: Session, folder: Path, seed: int) -> tuple[list[Path], list[int]]:
    """Write a video of each strike, shuffled, named as a phone names them; with the strikes' numbers."""
    random = np.random.default_rng(seed)
    order = [int(each) for each in random.permutation(len(one.plan.strikes))]
    paths = []
    for place, number in enumerate(order):
        images = list(pictures(one, number, random))
        times = [round(i * 1e6 / RATE_HZ) for i in range(len(images))]
        path = folder / f"IMG_{1000 + 7 * place}.mp4"
        paths.append(write_video(path, images, times, preset="veryfast", crf="14"))
    return paths, order


# --- without images


def seen_view(T_camera_object: Array, direction: Array, point: Array, random: np.random.Generator) -> TipView:
    """The object at rest and its turning line, as tracking sees them: with noise and glued tags' errors.

    Args:
        T_camera_object: (4, 4) true pose of the object at rest in the camera's frame [m].
        direction: (3,) true direction of the line about which it turns, in O.
        point: (3,) point of that line [m], in O.
        random: draws the errors.
    """
    glued = transform(matrix_from_vector(random.normal(0, 0.01, 3)), random.normal(0, 0.001, 3))
    turn = glued[:3, :3].T
    seen = turn @ matrix_from_vector(random.normal(0, 0.01, 3)) @ direction
    line = TurningLine(seen, turn @ (point - glued[:3, 3]) + random.normal(0, 0.001, 3), 0.06)
    return TipView(0, T_camera_object @ glued, line)


def without(possible: PossibleTips, axis_id: str) -> PossibleTips:
    """Possible tips without those over one edge; for a rim's tangent without all of that face's rim."""
    fewer = copy.copy(possible)
    left_out = next(tip.axis for tip in possible.tips if tip.axis.id == axis_id)
    fewer.tips = tuple(tip for tip in possible.tips if tip.axis.id != axis_id)
    if left_out.rolls:
        fewer._planes = [plane for plane in possible._planes if plane.id != left_out.plane.id]
    return fewer
