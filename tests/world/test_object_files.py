"""Object files of world shapes: scans lie within their noise, pieces cover the body and are convex."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from schemas.object_spec import parse_object_spec
from tests.world.catalogue import make
from tests.world.object_files import KINDS, write_object
from tests.world.pieces import convex_pieces
from tests.world.scans import fused, scan


def test_a_scan_lies_within_its_noise():
    """The scan of a box: even triangles, 0.5 mm of noise, its holes and base as stated."""
    shape = make("pudding_box", 1)
    vertices, faces = fused(shape, 2.0)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight
    surface = np.asarray(shape.solid.refine_to_length(0.8).to_mesh().vert_properties[:, :3], float)
    assert np.percentile(cKDTree(surface).query(vertices)[0], 95) < 0.7
    found = scan(shape, 3)
    distance = cKDTree(surface).query(found.vertices)[0]
    assert 0.3 < np.sqrt(np.mean(distance**2)) < 0.9
    assert not found.has_bottom or found.holes


def test_pieces_are_convex_and_cover_the_body():
    shape = make("pencil_cup", 1)
    pieces = convex_pieces(shape)
    assert 4 < len(pieces) <= 20
    union = pieces[0]
    for piece in pieces:
        assert piece.hull().volume() < 1.002 * piece.volume()
        union += piece
    assert (shape.solid - union).volume() < 0.002 * shape.solid.volume()
    assert union.volume() < 0.8 * shape.solid.hull().volume()


@pytest.mark.parametrize("kind", KINDS)
def test_object_files_can_be_read(tmp_path, kind):
    """Object file and shape file agree in size, whatever unit and format the shape has."""
    shape = make("soap_bar", 2)
    path = write_object(shape, kind, tmp_path, tags_placed=kind == "cad")
    spec = parse_object_spec(path.read_text(), path.name)
    assert spec.shape.file is not None
    assert spec.shape.unit is not None
    mesh = trimesh.load(tmp_path / spec.shape.file, force="mesh")
    scale = {"mm": 1.0, "m": 1000.0}[spec.shape.unit.value]
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0) * scale, shape.size_mm, atol=5)
    assert len(spec.marker) == 6
