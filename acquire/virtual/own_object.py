"""A user's object file as an object of the virtual rig.

What the file states is taken as true: shape, mass, edge radius, places of the tags. What it cannot state or
leaves open is drawn from the seed or given by a truth file: the distribution of the mass, friction, an edge
radius that is left out, the places of tags without one. The shape is that which `analyze shape` finds, so
that a scan or a mesh with cracks can be used.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import QhullError

from acquire.errors import ConfigError
from acquire.virtual.bottle_shapes import read_stl
from acquire.virtual.contact_shape import contact_centres
from acquire.virtual.convex_parts import ConvexParts, convex_parts, few_corners
from acquire.virtual.given_truth import GivenTruth, read_given_truth
from acquire.virtual.held_masses import alone, mesh_points, separate_surfaces, with_fixture
from acquire.virtual.hidden import box_depth, cylinder_depth, sample_body
from acquire.virtual.mesh_samples import sample_mesh
from acquire.virtual.objects import VirtualObject
from acquire.virtual.own_masses import default_shell_m, own_body
from acquire.virtual.own_tags import tag_entries, with_places
from acquire.virtual.part_hulls import merged_tree
from acquire.virtual.primitive_meshes import box_mesh, cylinder_mesh
from acquire.virtual.station import (
    ARM_INERTIA_KG_M2,
    ARM_LENGTH_M,
    DISTANCE_M,
    DRAG_COEFFICIENT,
    FOCAL_PX,
    TABLE_FRICTION,
)
from acquire.virtual.tag_places import SIZES_M, tag_places
from schemas.document import DocumentError, read_text
from schemas.object_spec import ObjectSpec, parse_object_spec
from schemas.wording import counted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.hidden import HiddenBody

_FEW_SAMPLES = 40_000
"""samples of the bounding box for the division into convex parts"""
_EDGE_RADIUS_M = (0.0002, 0.0015)
"""range of an edge radius that the object file leaves out [m]"""
_SHARPEST_M = 2e-5
"""radius that stands for a sharp edge [m]"""
_VIEWED_M = 0.16
"""longest extent that the camera sees well from its usual distance [m]"""
_TAG_PX = 68.0
"""smallest edge of a tag's image that the camera's distance aims at [px]"""
_NEAREST_M, _FARTHEST_M = 0.2, 1.3
"""range of the camera's distance from the pivot line [m]"""
_LIGHT_KG, _HEAVIEST_ARM = 0.2, 6.0
"""object's mass [kg] up to which the usual arm strikes hard enough: beyond, the arm's inertia grows with the
mass, up to this multiple"""
_USUAL_TAG_M = 0.03
"""largest tag that is glued on at the camera's usual distance [m]"""


@dataclass(frozen=True)
class OwnObject:
    """Virtual object made from a user's object file, and the object file to plan and measure with."""

    virtual: VirtualObject
    """the object with its hidden properties"""
    object_path: Path
    """object file: the user's own, or a copy with tags added or [[edge]] entries left out"""
    notes: tuple[str, ...]
    """lines for the user: repairs of the shape, tags that were added, the camera's distance"""


@dataclass(frozen=True)
class _Exterior:
    """Closed surface of an object, with notes about how it was found."""

    vertices: NDArray[np.float64]
    """(n, 3) vertices [m, in O, the object's frame]"""
    faces: NDArray[np.int64]
    """(m, 3) triangles, normals outward"""
    volume: float
    """[m3]"""
    notes: tuple[str, ...]

    @property
    def triangles(self) -> NDArray[np.float64]:
        """Corners (m, 3, 3) of the triangles [m]."""
        return self.vertices[self.faces]

    @property
    def extent(self) -> NDArray[np.float64]:
        """Edges (3,) of the bounding box [m]."""
        return np.ptp(self.vertices, axis=0)


