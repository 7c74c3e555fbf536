"""Contract of all formats: the file loads in its reader with the same ten parameters and shape."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from analyze.errors import ExportError
from analyze.export import write
from analyze.export.body import ExportBody, Inertial, identifier
from analyze.export.formats import Format
from analyze.export.mesh import mesh_file
from analyze.export.provenance import printable, provenance_text
from analyze.export.read_back import read_back
from analyze.export.usd import write_usd
from analyze.export.write import refuse_changed_parameters, write_body
from schemas.output_file import OutputError
from tests.analyze.export.bodies import HOSTILE, SHAPES, body_of, inertials

FILES = [each for each in Format if each is not Format.GAZEBO]
FORMATS = pytest.mark.parametrize("wanted", FILES, ids=lambda each: each.value)
EXAMPLES = 20


def written(body: ExportBody, wanted: Format, folder: Path) -> Path:
    path = folder / f"out{wanted.suffixes[0]}"
    write_body(body, wanted, path)
    return path


@FORMATS
def test_ten_parameters_are_read_back_for_any_body(wanted, tmp_path):
    box = body_of()

    @settings(max_examples=EXAMPLES, database=None)
    @given(inertials())
    def holds(inertial: Inertial) -> None:
        path = written(replace(box, inertial=inertial), wanted, tmp_path)
        refuse_changed_parameters(inertial, read_back(path, wanted), wanted)
        path.unlink()

    holds()


@FORMATS
@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_and_a_hostile_name_are_read_back(wanted, shape, tmp_path):
    body = body_of(shape, HOSTILE)
    path = written(body, wanted, tmp_path)
    refuse_changed_parameters(body.inertial, read_back(path, wanted), wanted)
    mesh = None if wanted in {Format.USD, Format.ROS} else mesh_file(body)
    assert {each.name for each in tmp_path.iterdir()} == {path.name} | (
        set() if mesh is None else {mesh.name}
    )
    name = printable(HOSTILE) if wanted is Format.USD else HOSTILE
    assert said_in(path, wanted) == {**body.provenance, "object": name}


def said_in(path: Path, wanted: Format) -> dict[str, object]:
    if wanted is Format.USD:
        stage = Usd.Stage.Open(str(path))  # held: its prims live no longer
        said = stage.GetDefaultPrim().GetCustomDataByKey("percuss")
        return {key: value if key == "object" else json.loads(value) for key, value in said.items()}
    if wanted is Format.ROS:
        lines = [line[2:] for line in path.read_text().split("\n") if line.startswith("#")]
        return parse_provenance("\n".join(lines[1:]))
    comments = (
        ET.parse(path, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot().iter(ET.Comment)
    )
    return parse_provenance(next(comments).text)


def parse_provenance(text: str) -> dict[str, object]:
    """JSON in a comment that `provenance_text` wrote, behind its first line."""
    return json.loads(text.partition("\n")[2])


@pytest.mark.parametrize("shape", SHAPES)
def test_mujoco_simulates_the_body_by_newtons_laws(shape, tmp_path):
    """The engine accelerates the body under a wrench by Newton's laws; its shape is placed as in O."""
    body = body_of(shape)
    model = mujoco.MjModel.from_xml_path(str(written(body, Format.MJCF, tmp_path)))
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    force, torque = np.array([0.3, -0.2, 0.5]), np.array([0.01, 0.02, -0.015])
    data.xfrc_applied[1] = [*force, *torque]  # at the centre of mass
    mujoco.mj_forward(model, data)
    spin = np.linalg.solve(body.inertial.inertia, torque)
    np.testing.assert_allclose(data.qacc[3:], spin, rtol=1e-7, atol=1e-9 * np.abs(spin).max())
    at_origin = force / body.inertial.mass - np.cross(spin, body.inertial.com)
    np.testing.assert_allclose(data.qacc[:3], at_origin, rtol=1e-7)
    np.testing.assert_allclose(data.xipos[1], body.inertial.com, rtol=1e-12)
    if shape == "mesh":
        corners = data.geom_xpos[1] + model.mesh_vert @ data.geom_xmat[1].reshape(3, 3).T
        np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], body.model.bounds, atol=1e-7)
    else:
        size = {"box": [0.04, 0.03, 0.075], "cylinder": [0.03, 0.1, 0]}[shape]
        np.testing.assert_allclose(model.geom_size[1], size, rtol=1e-12)


