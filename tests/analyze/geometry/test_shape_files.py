"""Shape files of every format and kind of damage: read, repaired with a note, or refused in one line.

All files are generated here.
"""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
from functools import cache, partial

import laspy
import numpy as np
import pytest
import trimesh

from analyze.errors import ShapeError
from analyze.geometry import cloud_files
from tests.analyze.geometry.shapes import SIZE, box_mesh, load, mesh_bytes

MESHES = ("stl", "obj", "ply", "glb", "gltf", "3mf")
CLOUDS = ("ply", "pcd", "pcd-binary", "pcd-packed", "xyz", "las", "laz")


def box_cloud(noise=0.0, count=4000, seed=1, size=SIZE) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points, _ = trimesh.sample.sample_surface(box_mesh(size), count, seed=seed)
    return np.asarray(points) + rng.normal(0, noise, points.shape)


def pcd(points, stored="ascii") -> bytes:
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {stored}\n"
    ).encode()
    table = np.zeros(len(points), dtype=[("xyz", "<f4", 3), ("i", "u1")])
    table["xyz"] = points
    if stored == "ascii":
        return head + "\n".join(f"{x:.6f} {y:.6f} {z:.6f} 7" for x, y, z in points).encode() + b"\n"
    if stored == "binary":
        return head + table.tobytes()
    columns = (
        b"".join(np.ascontiguousarray(table["xyz"][:, i]).tobytes() for i in range(3)) + table["i"].tobytes()
    )
    # Coordinates as literals, the zero intensities as copies of one: both kinds of LZF records.
    literal = columns[: 12 * len(points) + 1]
    packed = b"".join(
        bytes([len(piece) - 1]) + piece for piece in (literal[i : i + 32] for i in range(0, len(literal), 32))
    )
    left = len(points) - 1
    while left > 0:
        length = min(left, 264)
        if left - length in (1, 2):
            length -= 3
        packed += (
            bytes([7 << 5, length - 9, 0])
            if length >= 9
            else bytes([(length - 2) << 5, 0])
            if length >= 3
            else bytes([length - 1, *[0] * length])
        )
        left -= length
    return head + struct.pack("<II", len(packed), len(columns)) + packed


def las(points, packed: bool) -> bytes:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = [1e-4] * 3
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = np.asarray(points).T
    out = io.BytesIO()
    cloud.write(out, do_compress=packed)
    return out.getvalue()


def cloud_bytes(kind: str, points) -> tuple[bytes, str]:
    if kind == "ply":
        return trimesh.PointCloud(points).export(file_type="ply"), "cloud.ply"
    if kind.startswith("pcd"):
        stored = {"pcd": "ascii", "pcd-binary": "binary", "pcd-packed": "binary_compressed"}[kind]
        return pcd(points, stored), "cloud.pcd"
    if kind == "xyz":
        lines = [f"{x:.6f}, {y:.6f}, {z:.6f}, 255" for x, y, z in points]
        return "\n".join(["x, y, z, grey", *lines, "// the end"]).encode(), "cloud.xyz"
    return las(points, kind == "laz"), f"cloud.{kind}"


@pytest.mark.parametrize("kind", MESHES)
def test_every_mesh_format_gives_the_same_body(kind):
    model = load(mesh_bytes(kind, box_mesh()), f"box.{kind}")
    assert np.allclose(model.extent, SIZE / 1000, atol=1e-7)
    assert np.isclose(model.volume, np.prod(SIZE) * 1e-9, rtol=1e-6)
    assert model.warnings == ()


@pytest.mark.parametrize("kind", CLOUDS)
def test_every_cloud_format_gives_the_same_body(kind):
    model = load(*cloud_bytes(kind, box_cloud()))
    assert np.allclose(model.extent, SIZE / 1000, atol=1e-5)
    assert np.isclose(model.volume, np.prod(SIZE) * 1e-9, rtol=1e-3)
    assert "fitted planes" in model.warnings[0]
    assert len(model.cloud.planes) == 6


@pytest.mark.parametrize("kind", ["obj", "stl"])
def test_names_and_comments_may_have_any_encoding(kind):
    mesh, message = box_mesh(), "Gehäuse, größer".encode("latin-1")
    data = (
        b"# " + message + b"\n" + mesh_bytes("obj", mesh)
        if kind == "obj"
        else message.ljust(80) + mesh_bytes("stl", mesh)[80:]
    )
    assert np.allclose(load(data, f"box.{kind}").extent, SIZE / 1000, atol=1e-7)


def test_parts_of_a_scene_are_placed():
    scene = trimesh.Scene()
    scene.add_geometry(
        box_mesh([60, 50, 100]), transform=trimesh.transformations.translation_matrix([0, 0, 50])
    )
    scene.add_geometry(
        box_mesh([60, 50, 100]), transform=trimesh.transformations.translation_matrix([0, 0, -50])
    )
    model = load(scene.export(file_type="glb"), "two.glb")
    assert np.allclose(model.extent, SIZE / 1000, atol=1e-7)
    assert np.isclose(model.volume, np.prod(SIZE) * 1e-9, rtol=1e-6)