def read_own_object(path: Path, seed: int, truth_path: Path | None, folder: Path) -> OwnObject:
    """Read a user's object file, and make an object of the virtual rig from it.

    Args:
        path: object file (TOML), with its shape file beside it.
        seed: seed of what the file leaves open.
        truth_path: truth file (TOML) with hidden properties; None to draw all of them.
        folder: folder for files that are made: the exterior, and a copy of the object file if tags are added
            or its [[edge]] entries left out.

    Raises:
        ConfigError: the object file, its shape or the truth file cannot be used, or the virtual rig cannot
            simulate the object.
    """
    given = read_given_truth(truth_path)
    text, notes = _without_edges(_read_object_text(path), path)
    tagless = "marker" not in tomllib.loads(text)
    rng = np.random.default_rng((seed, 0x0B7EC7))
    object_path = path
    if tagless or notes:
        object_path = folder / "object.toml"
        _copy_shape(text, path, object_path)
        object_path.write_text(text + (tag_entries([]) if tagless else ""), encoding="utf-8")
    exterior = _exterior(object_path, folder, str(path))
    if tagless:
        size = _USUAL_TAG_M * max(1.0, _view_distance(exterior.extent) / DISTANCE_M)
        legible = _TAG_PX * _view_distance(exterior.extent) / FOCAL_PX
        places = tag_places(exterior.triangles, size, min(legible, SIZES_M[0]))
        if not places:
            raise ConfigError(
                f"{path}: lists no tags, and there is no flat place for one of {1000 * size:.0f} mm or less: "
                "add [[marker]] entries"
            )
        text += tag_entries(places)
        object_path.write_text(text, encoding="utf-8")
        sizes = sorted({f"{1000 * place.size_m:g}" for place in places}, key=float)
        notes.append(
            f"{path.name} lists no tags: {counted(len(places), 'tag', 'is')} glued on, of"
            f" {' and '.join(sizes)} mm"
        )
    spec = _parse(text, str(path))
    spec, glued = with_places(spec, exterior.triangles, rng)
    virtual = _virtual_object(spec, text, exterior, given, rng)
    distance = virtual.camera_distance_m
    if abs(distance - DISTANCE_M) > 0.01:
        notes.append(f"the camera stands {distance:.2f} m from the pivot line, for an object of this size")
    if virtual.arm_inertia_kg_m2 > 1.01 * ARM_INERTIA_KG_M2:
        at_tip = virtual.arm_inertia_kg_m2 / ARM_LENGTH_M**2
        notes.append(
            f"the striker's arm has an effective mass of {1000 * at_tip:.0f} g, for an object so heavy"
        )
    return OwnObject(virtual, object_path, (*exterior.notes, *notes, *glued))


def _read_object_text(path: Path) -> str:
    """Text of an object file.

    Raises:
        ConfigError: the file is missing, cannot be read, or is not TOML.
    """
    try:
        text = read_text(path)
        tomllib.loads(text)
    except DocumentError as error:
        raise ConfigError(str(error)) from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    return text


def _without_edges(text: str, path: Path) -> tuple[str, list[str]]:
    """Text of an object file without its [[edge]] entries, and a note if there were any.

    The virtual rig rounds all edges alike; plan and analysis then use the file without the entries.

    Args:
        text: valid TOML.
        path: the object file, for messages.

    Raises:
        ConfigError: the entries cannot be found in the text.
    """
    named = tomllib.loads(text).get("edge")
    if not isinstance(named, list) or not named:  # a wrong type is reported with the whole file
        return text, []
    # An entry ends at the next header. In a multi-line string a line may look like one: then nothing fits.
    kept: list[str] = []
    inside = False
    for line in text.splitlines(keepends=True):
        if line.lstrip().startswith("["):
            inside = "".join(line.split()).startswith("[[edge]]")
        if not inside:
            kept.append(line)
    rest = "".join(kept)
    expected = {name: value for name, value in tomllib.loads(text).items() if name != "edge"}
    try:
        found = tomllib.loads(rest)
    except ValueError:
        found = {}
    if found != expected:
        raise ConfigError(
            f"{path}: the virtual rig rounds all edges alike: take the edge entries out of a copy"
        )
    edges = ", ".join(str(each.get("id", "?")) for each in named if isinstance(each, dict))
    return rest, [
        f"the virtual rig rounds all edges alike: the [[edge]] entries of {path.name} are left out: {edges}"
    ]


