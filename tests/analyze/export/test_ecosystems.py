"""ROS messages, Gazebo model folders and friction, loaded by the libraries of their own ecosystems."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
import rod
import yaml
from resolve_robotics_uri_py import resolve_robotics_uri
from rosbags.typesys import Stores, get_typestore

from analyze.errors import ExportError
from analyze.export.body import Inertial
from analyze.export.export_source import stated_friction
from analyze.export.formats import Format, why_misnamed
from analyze.export.mesh import mesh_file
from analyze.export.read_back import read_back
from analyze.export.ros import ros_text
from analyze.export.write import refuse_changed_parameters, write_body
from schemas.output_file import OutputError
from tests.analyze.export.bodies import HOSTILE, SHAPES, body_of

TINY = Inertial(2e-5, np.array([1e-05, -2e-07, 0.0]), np.diag([1e-16, 1e-10, 1e-10]))
"""parameters whose shortest texts, such as 1e-05, have no decimal point"""


@pytest.mark.parametrize("store", [Stores.ROS2_FOXY, Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_ros_message_is_that_of_every_ros_2(store, tmp_path):
    """PyYAML reads the file as ROS's own tools do, and the definitions of each release serialise it."""
    body = body_of("mesh", "tea box", TINY)
    write_body(body, Format.ROS, tmp_path / "out.yaml")
    content = yaml.safe_load((tmp_path / "out.yaml").read_text())
    types = get_typestore(store)
    header, inertia = content["header"], content["inertia"]
    assert header["frame_id"] == "tea_box"
    stamp = types.types["builtin_interfaces/msg/Time"](**header["stamp"])
    vector = types.types["geometry_msgs/msg/Vector3"](**inertia["com"])
    own = types.types["geometry_msgs/msg/Inertia"](**{**inertia, "com": vector})
    head = types.types["std_msgs/msg/Header"](stamp=stamp, frame_id=header["frame_id"])
    kind = "geometry_msgs/msg/InertiaStamped"
    data = types.serialize_cdr(types.types[kind](header=head, inertia=own), kind)
    found = types.deserialize_cdr(data, kind).inertia
    assert (found.m, found.com.x, found.com.y, found.ixx) == (2e-5, 1e-5, -2e-7, 1e-16)


def test_ros_message_as_json_has_the_same_content(tmp_path):
    body = body_of(name=HOSTILE)
    assert json.loads(ros_text(body, as_json=True)) == yaml.safe_load(ros_text(body, as_json=False))
    write_body(body, Format.ROS, tmp_path / "out.json")
    refuse_changed_parameters(body.inertial, read_back(tmp_path / "out.json", Format.ROS), Format.ROS)


@pytest.mark.parametrize("name", ["yes", "null", "on"])
def test_frame_that_yaml_would_take_for_something_else_stays_a_text(name):
    assert yaml.safe_load(ros_text(body_of(name=name), as_json=False))["header"]["frame_id"] == name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("header: {frame_id: a}", "has the fields header, inertia, not header"),
        ("{}", "has the fields"),
    ],
)
def test_ros_message_with_other_fields_is_refused(text, message, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ExportError, match=f"rosbags does not read what was written: .*{message}"):
        read_back(path, Format.ROS)


@pytest.mark.parametrize("shape", SHAPES)
def test_gazebo_model_is_found_and_loaded_by_its_address(shape, tmp_path, monkeypatch):
    """As in Gazebo: the folder's parent is a resource path, and addresses lead to its files."""
    body = body_of(shape, "tea & box")
    folder = tmp_path / "tea_box"
    written = write_body(body, Format.GAZEBO, folder)
    config = ET.parse(folder / "model.config").getroot()
    assert config.findtext("name") == "tea_box"
    assert (config.find("sdf").text, config.find("sdf").get("version")) == ("model.sdf", "1.7")
    monkeypatch.setitem(os.environ, "GZ_SIM_RESOURCE_PATH", str(tmp_path))
    model = rod.Sdf.load(resolve_robotics_uri("model://tea_box/model.sdf"), is_urdf=False).models()[0]
    own = model.links()[0].inertial
    np.testing.assert_allclose(own.inertia.matrix(), body.inertial.inertia, rtol=1e-12)
    mesh = mesh_file(body)
    assert written == [folder, *([] if mesh is None else [folder / "meshes" / mesh.name])]
    if mesh is not None:
        uri = model.links()[0].collisions()[0].geometry.mesh.uri
        assert Path(resolve_robotics_uri(uri)).read_bytes() == mesh.data
    refuse_changed_parameters(body.inertial, read_back(folder, Format.GAZEBO), Format.GAZEBO)
    assert [each.name for each in tmp_path.iterdir()] == ["tea_box"]