def test_implausible_size_is_refused_with_the_likely_unit():
    bottle = trimesh.creation.cylinder(35, 200)
    with pytest.raises(
        ShapeError,
        match=r'^bottle\.stl: 70 x 70 x 200 m with unit = "m" is no object to strike .*: .*mm.*$',
    ):
        load(mesh_bytes("stl", bottle), "bottle.stl", unit="m")
    with pytest.raises(ShapeError, match=r'unit = "mm"'):
        load(*cloud_bytes("xyz", box_cloud()), unit="m")


def test_the_advised_unit_may_be_one_of_a_large_object():
    chair = box_mesh(np.array([0.53, 0.66, 0.52]))
    with pytest.raises(ShapeError, match=r'did you mean unit = "m"\?'):
        load(mesh_bytes("stl", chair), "chair.stl", unit="mm")


def test_an_implausible_density_of_a_plausible_size_asks_for_the_mass():
    """No other unit fits a box of 50 mm in inches: its size is not what is wrong."""
    with pytest.raises(ShapeError, match=r": correct mass_kg \(in kilograms\), or scale the shape"):
        load(mesh_bytes("stl", box_mesh(np.array([2.0, 1.0, 1.0]))), "box.stl", unit="in", mass=1.0)


def test_a_unit_that_contradicts_the_file_is_refused():
    with pytest.raises(ShapeError, match=r'own unit is millimeter.*correct shape.unit to "mm"'):
        load(mesh_bytes("3mf", box_mesh(SIZE / 10)), "box.3mf", unit="cm")


def test_parts_in_other_files_are_refused_with_the_remedy():
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box_mesh()))
    with pytest.raises(ShapeError, match="another file: export it as GLB"):
        load(files["model.gltf"], "box.gltf")


def test_unused_vertices_are_ignored():
    mesh = box_mesh()
    data = trimesh.Trimesh(np.vstack([mesh.vertices, [[500, 0, 0]]]), mesh.faces, process=False).export(
        file_type="ply"
    )
    assert np.allclose(load(data, "box.ply").extent, SIZE / 1000, atol=1e-7)


def test_cloud_with_a_missing_bottom_is_closed_and_reported():
    points = box_cloud(noise=0.2, count=8000)
    model = load(*cloud_bytes("ply", points[points[:, 2] > -95]))
    assert np.isclose(model.extent[2], 0.195, atol=0.002)
    assert any("closed flat: do not stand" in note for note in model.warnings)


def test_strays_are_dropped_and_hollows_reported():
    rng = np.random.default_rng(3)
    waist = trimesh.boolean.difference([box_mesh(), box_mesh([80, 30, 60], (0, 30, 0))])
    points = np.vstack(
        [trimesh.sample.sample_surface(waist, 8000, seed=1)[0], rng.uniform(-300, 300, (15, 3))]
    )
    model = load(*cloud_bytes("xyz", points))
    assert np.allclose(model.extent, SIZE / 1000, atol=1e-3)
    assert any("stray" in note for note in model.warnings)
    assert any("hollows count as filled" in note for note in model.warnings)


@pytest.mark.parametrize(("count", "half"), [(3000, 200.0), (12_000, 150.0), (6000, 60.0)])
def test_a_table_left_in_the_scan_is_refused(count, half):
    table = np.random.default_rng(1).uniform(-half, half, (count, 3)) * [1, 1, 1e-3] - [0, 0, SIZE[2] / 2]
    with pytest.raises(ShapeError, match=r"seems to contain the table: .* what stands on it: cut it off"):
        load(*cloud_bytes("xyz", np.vstack([box_cloud(noise=0.1, count=6000), table])))


@pytest.mark.parametrize("thickness", [1.5, 4.0, 20.0])
def test_thin_foot_is_not_taken_for_a_table(thickness):
    lamp = trimesh.boolean.union([box_mesh(), box_mesh([180, 160, thickness], (0, 0, -100 + thickness / 2))])
    points = np.asarray(trimesh.sample.sample_surface(lamp, 12_000, seed=1)[0])
    model = load(
        *cloud_bytes("xyz", points + np.random.default_rng(1).normal(0, 0.1, points.shape)), mass=0.2
    )
    assert model.cloud.overhang is None


def cloud_text(row: str) -> tuple[bytes, str]:
    """XYZ file of the box's cloud, each line formatted by `row`."""
    lines = [row.format(*(f"{value:.2f}" for value in point)) for point in box_cloud(count=1500)]
    return "\n".join(["x;y;z", *lines]).encode(), "cloud.xyz"


@pytest.mark.parametrize("row", ["{};{};{}", "{} {} {}", "{}; {}; {}; 128", "{}\t{}\t{}\t7\t8\t9"])
def test_decimal_commas_are_read(row):
    data, name = cloud_text(row)
    model = load(data.replace(b".", b","), name)
    assert np.allclose(model.extent, SIZE / 1000, atol=1e-4)
    assert model.warnings[0] == "cloud.xyz: its commas are read as decimal commas"


