"""Descriptions of a body as users give them: object file, shape file and plan, with errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.bodies import Body, bodies_of
from analyze.geometry.object_model import ObjectModel
from analyze.planning.examine import Bench
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.pivots import PivotAxis, Swing, pivot_axes, swing
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.stable_planes import resting_planes
from analyze.planning.view import default_camera
from schemas.object_spec import EdgeRadius, ObjectSpec, object_sha256
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from tests.analyze.geometry.shapes import obj, stl
from tests.benchmarks.honesty.bodies import RADIUS_SD, TrueBody, load_model, true_body
from tests.benchmarks.honesty.disturbances import Disturbance
from tests.benchmarks.honesty.statics import G

STRIKES = 9
DRAWS = 4
"""draws of the errors of a body's description"""
FORM_SD = 5e-5
"""error of each face [m] of a shape that is stated as exact: bodies are made to hundredths of a millimetre"""
CLOUD_POINTS = 6000
LARGE_PLANE = 0.1
"""area over the largest resting plane's, above which a user puts the object on it"""
ROUND = 20
"""number of faces above which a body is round"""
MEETING = 3e-3
"""distance [m] up to which three rounded edges count as meeting at a vertex"""


@dataclass(frozen=True)
class Description:
    """Object as a user describes it, with the strikes planned from that."""

    spec: ObjectSpec
    model: ObjectModel
    bodies: tuple[Body, ...]
    plan: StrikePlan


@lru_cache(maxsize=24)
def description(name: str, disturbance: Disturbance, draw: int) -> Description | None:
    """Description of a body with draw number `draw` of the errors of its shape and edge radius.

    None if the disturbance does not apply to the body: it has no three edges that meet, cannot be tipped, or
    all its edges are alike where a radius per edge is to be stated.

    Raises:
        AnalyzeError: our planner refuses the object, or its shape cannot be read.
    """
    body = true_body(name)
    rng = np.random.default_rng((0xDE5C, draw, *name.encode()))
    spec, data = _stated(body, disturbance, rng)
    model = load_model(body, spec, data)
    if disturbance.radius == "per edge":
        if np.ptp(body.radii) == 0:
            return None
        spec = _with_edge_radii(spec, body, model, rng)
    own_hash = object_sha256(spec, data)
    bodies = tuple(bodies_of(spec, data, str(spec.shape.file))) if spec.labels else ()
    if disturbance.edges == "planned":
        bench = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION)
        plan = plan_strikes(prepare_object(model, spec, bench), own_hash, PlanRequest(strikes=STRIKES))
        return Description(spec, model, bodies, plan)
    axes = _axes_by_hand(model, spec)
    chosen = _own_edges(axes, rng) if disturbance.edges == "own" else _over_one_vertex(axes)
    strikes = [_planned(i + 1, axis, model, spec) for i, axis in enumerate(chosen)]
    if not strikes:
        return None
    plan = StrikePlan(object_name=spec.name, object_sha256=own_hash, strikes=strikes)
    return Description(spec, model, bodies, plan)


def planning_key(disturbance: Disturbance) -> Disturbance:
    """The disturbance with only those entries that change the description, as key of `description`."""
    kept = ("radius", "scan", "scan_sd", "scan_stated", "edges")
    return Disturbance(**{name: getattr(disturbance, name) for name in kept})


def _stated(
    body: TrueBody, disturbance: Disturbance, rng: np.random.Generator
) -> tuple[ObjectSpec, bytes | None]:
    """Object file and shape file with errors of radius and shape, drawn as large as they are stated."""
    off = rng.normal(0, RADIUS_SD)
    changes: dict[str, object] = {"edge_radius_m": max(0.0, body.stated_radius[0] + off)}
    if disturbance.radius == "wrong":
        wrong = 1e-3 if np.median(body.radii) < 8e-4 else 3e-4
        changes |= {"edge_radius_m": wrong, "edge_radius_sd_m": 1e-4}
    shape, data, size = dict(body.shape), body.shape_bytes, float(np.ptp(body.centres, axis=0).max())
    if disturbance.scan == "none":
        shape, data = _distorted(body, replace(disturbance, scan="faces", scan_sd=FORM_SD), rng)
    elif disturbance.scan in ("scale", "offset", "faces"):
        shape, data = _distorted(body, disturbance, rng)
    if disturbance.scan == "cloud":
        shape, data = {"file": "b.xyz", "unit": "mm"}, _cloud(body, disturbance.scan_sd, rng)
    if disturbance.scan_stated and disturbance.scan == "scale":
        shape["scale_sd"] = disturbance.scan_sd / size
    if disturbance.scan_stated and disturbance.scan in ("offset", "faces"):
        shape["surface_sd_m"] = disturbance.scan_sd
    if not disturbance.scan_stated:
        del shape["surface_sd_m"]
    if disturbance.scan == "cloud":
        changes["labels"] = None
    spec = body.spec(shape=shape, **changes)
    if disturbance.radius == "missing":
        entries = {name: getattr(spec, name) for name in spec.model_fields_set}
        spec = ObjectSpec(**{k: v for k, v in entries.items() if not k.startswith("edge_radius")})
    return spec, data


