"""Object file and shape file are read together, and a missing one is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyze.errors import ShapeError
from analyze.geometry.object_model import load_object_model
from analyze.reading.object_file import read_object_files
from tests.analyze.geometry.shapes import box_triangles, stl

OBJECT = """\
name = "b"
mass_kg = 0.05
mass_sd_kg = 0.0001
shape = { file = "b.stl", unit = "mm" }
[[marker]]
id = 1
size_m = 0.03
"""


def test_object_file_is_read_with_its_shape_file(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text(OBJECT)
    with pytest.raises(ShapeError, match=r"b\.stl: no such shape file"):
        read_object_files(tmp_path / "b.toml")
    (tmp_path / "b.stl").write_bytes(stl(box_triangles([60.0, 50.0, 200.0])))
    files = read_object_files(tmp_path / "b.toml")
    assert load_object_model(files.spec, files.shape_bytes, files.shape_name).name == "b"


def test_a_missing_object_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match=r"c\.toml: no such file"):
        read_object_files(tmp_path / "c.toml")


def test_an_object_needs_no_marker(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text(OBJECT.partition("[[marker]]")[0])
    (tmp_path / "b.stl").write_bytes(stl(box_triangles([60.0, 50.0, 200.0])))
    assert read_object_files(tmp_path / "b.toml").spec.marker == []


def test_a_shape_file_in_place_of_the_object_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "b.stl").write_bytes(stl(box_triangles([60.0, 50.0, 200.0])))
    with pytest.raises(ShapeError, match=r'is a shape file, not an object file: .* file = "b\.stl"'):
        read_object_files(tmp_path / "b.stl")


def test_a_line_that_is_not_toml_is_quoted(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text(OBJECT.replace('"b.stl", unit', '"b.stl" unit'))
    with pytest.raises(
        ShapeError, match=r'not valid TOML: .* correct this line: shape = { file = "b.stl" unit'
    ):
        read_object_files(tmp_path / "b.toml")
