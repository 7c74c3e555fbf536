"""Bodies to export: any physically possible inertia, any shape, any name."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analyze.export.body import ExportBody, Inertial
from analyze.geometry.object_model import ObjectModel, load_object_model
from schemas.object_spec import Box, Cylinder, LengthUnit, MarkerSpec, ObjectSpec, Shape

HOSTILE = '--> "Sugo" <&amp;> ]]> \x00\x1f\u202e\ufffe日本 #{def} __x__ ::/../%41'
SHAPES = ("box", "cylinder", "mesh")
# A corner cut off a box: no symmetry that would hide a swapped axis or a face turned inside out.
WEDGE = np.array(
    [
        [0.0, 0, 0],
        [0.09, 0, 0],
        [0.09, 0.04, 0],
        [0, 0.06, 0],
        [0, 0, 0.13],
        [0.03, 0, 0.13],
        [0.03, 0.02, 0.13],
        [0, 0.02, 0.13],
    ]
)
QUADS = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def wedge_obj() -> bytes:
    """The wedge as an OBJ file in millimetres, one vertex with more digits than single precision keeps."""
    vertices = WEDGE.copy()
    vertices[6, 2] += 1.23456789e-5
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (1000 * vertices).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in QUADS]
    return "\n".join(lines).encode()


def spec_of(shape: str, name: str = "thing") -> ObjectSpec:
    shapes = {
        "box": Shape(box=Box(size_m=[0.08, 0.06, 0.15])),
        "cylinder": Shape(cylinder=Cylinder(radius_m=0.03, height_m=0.2)),
        "mesh": Shape(file="wedge.obj", unit=LengthUnit.MILLIMETRE),
    }
    return ObjectSpec(
        name=name, mass_kg=0.3, mass_sd_kg=0.001, shape=shapes[shape], marker=[MarkerSpec(id=0, size_m=0.03)]
    )


def model_of(shape: str) -> ObjectModel:
    return load_object_model(spec_of(shape), wedge_obj() if shape == "mesh" else None, "wedge.obj")


def inertia_of(second: list[float], rotation: np.ndarray, size: float) -> np.ndarray:
    """Inertia tensor (3, 3) from second moments (3,) along the columns of `rotation`, with trace `size`."""
    moments = sum(second) - np.array(second)
    tensor = rotation @ np.diag(moments * size / moments.sum()) @ rotation.T
    return (tensor + tensor.T) / 2


def body_of(shape: str = "box", name: str = "thing", inertial: Inertial | None = None) -> ExportBody:
    plain = Inertial(
        0.25,
        np.array([0.011, -0.007, 0.023]),
        inertia_of([3, 1, 2], Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), 1e-3),
    )
    return ExportBody(
        name,
        model_of(shape),
        inertial or plain,
        {"object": name, "inertia": {"Ixx": {"value": -1e-07, "sd": None}}},
    )


@st.composite
def inertials(draw) -> Inertial:
    """Inertial parameters from a grain to the heaviest object that can be struck.

    They include flat and long bodies, any principal axes, and two or three equal moments.
    """
    second = [draw(st.sampled_from([1.0, 1.0, 0.3]) | st.floats(2e-3, 1.0)) for _ in range(3)]
    quaternion = [draw(st.floats(-1, 1)) for _ in range(4)]
    length = np.linalg.norm(quaternion)
    rotation = np.eye(3) if length < 1e-3 else Rotation.from_quat(quaternion).as_matrix()
    com = [draw(st.floats(-0.5, 0.5)) for _ in range(3)]
    return Inertial(
        10 ** draw(st.floats(-3, 1.3)),
        np.array(com),
        inertia_of(second, rotation, 10 ** draw(st.floats(-8, 0))),
    )
