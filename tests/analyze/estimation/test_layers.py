"""Labelled layers of an object: together they have its volume."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.estimation.cells import cells_from_voxels
from analyze.estimation.labelled_parts import REST, parts_of_cells
from analyze.geometry.object_model import load_object_model
from analyze.geometry.voxels import voxelise
from schemas.object_spec import Box, Cylinder, MarkerSpec, ObjectSpec, Shape
from schemas.part_label import PartLabel

WALL = 0.002
TURN = trimesh.transformations.rotation_matrix(0.5, [1, 0.5, 0.2])


def turned_box() -> bytes:
    box = trimesh.creation.box((0.0737, 0.0613, 0.1511))
    box.apply_transform(TURN)
    return bytes(box.export(file_type="stl"))


def parts(shape, data, along, inset, middle=0.4, gap=0.0):
    """Wall and two layers from end to end, `inset` from the object's ends; model; volume of a cell layer."""
    spec = ObjectSpec(
        name="object", mass_kg=0.1, mass_sd_kg=1e-4, shape=shape, marker=[MarkerSpec(id=0, size_m=0.02)]
    )
    model = load_object_model(spec, data, "object.stl")
    height = model.hull_vertices @ along
    pitch = (model.volume / 4000) ** (1 / 3)
    low, high = float(height.min()) + inset, float(height.max()) - inset
    cut = low + middle * (high - low)
    labels = [
        PartLabel(name="wall", wall=True),
        PartLabel(name="low", between_m=[low, cut], along=along.tolist()),
        PartLabel(name="high", between_m=[cut + gap, high], along=along.tolist()),
    ]
    cells = cells_from_voxels(voxelise(model, pitch, WALL))
    return dict(parts_of_cells(labels, cells, "object")), model, pitch * model.volume / np.ptp(height)


@pytest.mark.parametrize("inset", [0.0, WALL], ids=["ends of the object", "ends of its inside"])
@pytest.mark.parametrize(
    ("shape", "data", "along"),
    [
        (Shape(box=Box(size_m=[0.0737, 0.0613, 0.1511])), None, np.array([0.0, 0.0, 1.0])),
        (Shape(cylinder=Cylinder(radius_m=0.0333, height_m=0.117)), None, np.array([0.0, 0.0, 1.0])),
        (Shape(file="object.stl", unit="m"), turned_box(), TURN[:3, 2]),
    ],
    ids=["box", "cylinder", "turned box"],
)
def test_layers_from_end_to_end_leave_no_rest(shape, data, along, inset):
    """Up to 0.17 of a layer of cells was once counted as `rest`, which could be 49 g of lead."""
    found, model, layer = parts(shape, data, along, inset)
    assert list(found) == ["wall", "low", "high"]
    missing = model.volume - sum(part.volume for part in found.values())
    turned = data is not None
    assert abs(missing) < (0.07 if turned and inset else 0.01) * layer


def test_a_gap_between_layers_is_the_rest():
    shape, gap = Shape(box=Box(size_m=[0.0737, 0.0613, 0.1511])), 0.004
    found, model, _ = parts(shape, None, np.array([0.0, 0.0, 1.0]), 0.0, gap=gap)
    inside = (0.0737 - 2 * WALL) * (0.0613 - 2 * WALL)
    assert found[REST].volume == pytest.approx(inside * gap, rel=0.05)
    assert sum(part.volume for part in found.values()) == pytest.approx(model.volume, rel=1e-6)