def test_usd_quaternion_rotates_prim_axes_to_principal_axes(tmp_path):
    """By USD's own quaternions: each rotated axis is an eigenvector of the tensor, with its moment."""
    inertial = body_of().inertial
    stage = Usd.Stage.Open(str(written(body_of(), Format.USD, tmp_path)))
    own = UsdPhysics.MassAPI(stage.GetDefaultPrim())
    for moment, axis in zip(own.GetDiagonalInertiaAttr().Get(), np.eye(3), strict=True):
        turned = np.array(own.GetPrincipalAxesAttr().Get().Transform(Gf.Vec3f(*axis)), dtype=np.float64)
        np.testing.assert_allclose(
            inertial.inertia @ turned, moment * turned, atol=1e-6 * np.abs(inertial.inertia).max()
        )


@pytest.mark.parametrize("shape", SHAPES)
def test_usd_has_the_shape_in_metres_with_z_up(shape, tmp_path):
    body = body_of(shape)
    stage = Usd.Stage.Open(str(written(body, Format.USD, tmp_path)))
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (1.0, "Z")
    prim = stage.GetDefaultPrim()
    bounds = (
        UsdGeom.Imageable(prim)
        .ComputeWorldBound(Usd.TimeCode.Default(), UsdGeom.Tokens.default_)
        .ComputeAlignedRange()
    )
    half = {"box": [0.04, 0.03, 0.075], "cylinder": [0.03, 0.03, 0.1]}.get(shape)
    expected = body.model.bounds if half is None else [np.negative(half), half]
    np.testing.assert_allclose([bounds.GetMin(), bounds.GetMax()], expected, atol=1e-7)
    assert stage.GetPrimAtPath(f"{prim.GetPath()}/shape").HasAPI(UsdPhysics.CollisionAPI)


@pytest.mark.parametrize("ending", [".usda", ".usd", ".usdc"])
def test_usd_suffix_selects_the_encoding(ending, tmp_path):
    path = tmp_path / f"out{ending}"
    write_body(body_of("mesh"), Format.USD, path)
    assert path.read_bytes().startswith(b"#usda" if ending == ".usda" else b"PXR-USDC")
    refuse_changed_parameters(body_of().inertial, read_back(path, Format.USD), Format.USD)


@pytest.mark.parametrize("shape", SHAPES)
def test_urdf_tensor_is_along_link_axes_and_shape_is_in_frame_o(shape, tmp_path):
    body = body_of(shape)
    path = written(body, Format.URDF, tmp_path)
    inertia = ET.parse(path).getroot().find("link/inertial/inertia").attrib
    assert {name: float(value) for name, value in inertia.items()} == {
        f"i{'xyz'[i]}{'xyz'[j]}": body.inertial.inertia[i, j] for i in range(3) for j in range(i, 3)
    }
    bounds = yourdfpy.URDF.load(str(path)).scene.bounds
    size = (
        body.model.bounds
        if shape == "mesh"
        else np.outer([-1, 1], {"box": [0.04, 0.03, 0.075], "cylinder": [0.03, 0.03, 0.1]}[shape])
    )
    np.testing.assert_allclose(
        bounds, size, atol=1e-5 if shape == "cylinder" else 1e-12
    )  # a cylinder is drawn with 32 sides