def test_gazebo_model_is_replaced_but_other_folders_are_not(tmp_path):
    folder = tmp_path / "thing"
    write_body(body_of("mesh"), Format.GAZEBO, folder)
    heavy = body_of("box", inertial=replace(body_of().inertial, mass=2.5))
    assert write_body(heavy, Format.GAZEBO, folder) == [folder]
    assert read_back(folder, Format.GAZEBO).mass == 2.5
    other = tmp_path / "photos"
    other.mkdir()
    (other / "a.jpg").write_bytes(b"")
    with pytest.raises(OutputError, match=r"holds other files, and no model\.config: name a new folder"):
        write_body(heavy, Format.GAZEBO, other)
    with pytest.raises(OutputError, match="is a file: name a folder"):
        write_body(heavy, Format.GAZEBO, other / "a.jpg")
    with pytest.raises(OutputError, match="create it first"):
        write_body(heavy, Format.GAZEBO, tmp_path / "no" / "thing")


def test_gazebo_model_without_its_mesh_is_refused(tmp_path):
    folder = tmp_path / "thing"
    mesh = write_body(body_of("mesh"), Format.GAZEBO, folder)[1]
    mesh.unlink()
    with pytest.raises(ExportError, match="is not beside it"):
        read_back(folder, Format.GAZEBO)


@pytest.mark.parametrize(
    ("name", "wanted", "reason"),
    [
        ("tea.txt", Format.ROS, "name it tea.yaml"),
        ("tea", Format.ROS, "name it tea.yaml"),
        ("tea.json", Format.URDF, "belongs to ROS"),
        ("tea box.sdf", Format.GAZEBO, "name it tea_box"),
    ],
)
def test_wrong_names_are_refused_with_a_right_one(name, wanted, reason):
    assert reason in why_misnamed(Path(name), wanted)
    assert why_misnamed(Path("tea"), Format.GAZEBO) is None
    assert why_misnamed(Path("tea.json"), Format.ROS) is None


def test_known_friction_reaches_mujoco_and_sdf(tmp_path):
    body = replace(body_of(), friction=0.63)
    write_body(body, Format.MJCF, tmp_path / "out.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    plain = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    np.testing.assert_allclose(model.geom("thing_collision").friction, [0.63, *plain.geom_friction[0, 1:]])
    write_body(body, Format.SDF, tmp_path / "out.sdf")
    assert read_back(tmp_path / "out.sdf", Format.SDF).mass == body.inertial.mass
    ode = ET.parse(tmp_path / "out.sdf").getroot().find("model/link/collision/surface/friction/ode")
    assert [float(each.text) for each in ode] == [0.63, 0.63]
    write_body(body_of(), Format.MJCF, tmp_path / "unknown.xml")
    assert "friction" not in (tmp_path / "unknown.xml").read_text()


@pytest.mark.parametrize(
    ("rigs", "friction"),
    [
        ([], None),
        ([None, "name = 'a'"], None),
        (["table_friction = 0.4", None, "table_friction = 0.6"], 0.6),
        (["table_friction = 'x'", "= broken"], None),
    ],
)
def test_friction_is_known_only_if_a_rig_file_states_it(rigs, friction):
    assert stated_friction(rigs) == friction
