import dataclasses

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from acquire.errors import AcquireError
from acquire.virtual.bottle_shapes import BOTTLES
from acquire.virtual.contact_shape import contact_centres, inset_corners, rim_centres
from acquire.virtual.hidden import box_depth, cylinder_depth, hidden_body, sample_body
from acquire.virtual.objects import OBJECT_NAMES, load_object
from acquire.virtual.station import calibration_sheet
from schemas.session_manifest import CameraCalibrationSpec
from tests.acquire.virtual.bottle_files import bottle_mesh, stl_bytes

BORDER = (np.array([0.0, 0.0, 1.0]), 0.0)


def cuboid_inertia(mass, size):
    x, y, z = np.square(size)
    return mass / 12 * np.array([y + z, x + z, x + y])


def test_shell_of_a_box_has_the_inertia_of_a_hollow_box():
    size, wall, mass = np.array([0.08, 0.06, 0.15]), 0.0025, 0.044
    points, depths = sample_body(-size / 2, size / 2, box_depth(size / 2))
    body = hidden_body(points, depths, (mass, 0.0, 0.0), BORDER, wall)
    outer, inner = np.prod(size), np.prod(size - 2 * wall)
    density = mass / (outer - inner)
    expected = cuboid_inertia(density * outer, size) - cuboid_inertia(density * inner, size - 2 * wall)
    assert np.diag(body.inertia_com) == pytest.approx(expected, rel=2e-3)
    assert body.com_object == pytest.approx([0, 0, 0], abs=1e-4)
    assert body.mass_kg == pytest.approx(mass, rel=1e-12)


def test_centre_of_mass_of_a_cylinder_with_two_interior_halves():
    radius, height, wall = 0.036, 0.15, 0.002
    low, high = np.array([-radius, -radius, -height / 2]), np.array([radius, radius, height / 2])
    points, depths = sample_body(low, high, cylinder_depth(radius, height / 2))
    body = hidden_body(points, depths, (0.0, 0.003, 0.001), BORDER, wall)
    inner_r, inner_h = radius - wall, height - 2 * wall
    assert body.com_object == pytest.approx([0, 0, 0.5 * inner_h / 4], abs=1e-4)
    assert body.inertia_com[2, 2] == pytest.approx(0.5 * 0.004 * inner_r**2, rel=3e-3)
    about_middle = 0.004 * (inner_r**2 / 4 + inner_h**2 / 12)
    assert body.inertia_com[0, 0] == pytest.approx(about_middle - 0.004 * body.com_object[2] ** 2, rel=3e-3)


@pytest.mark.parametrize("name", OBJECT_NAMES)
def test_hidden_body_is_physical_and_within_the_shape(name):
    thing = load_object(name, 3)
    body = thing.body
    moments = np.linalg.eigvalsh(body.inertia_com)
    assert moments[0] > 0
    assert moments[2] < moments[0] + moments[1]
    assert body.mass_kg == pytest.approx(thing.spec.mass_kg, rel=1e-9)
    planes = ConvexHull(thing.hull_vertices).equations
    assert (planes[:, :3] @ body.com_object + planes[:, 3]).max() < -0.01
    assert 0.60 <= thing.friction <= 0.80


def test_seed_decides_everything_and_other_seeds_differ():
    one, again, other = load_object("carton", 1), load_object("carton", 1), load_object("carton", 2)
    assert np.array_equal(one.body.com_object, again.body.com_object)
    assert np.array_equal(one.body.inertia_com, again.body.inertia_com)
    assert one.friction == again.friction
    assert np.linalg.norm(one.body.com_object - other.body.com_object) > 1e-5
    assert sum(other.body.region_masses) == pytest.approx(0.044)
    assert other.body.region_masses == pytest.approx((0.026, 0.014, 0.004), rel=0.1)


def test_unknown_object_is_refused_with_the_names_that_exist():
    with pytest.raises(AcquireError, match="carton, spray, juice, salt"):
        load_object("brick", 1)