def _parse(text: str, name: str) -> ObjectSpec:
    try:
        return parse_object_spec(text, name)
    except DocumentError as error:
        raise ConfigError(str(error)) from None


def _copy_shape(text: str, path: Path, target: Path) -> None:
    """Copy the shape file that an object file names by a relative path, to that path beside `target`.

    Nothing is copied if the object has no shape file, or names it by an absolute path.

    Args:
        text: content of the object file, to which tags will be added.
        path: the user's object file.
        target: path of the copy of the object file.

    Raises:
        ConfigError: the shape file cannot be read, or its path contains "..".
    """
    shape: Any = tomllib.loads(text).get("shape")
    name = shape.get("file") if isinstance(shape, dict) else None
    if not isinstance(name, str) or PurePath(name).is_absolute():
        return
    if ".." in PurePath(name).parts:
        raise ConfigError(f"{path}: put its shape file {name} into the folder of the object file")
    place = target.parent / name
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        shutil.copyfile(path.parent / name, place)
    except OSError as error:
        raise ConfigError(
            f"{path.parent / name}: the shape file cannot be read: {error.strerror}: {path.name} names it: "
            "put it in the same folder"
        ) from None


def _exterior(object_path: Path, folder: Path, name: str) -> _Exterior:
    """Closed surface of the object of an object file: that of a primitive, or as `analyze shape` finds it.

    Args:
        object_path: the object file.
        folder: folder for the surface's file.
        name: name of the object file for messages.

    Raises:
        ConfigError: the object file or its shape cannot be used.
    """
    stl_path = folder / "exterior.stl"
    command = [sys.executable, "-m", "analyze", "shape", str(object_path), "-o", str(stl_path), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        reason = done.stderr.strip().removeprefix("analyze: ").replace(str(object_path), name)
        raise ConfigError(reason or f"{name}: `analyze shape` ended with code {done.returncode}")
    found = json.loads(done.stdout)
    shape = _parse(read_text(object_path), name).shape
    if shape.box is not None:
        vertices, faces = box_mesh(np.array(shape.box.size_m) / 2)
    elif shape.cylinder is not None:
        vertices, faces = cylinder_mesh(shape.cylinder.radius_m, shape.cylinder.height_m / 2)
    else:
        vertices, faces = read_stl(stl_path.read_bytes())
        vertices = 0.001 * vertices
    return _Exterior(vertices, faces, float(found["volume_m3"]), tuple(found["notes"]))


def _view_distance(extent: NDArray[np.float64]) -> float:
    """Camera distance [m] from which the whole of an object with bounding box `extent` (3,) [m] is seen."""
    return float(np.clip(DISTANCE_M * extent.max() / _VIEWED_M, _NEAREST_M, _FARTHEST_M))


def _camera_distance(spec: ObjectSpec, extent: NDArray[np.float64]) -> float:
    """Distance of the camera from the line about which the object tips [m], from its size and its tags.

    It is the usual one, or nearer for small tags, but never so near that the object is not seen as a whole.

    Args:
        spec: content of the object file, with the tags' sizes.
        extent: (3,) edges of the object's bounding box [m].
    """
    legible = FOCAL_PX * min(marker.size_m for marker in spec.marker) / _TAG_PX
    return max(_view_distance(extent), min(DISTANCE_M, legible))


def _virtual_object(
    spec: ObjectSpec, text: str, exterior: _Exterior, given: GivenTruth, rng: np.random.Generator
) -> VirtualObject:
    """Virtual object with shape, hidden masses, friction and edge radius.

    Args:
        spec: content of the object file, with places of all tags.
        text: text of the object file.
        exterior: surface of the object.
        given: content of the truth file.
        rng: generator of what is not given.

    Raises:
        ConfigError: the truth does not fit the object, or the edge radius is too large for it.
    """
    friction, drawn_radius = float(rng.uniform(*TABLE_FRICTION)), float(rng.uniform(*_EDGE_RADIUS_M))
    radius = drawn_radius if spec.edge_radius_m is None else spec.edge_radius_m
    radius = radius if given.edge_radius_m is None else given.edge_radius_m
    body = _body(spec, exterior, given, rng)
    parts = _parts(spec, exterior)
    hull = few_corners(exterior.vertices)
    virtual = VirtualObject(
        spec=spec,
        spec_toml=text,
        shape_file=None,
        mesh_vertices=exterior.vertices,
        mesh_faces=exterior.faces,
        hull_vertices=hull,
        convex_parts=(hull,) if parts is None else parts.corners,
        edge_radius_m=max(radius, _SHARPEST_M),
        friction=friction if given.friction is None else given.friction,
        body=body,
        drawn_parts=parts,
        drag_coefficient=float(rng.uniform(*DRAG_COEFFICIENT)),
    )
    _refuse_round_edges(virtual)
    return replace(
        virtual,
        camera_distance_m=_camera_distance(spec, exterior.extent),
        arm_inertia_kg_m2=ARM_INERTIA_KG_M2 * float(np.clip(body.mass_kg / _LIGHT_KG, 1.0, _HEAVIEST_ARM)),
    )


def _parts(spec: ObjectSpec, exterior: _Exterior) -> ConvexParts | None:
    """Convex parts of a shape from a file, or None for a primitive."""
    if spec.shape.file is None:
        return None
    inside = sample_mesh(exterior.triangles, _FEW_SAMPLES)
    parts = convex_parts(exterior.triangles, inside, exterior.volume)
    return replace(parts, tree=merged_tree(parts.corners, parts.tree))


def _body(spec: ObjectSpec, exterior: _Exterior, given: GivenTruth, rng: np.random.Generator) -> HiddenBody:
    """True mass properties of an object, from points inside its surface.

    Args:
        spec: content of the object file.
        exterior: surface of the object.
        given: content of the truth file.
        rng: generator of what is not given.

    Raises:
        ConfigError: the truth does not fit the object.
    """
    shell_m = default_shell_m(spec, given, float(exterior.extent.min()), rng)
    low, high = exterior.vertices.min(axis=0), exterior.vertices.max(axis=0)
    if spec.shape.box is not None:
        points, depths = sample_body(low, high, box_depth((high - low) / 2))
    elif spec.shape.cylinder is not None:
        cylinder = spec.shape.cylinder
        points, depths = sample_body(low, high, cylinder_depth(cylinder.radius_m, cylinder.height_m / 2))
    elif spec.fixture is not None:
        surfaces = separate_surfaces(spec, exterior.triangles)
        inside = mesh_points(surfaces.own, shell_m)
        return with_fixture(spec, own_body(alone(spec), given, *inside, shell_m, rng), surfaces)
    else:
        points, depths = mesh_points(exterior.triangles, shell_m)
    return own_body(spec, given, points, depths, shell_m, rng)


def _refuse_round_edges(virtual: VirtualObject) -> None:
    """Refuse an object too thin for its edge radius.

    Raises:
        ConfigError: 2.2 times the radius reaches the object's smallest extent, or nothing is left of the
            object when its faces are moved inwards by the radius.
    """
    try:
        fits = 2.2 * virtual.edge_radius_m < float(np.ptp(virtual.mesh_vertices, axis=0).min())
        if fits:
            contact_centres(virtual)
    except QhullError:
        fits = False
    if not fits:
        raise ConfigError(
            f"{virtual.spec.name}: is too thin for edges with a radius of "
            f"{1000 * virtual.edge_radius_m:g} mm: correct edge_radius_m (metres)"
        )