def _with_edge_radii(
    spec: ObjectSpec, body: TrueBody, model: ObjectModel, rng: np.random.Generator
) -> ObjectSpec:
    """Object file with the radius of every edge as measured: that of the contact spheres, with an error."""
    entries = []
    for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model)):
        across = body.centres - axis.point
        across -= np.outer(across @ axis.direction, axis.direction)
        radius = float(body.radii[np.argsort(np.linalg.norm(across, axis=1))[:2]].mean())
        measured = max(0.0, radius + rng.normal(0, RADIUS_SD))
        entries.append(EdgeRadius(id=axis.id, radius_m=measured, radius_sd_m=RADIUS_SD))
    return spec.model_copy(update={"edge": entries})


def _distorted(
    body: TrueBody, disturbance: Disturbance, rng: np.random.Generator
) -> tuple[dict, bytes | None]:
    """Shape entry and file with an error of scale, or of the whole surface or each face along its normal."""
    size = float(np.ptp(body.centres, axis=0).max())
    error = rng.normal(0, disturbance.scan_sd)
    if body.shape_bytes is None:
        radius, height = body.shape["cylinder"]["radius_m"], body.shape["cylinder"]["height_m"]
        if disturbance.scan == "scale":
            grown = {"radius_m": radius * (1 + error / size), "height_m": height * (1 + error / size)}
        else:
            own = rng.normal(0, disturbance.scan_sd, 2) if disturbance.scan == "faces" else (error, error)
            grown = {"radius_m": radius + own[0], "height_m": height + 2 * own[1]}
        return {**body.shape, "cylinder": grown}, None
    pieces = []
    for piece in body.pieces:
        if disturbance.scan == "scale":
            pieces.append(piece * (1 + error / size))
        else:
            pieces.append(_moved_faces(piece, error, disturbance, rng))
    if body.shape["file"].endswith("obj"):
        numbers = np.arange(3 * sum(len(piece) for piece in pieces)).reshape(-1, 3)
        corners, index = np.unique(np.concatenate(pieces).reshape(-1, 3), axis=0, return_inverse=True)
        return dict(body.shape), obj(corners, index.reshape(numbers.shape))
    return dict(body.shape), stl(np.concatenate(pieces))


def _moved_faces(
    piece: np.ndarray, error: float, disturbance: Disturbance, rng: np.random.Generator
) -> np.ndarray:
    """Triangles [mm] of a convex piece with each face moved outwards by the error [m] of the scan."""
    points, index = np.unique(piece.reshape(-1, 3), axis=0, return_inverse=True)
    hull = ConvexHull(points)
    planes, label = np.unique(np.round(hull.equations, 6), axis=0, return_inverse=True)
    # A round body stays round: its facets share an error by height and slope.
    kinds = np.round(planes[:, 2:], 3) if len(planes) > ROUND else planes
    kind = np.unique(kinds, axis=0, return_inverse=True)[1].ravel()
    own = rng.normal(0, disturbance.scan_sd, len(planes))[kind] if disturbance.scan == "faces" else error
    planes = planes - np.column_stack([np.zeros((len(planes), 3)), 1e3 * np.broadcast_to(own, len(planes))])
    moved = points.copy()
    for vertex in range(len(points)):
        touching = np.unique(label.ravel()[(hull.simplices == vertex).any(axis=1)])
        rows = planes[touching]
        # Where more than three faces meet, the corner nearest to the old one.
        shift = np.linalg.lstsq(rows[:, :3], -rows[:, 3] - rows[:, :3] @ points[vertex], rcond=1e-3)[0]
        moved[vertex] += shift
    return moved[index.reshape(-1, 3)]