@pytest.mark.parametrize("name", OBJECT_NAMES)
def test_mesh_is_a_closed_body_with_outward_faces(name):
    thing = load_object(name, 1)
    mesh = trimesh.Trimesh(thing.mesh_vertices, thing.mesh_faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0
    assert mesh.is_winding_consistent


@pytest.mark.parametrize("name", sorted(BOTTLES))
def test_checked_in_stl_is_reproduced_and_read_alike_by_the_engine(name):
    thing = load_object(name, 1)
    file, data = thing.shape_file
    assert data == stl_bytes(*bottle_mesh(BOTTLES[name]), title=f"percuss {name} bottle, mm")
    asset = f'<mesh name="m" file="{file}" scale="0.001 0.001 0.001" inertia="exact"/>'
    mjcf = f"<mujoco><asset>{asset}</asset><worldbody><body><freejoint/>"
    model = mujoco.MjModel.from_xml_string(
        mjcf + '<geom type="mesh" mesh="m" density="1000"/></body></worldbody></mujoco>', {file: data}
    )
    volume = trimesh.Trimesh(thing.mesh_vertices, thing.mesh_faces).volume
    assert model.body_mass[1] == pytest.approx(1000 * volume, rel=1e-5)


def test_juice_bottle_has_about_the_volume_of_the_papers():
    thing = load_object("juice", 1)
    assert trimesh.Trimesh(thing.mesh_vertices, thing.mesh_faces).volume == pytest.approx(862.7e-6, rel=0.02)


def test_marker_ids_are_unique_over_all_objects_and_lie_on_the_surface():
    ids = []
    for name in OBJECT_NAMES:
        thing = load_object(name, 1)
        planes = ConvexHull(thing.hull_vertices).equations
        for marker in thing.spec.marker:
            ids.append(marker.id)
            T = np.array(marker.T_object_marker)
            assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3), abs=1e-6)
            assert np.linalg.det(T[:3, :3]) == pytest.approx(1, abs=1e-6)
            assert (planes[:, :3] @ T[:3, 3] + planes[:, 3]).max() == pytest.approx(0, abs=5e-5)
            out = planes[np.argmax(planes[:, :3] @ T[:3, 3] + planes[:, 3]), :3]
            assert out @ T[:3, 2] == pytest.approx(1, abs=2e-3)
    assert len(ids) == len(set(ids))


def test_only_real_corners_remain():
    assert len(load_object("carton", 1).hull_vertices) == 8


def test_rounding_balls_touch_the_true_faces():
    thing = load_object("spray", 1)
    planes = ConvexHull(thing.hull_vertices).equations
    centres = contact_centres(thing)
    support = (centres @ planes[:, :3].T + planes[:, 3]).max(axis=0)
    assert support == pytest.approx(-thing.edge_radius_m, abs=1e-7)
    cube = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    assert np.abs(inset_corners(cube, 0.1)) == pytest.approx(0.9)


def test_rim_is_round_to_a_twentieth_of_a_millimetre():
    ring = rim_centres(0.036, 0.15, 0.001)
    heading = np.linspace(0, 2 * np.pi, 1000)
    reach = (ring[:, :2] @ np.stack([np.cos(heading), np.sin(heading)])).max(axis=0) + 0.001
    assert reach == pytest.approx(0.036, abs=5e-5)


def test_calibration_sheet_is_a_camera_calibration_that_looks_along_y():
    sheet = calibration_sheet(4)
    camera = CameraCalibrationSpec.model_validate(sheet["camera"])
    T = np.array(camera.T_world_camera)
    assert T[:3, 2] == pytest.approx([0, 1, 0], abs=0.02)
    assert T[:3, 1] == pytest.approx([0, 0, -1], abs=0.02)
    assert calibration_sheet(4) == sheet
    assert calibration_sheet(5) != sheet


def test_virtual_object_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_object("salt", 1).friction = 0.1