def test_sdf_tensor_is_along_link_axes(tmp_path):
    body = body_of("mesh")
    link = ET.parse(written(body, Format.SDF, tmp_path)).getroot().find("model/link")
    assert [float(number) for number in link.find("inertial/pose").text.split()] == [
        *body.inertial.com,
        0,
        0,
        0,
    ]
    for entry in link.find("inertial/inertia"):
        assert (
            float(entry.text) == body.inertial.inertia["xyz".index(entry.tag[1]), "xyz".index(entry.tag[2])]
        )
    uris = {part.text for part in link.iter("uri")}
    assert uris == {mesh_file(body).name}


def test_a_mesh_keeps_every_digit(tmp_path):
    body = body_of("mesh")
    write_body(body, Format.URDF, tmp_path / "out.urdf")
    lines = (tmp_path / mesh_file(body).name).read_text().splitlines()
    vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=np.float64)
    np.testing.assert_array_equal(vertices, body.model.vertices)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("carton", "carton"),
        ("tea box", "tea_box"),
        ("Café-Dose №3", "Cafe_Dose_No3"),
        ("3 tins", "object_3_tins"),
        ("world", "object_world"),
        ("__frame__", "frame"),
        ("盐", "object"),
        (HOSTILE, "Sugo_amp_def_x_41"),
    ],
)
def test_names_are_valid_in_every_format(name, expected):
    assert identifier(name) == expected
    assert Sdf.Path.IsValidIdentifier(expected)


@pytest.mark.parametrize("name", ["--", "---->", "-\\-", "a-", "\\u002d-", HOSTILE, "\ud7ff\ue000𝔘"])
def test_provenance_comment_keeps_any_name(name):
    text = provenance_text({"object": name})
    assert "--" not in text
    ET.fromstring(f"<a><!--{text}--></a>")
    assert parse_provenance(text) == {"object": name}


@FORMATS
def test_file_that_is_read_back_differently_is_not_written(wanted, tmp_path, monkeypatch):
    """A difference just above the format's precision is an error, and the existing file stays."""
    path = tmp_path / f"out{wanted.suffixes[0]}"
    path.write_text("before")
    body = body_of("mesh")

    def off(staged: Path, where: Format) -> Inertial:
        found = read_back(staged, where)
        return replace(
            found, inertia=found.inertia + 3 * where.tolerance * np.diag([0, 0, np.abs(found.inertia).max()])
        )

    monkeypatch.setattr(write, "read_back", off)
    with pytest.raises(ExportError, match="is read back with another inertia"):
        write_body(body, wanted, path)
    assert path.read_text() == "before"
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("what", ["mass", "com", "inertia"])
def test_each_parameter_is_compared(what):
    body = body_of().inertial
    refuse_changed_parameters(body, replace(body, **{what: getattr(body, what) * (1 + 5e-10)}), Format.URDF)
    with pytest.raises(ExportError, match="is read back with another"):
        refuse_changed_parameters(
            body, replace(body, **{what: getattr(body, what) * (1 + 5e-9)}), Format.URDF
        )
    with pytest.raises(ExportError, match="is read back with another"):
        refuse_changed_parameters(body, replace(body, **{what: getattr(body, what) * np.nan}), Format.URDF)


def test_file_that_the_reader_refuses_is_not_written(tmp_path):
    """MuJoCo refuses moments that no rigid body can have."""
    flat = replace(body_of().inertial, inertia=np.diag([1e-4, 1e-4, 3e-4]))
    with pytest.raises(ExportError, match="mujoco does not read what was written"):
        write_body(body_of(inertial=flat), Format.MJCF, tmp_path / "out.xml")
    assert not list(tmp_path.iterdir())


def test_usd_write_failure_is_an_os_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="usd-core could not write it"):
        write_usd(body_of(), tmp_path / "file" / "out.usda")


def test_missing_output_folder_is_named(tmp_path):
    with pytest.raises(OutputError, match="there is no folder"):
        write_body(body_of(), Format.URDF, tmp_path / "no" / "out.urdf")