@pytest.mark.parametrize("row", ["{},{},{}", "{}, {}, {}", "{},{},{} 255 0 0", "{};{};{}", "{} , {} , {}"])
def test_commas_between_columns_are_not_decimal_commas(row):
    model = load(*cloud_text(row))
    assert np.allclose(model.extent, SIZE / 1000, atol=1e-4)
    assert "decimal" not in model.warnings[0]


def test_six_columns_of_integers_with_signs_are_columns():
    lines = ["{:.0f},{:.0f},{:.0f},9,9,9".format(*point) for point in box_cloud(count=6000)]
    assert np.allclose(load("\n".join(lines).encode(), "cloud.xyz").extent, SIZE / 1000, atol=2e-3)


@pytest.mark.parametrize("lines", ["12,5,30,1,7,9", "1.012,5;30,1;7,9", "1,012.5 30.1 7.9", "12.5,30.1;7.9"])
def test_ambiguous_commas_are_refused(lines):
    with pytest.raises(ShapeError, match=r"^cloud\.xyz: [^\n]*write numbers with decimal points"):
        load("\n".join([lines] * 300).encode(), "cloud.xyz")


def test_noise_too_large_for_the_faces_is_reported():
    prism = trimesh.creation.cylinder(25, 100, sections=6)
    points = trimesh.sample.sample_surface(prism, 3000, seed=1)[0] + np.random.default_rng(1).normal(
        0, 4, (3000, 3)
    )
    assert any(
        "too much to distinguish all faces" in note for note in load(*cloud_bytes("xyz", points)).warnings
    )


def test_declared_surface_error_is_added_to_every_edge():
    points = box_cloud(noise=1.0)
    unstated, exact, declared = (
        load(*cloud_bytes("xyz", points), **stated)
        for stated in ({}, {"surface_sd_m": 0.0}, {"surface_sd_m": 0.0007})
    )
    ends = np.array([[0.03, -0.1, -0.1], [0.03, 0.1, -0.1]])
    assert np.isclose(declared.edge_sd(ends), np.hypot(exact.edge_sd(ends), 0.0007))
    assert np.isclose(unstated.edge_sd(ends), np.hypot(exact.edge_sd(ends), exact.noise_sd))
    assert any("declare shape.surface_sd_m" in note for note in unstated.warnings)
    assert not any("declare shape.surface_sd_m" in note for note in exact.warnings)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    way = rng.integers(4)
    if way == 0:
        return data[: rng.integers(len(data))]
    broken = bytearray(data)
    if way == 1:
        for at in rng.integers(0, len(data), rng.integers(1, 20)):
            broken[at] = rng.integers(256)
    elif way == 2:
        # In the header, where the counts are.
        for at in rng.integers(0, min(len(data), 400), 4):
            broken[at] = rng.choice(list(b"9 \n\xff\x000"))
    else:
        start = int(rng.integers(len(data)))
        broken[start : start + int(rng.integers(1, 200))] = b""
    return bytes(broken)


def refusal(act) -> str:
    """Message of the ShapeError that `act` raises; empty if it raises none."""
    try:
        act()
    except ShapeError as error:
        return str(error)
    return ""


@cache
def samples() -> dict[str, bytes]:
    mesh, points = box_mesh(), box_cloud(count=600)
    found = {f"box.{kind}": mesh_bytes(kind, mesh) for kind in MESHES}
    found |= {f"{kind}-{name}": data for kind in CLOUDS for data, name in [cloud_bytes(kind, points)]}
    text = trimesh.Trimesh(mesh.vertices, mesh.faces).export(file_type="ply", encoding="ascii")
    return found | {"text.ply": text, "text.stl": mesh.export(file_type="stl_ascii").encode()}


@pytest.mark.parametrize("name", sorted(samples()))
def test_damaged_files_are_read_or_refused_in_one_line_with_little_memory(name, capfd):
    """Files cut short, corrupted or with wrong counts; nothing is printed."""
    data = samples()[name]
    rng = np.random.default_rng(sum(name.encode()))
    cloud = "cloud." in name
    take = partial(cloud_files.read_cloud, name=name, suffix=name[-3:]) if cloud else partial(load, name=name)
    tracemalloc.start()
    try:
        for _ in range(25):
            message = refusal(partial(take, damaged(data, rng)))
            assert "\n" not in message
            assert not message or message.startswith((name, "thing"))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 300e6
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err == ""


@pytest.mark.parametrize("seed", range(6))
def test_readable_but_damaged_clouds_are_modelled_or_refused(seed):
    rng = np.random.default_rng(seed)
    points = box_cloud(count=600).astype(np.float32)
    points[rng.integers(600, size=60), rng.integers(3, size=60)] = rng.choice([0.0, np.nan, 1e-30, -3e4], 60)
    points[:, 0] *= rng.choice([0.0, 1e-6, 1.0])
    assert "\n" not in refusal(partial(load, *cloud_bytes("pcd-binary", points)))


def test_zip_bomb_is_refused():
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"0" * 60_000_000)
    with pytest.raises(ShapeError, match="unpacks to 60 MB"):
        load(out.getvalue(), "bomb.3mf")
