"""Plans for a hand and a phone: the phone stands where its lens shows the whole object."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.geometry.object_model import load_object_model
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.view import default_camera
from analyze.reading.object_file import read_object_files
from analyze.verbs.plan.phone import phone_bench
from tests.places import OBJECTS


def corners_px(model, camera, R_world_object, angle):
    """Pixels (8, 2) of a box's corners, turned by an angle about the edge that it tips over."""
    half = model.extent / 2
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half @ R_world_object.T
    box -= [box[:, 0].max(), 0.0, box[:, 2].min()]
    c, s = np.cos(angle), np.sin(angle)
    box = box @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    R, p = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    seen = (box - p) @ R @ camera.K.T
    return seen[:, :2] / seen[:, 2:]


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_phone_stands_where_its_lens_shows_the_object_tipping_on_any_face(tmp_path, scale):
    files = read_object_files(OBJECTS / "carton.toml")
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    lens = tmp_path / "camera.toml"
    lens.write_text(
        f"[camera.calibration]\nwidth = {1280 * scale}\nheight = {720 * scale}\n"
        f"K = [[{1100 * scale}, 0, {640 * scale}], [0, {1100 * scale}, {360 * scale}], [0, 0, 1]]\n".replace(
            ".0\n", "\n"
        )
    )
    bench = phone_bench(lens, model, Bench(StrikerModel(), default_camera(), 0.4))
    size = np.array([bench.camera.width, bench.camera.height])
    spans = []
    for order in ([0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 0, 1], [1, 2, 0], [2, 1, 0]):
        R = np.eye(3)[order]
        pixels = np.vstack([corners_px(model, bench.camera, R, angle) for angle in (0.0, 0.5, 0.9)])
        assert np.all((pixels > 0) & (pixels < size))
        spans.append(np.ptp(pixels, axis=0) / size)
    assert np.max(spans) > 0.6
