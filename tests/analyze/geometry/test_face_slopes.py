"""Turns at rest that the errors of a scanned face's slopes make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analyze.geometry.face_slopes import turn_covariance
from analyze.geometry.object_model import load_object_model
from analyze.planning.examine import Bench
from analyze.planning.forecast import UNLIMITED_STRIKES
from analyze.planning.impact import StrikerModel
from analyze.planning.information import ANGLE
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.stable_planes import resting_planes
from analyze.planning.view import default_camera
from analyze.reading.object_file import read_object_files
from tests.world.catalogue import make
from tests.world.object_files import Kind, write_object


def model_of(name: str, kind: Kind, seed: int, folder: Path):
    files = read_object_files(write_object(make(name, seed), kind, folder))
    return load_object_model(files.spec, files.shape_bytes, files.shape_name)


def true_turn(name: str, seed: int, up: np.ndarray) -> np.ndarray:
    """Turn (3,) [rad] from a scanned face to the true face next to it, of a box."""
    shape = make(name, seed)
    corners = shape.vertices[shape.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    normals = across / np.maximum(area, 1e-12)[:, None]
    near = normals @ -up > np.cos(np.radians(12))
    best = normals[near][np.argmax(area[near])]
    return np.cross(-up, best)


def test_a_drawing_has_exact_slopes(tmp_path: Path) -> None:
    model = model_of("gelatin_box", "cad", 1, tmp_path)
    for plane in resting_planes(model):
        assert np.array_equal(turn_covariance(model, plane.up), np.zeros((3, 3)))


@pytest.mark.parametrize(("name", "seed"), [("gelatin_box", 1), ("wallet", 1), ("tissue_box", 2)])
def test_true_faces_lie_within_the_stated_turns(name: str, seed: int, tmp_path: Path) -> None:
    """The end faces of the tissue box are no flat faces of its scan: single facets are off by 5 degrees."""
    model = model_of(name, "scan", seed, tmp_path)
    off: list[float] = []
    for plane in resting_planes(model)[:6]:
        turn = true_turn(name, seed, plane.up)
        covariance = turn_covariance(model, plane.up)
        assert covariance @ plane.up == pytest.approx(np.zeros(3), abs=1e-12)
        off += [float(turn @ axis) / np.sqrt(axis @ covariance @ axis) for axis in _level_axes(plane.up)]
    assert np.sqrt(np.mean(np.square(off))) < 1.7
    assert np.abs(off).max() < 3.0


def test_forecast_counts_with_the_turn_at_rest(tmp_path: Path) -> None:
    """Plans for scans promised the centre of mass as if their narrow faces stood upright to 0.01 degrees."""
    files = read_object_files(write_object(make("gelatin_box", 1), "scan", tmp_path))
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    bench = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION)
    information = prepare_object(model, files.spec, bench).information
    assert information.candidates
    for each in information.candidates:
        turn_sd = each.axis.turn_sd
        axis = each.axis.direction
        assert turn_sd == pytest.approx(np.sqrt(axis @ turn_covariance(model, each.axis.plane.up) @ axis))
        own = information.measurements(each, 1)[1][0, ANGLE]
        assert own == pytest.approx(np.hypot(information.errors.axis_angle, turn_sd))
    assert max(each.axis.turn_sd for each in information.candidates) > np.radians(0.5)
    # A face whose slope is hardly known leaves no negative variance, however often it is struck.
    steep = tuple(
        replace(each, axis=replace(each.axis, turn_sd=np.radians(17))) for each in information.candidates
    )
    left = information.covariance(steep, [UNLIMITED_STRIKES] * len(steep))
    assert np.diag(left)[:3].min() > 0


def _level_axes(up: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3) at right angles to `up` and to each other."""
    return np.linalg.svd(up[None])[2][1:]