def _cloud(body: TrueBody, sd: float, rng: np.random.Generator) -> bytes:
    """XYZ file (text) of a point cloud [mm] of the true, rounded surface, with noise of 1 sigma `sd` [m]."""
    triangles = np.concatenate(body.pieces)
    area = np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )
    chosen = rng.choice(len(triangles), CLOUD_POINTS, p=area / area.sum())
    u = np.sqrt(rng.random(CLOUD_POINTS))[:, None]
    v = rng.random(CLOUD_POINTS)[:, None]
    a, b, c = triangles[chosen].transpose(1, 0, 2)
    points = 1e-3 * (a * (1 - u) + b * u * (1 - v) + c * u * v)
    if len(body.centres) == 8:
        points = _rounded(body, points)
    points = points + rng.normal(0, sd, points.shape)
    return "\n".join(f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in 1e3 * points).encode()


def _rounded(body: TrueBody, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of a box's sharp surface moved onto its rounding."""
    nearest = np.argmin(((points[:, None] - body.centres[None]) ** 2).sum(axis=2), axis=1)
    radius = body.radii[nearest][:, None]
    inner = np.clip(points, -np.abs(body.centres[nearest]), np.abs(body.centres[nearest]))
    out = points - inner
    return inner + out * radius / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)


def _axes_by_hand(model: ObjectModel, spec: ObjectSpec) -> list[PivotAxis]:
    """Edges that a user without our planner may choose: those with a predicted phi of 8 to 50 deg."""
    believed = hypothesis(model)
    found = []
    planes = resting_planes(model)
    large = [plane for plane in planes if plane.area > LARGE_PLANE * max(each.area for each in planes)]
    for axis in pivot_axes(model, spec, large, believed):
        tall = float(np.ptp(model.hull_vertices @ axis.plane.up))
        phi = _swing(axis, model, spec).phi
        if np.radians(8) < phi < np.radians(50) and tall > 0.03:
            found.append(axis)
    return found


def _own_edges(axes: list[PivotAxis], rng: np.random.Generator) -> list[PivotAxis]:
    """Nine strikes over up to six edges of all those that can be tipped over, chosen without a planner."""
    order = [axes[i] for i in rng.permutation(len(axes))][:6]
    return sorted((order * 3)[:STRIKES], key=lambda axis: axis.id) if order else []


def _over_one_vertex(axes: list[PivotAxis]) -> list[PivotAxis]:
    """Nine strikes over three edges that meet at a vertex; empty if there are none."""
    triples = []
    for three in combinations(axes, 3):
        rows = np.array([axis.direction for axis in three])
        if any(axis.rolls for axis in three) or abs(np.linalg.det(rows)) < 0.5:
            continue
        # The point nearest to three lines is on all of them where they meet.
        across = np.eye(3) - rows[:, :, None] * rows[:, None, :]
        points = np.array([axis.point for axis in three])
        meeting = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, points))
        gap = np.linalg.norm(np.einsum("nij,nj->ni", across, meeting - points), axis=1).max()
        if gap < MEETING:
            triples.append((round(float(gap), 6), [axis.id for axis in three], three))
    if not triples:
        return []
    return [axis for axis in min(triples, key=lambda each: each[:2])[2] for _ in range(3)]


def _swing(axis: PivotAxis, model: ObjectModel, spec: ObjectSpec) -> Swing:
    return swing(axis, model.centroid, spec.mass_kg, model.unit_inertia, G)


def _planned(number: int, axis: PivotAxis, model: ObjectModel, spec: ObjectSpec) -> PlannedStrike:
    """Plan entry of a strike over an axis, struck at its centre of percussion or near the top."""
    expected = _swing(axis, model, spec)
    heights = model.hull_vertices @ axis.plane.up
    tall = float(np.ptp(heights))
    height = min(0.92 * tall, expected.i_edge / (spec.mass_kg * expected.distance * np.cos(expected.phi)))
    speed, impulse = Range(min=0.1, target=0.3, max=1.0), Range(min=0.01, target=0.05, max=0.1)
    point = axis.point + axis.plane.up * (height - axis.radius) - axis.tip * 0.01
    return PlannedStrike(
        id=f"s{number}",
        plane_id=axis.plane.id,
        axis_id=axis.id,
        R_world_object=axis.R_world_object.tolist(),
        p_world_object=axis.p_world_object.tolist(),
        pivot=Pivot(
            point=axis.point.tolist(),
            direction=axis.direction.tolist(),
            radius_m=axis.radius,
            sd_m=axis.sd,
        ),
        impact=Impact(point=point.tolist(), direction=axis.tip.tolist()),
        impact_height_m=height,
        impulse_n_s=impulse,
        tip_speed_m_s=speed,
        energy_ratio=1.1,
        phi_predicted_rad=expected.phi,
        phi_predicted_sd_rad=0.05,
        i_edge_predicted_kg_m2=expected.i_edge,
        visible_markers=[],
        camera_pose=np.eye(4).tolist(),
        friction_needed=0.3,
        rolls=axis.rolls,
    )
