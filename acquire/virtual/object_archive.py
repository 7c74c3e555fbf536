"""File that hands a virtual object over to the processes of the virtual rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from acquire.errors import AcquireError
from acquire.virtual.contents import Contents
from acquire.virtual.convex_parts import ConvexParts
from acquire.virtual.given_contents import ContentsKind
from acquire.virtual.hidden import HiddenBody
from acquire.virtual.objects import OBJECT_NAMES, VirtualObject, load_object
from acquire.virtual.packaging import Packaging, PrintKind
from schemas.object_spec import ObjectSpec

SUFFIX = ".npz"


def save_object(virtual_object: VirtualObject, path: Path) -> None:
    """Write a virtual object to a file that `open_object` reads; its name ends in .npz."""
    body, parts = virtual_object.body, virtual_object.drawn_parts
    np.savez(
        path,
        spec=virtual_object.spec.model_dump_json(),
        spec_toml=virtual_object.spec_toml,
        mesh_vertices=virtual_object.mesh_vertices,
        mesh_faces=virtual_object.mesh_faces,
        hull_vertices=virtual_object.hull_vertices,
        part_corners=np.concatenate(virtual_object.convex_parts),
        part_sizes=[len(part) for part in virtual_object.convex_parts],
        drawn=parts is not None,
        tree=np.zeros((0, 4)) if parts is None else parts.tree,
        numbers=[
            virtual_object.edge_radius_m,
            virtual_object.friction,
            virtual_object.camera_distance_m,
            virtual_object.arm_inertia_kg_m2,
            virtual_object.drag_coefficient,
        ],
        com=body.com_object,
        inertia=body.inertia_com,
        masses=[body.mass_kg, *body.region_masses],
        plane=[*body.region_plane[0], body.region_plane[1]],
        shell=body.shell_thickness_m,
        print_kind=virtual_object.packaging.kind.value,
        print_seed=virtual_object.packaging.seed,
        glossy=virtual_object.packaging.glossy,
        **_contents_arrays(virtual_object.contents),
    )


def open_object(name: str, seed: int) -> VirtualObject:
    """Virtual object by the name of one that comes with the program, or from a file of `save_object`.

    Args:
        name: one of OBJECT_NAMES, or the path of a file.
        seed: seed of the mass distribution and friction of an object given by its name.

    Raises:
        AcquireError: there is no such object or file.
    """
    if name in OBJECT_NAMES or not name.endswith(SUFFIX):
        return load_object(name, seed)
    try:
        data = np.load(name, allow_pickle=False)
    except OSError as error:
        raise AcquireError(
            f"{name}: cannot be read ({error.strerror}): start the virtual rig again"
        ) from None
    with data:
        ends = np.cumsum(data["part_sizes"])[:-1]
        parts = tuple(np.split(data["part_corners"], ends))
        mass, *regions = (float(value) for value in data["masses"])
        radius, friction, distance, arm, drag = (float(value) for value in data["numbers"])
        return VirtualObject(
            spec=ObjectSpec.model_validate_json(str(data["spec"])),
            spec_toml=str(data["spec_toml"]),
            shape_file=None,
            mesh_vertices=data["mesh_vertices"],
            mesh_faces=data["mesh_faces"],
            hull_vertices=data["hull_vertices"],
            convex_parts=parts,
            edge_radius_m=radius,
            friction=friction,
            body=HiddenBody(
                mass,
                data["com"],
                data["inertia"],
                (regions[0], regions[1], regions[2]),
                (data["plane"][:3], float(data["plane"][3])),
                float(data["shell"]),
            ),
            drawn_parts=ConvexParts(parts, data["tree"]) if data["drawn"] else None,
            camera_distance_m=distance,
            arm_inertia_kg_m2=arm,
            drag_coefficient=drag,
            packaging=Packaging(
                PrintKind(str(data["print_kind"])), int(data["print_seed"]), bool(data["glossy"])
            ),
            contents=_contents(data) if "inside_kind" in data else None,
        )


def _contents_arrays(contents: Contents | None) -> dict[str, Any]:
    """Arrays of a file that hold what moves inside an object; none for a rigid one."""
    if contents is None:
        return {}
    rigid = contents.rigid
    return {
        "inside_kind": contents.kind.value,
        "inside_numbers": [contents.mass_kg, contents.friction, contents.damping_per_s, contents.smooth_m],
        "inside_planes": contents.planes,
        "inside_depths": contents.depths,
        "inside_middle": contents.middle,
        "inside_seed": contents.seed,
        "rigid_com": rigid.com_object,
        "rigid_inertia": rigid.inertia_com,
        "rigid_masses": [rigid.mass_kg, *rigid.region_masses],
    }


def _contents(data: Any) -> Contents:
    """What moves inside an object, from the arrays of a file."""
    mass, *regions = (float(value) for value in data["rigid_masses"])
    plane = (data["plane"][:3], float(data["plane"][3]))
    masses = (regions[0], regions[1], regions[2])
    rigid = HiddenBody(mass, data["rigid_com"], data["rigid_inertia"], masses, plane, float(data["shell"]))
    inside, friction, damping, smooth = (float(value) for value in data["inside_numbers"])
    kind = ContentsKind(str(data["inside_kind"]))
    planes, depths = data["inside_planes"], data["inside_depths"]
    middle, seed = data["inside_middle"], int(data["inside_seed"])
    return Contents(kind, inside, friction, damping, planes, depths, smooth, middle, rigid, seed)
