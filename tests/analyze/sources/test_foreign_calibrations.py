"""Calibrations of other programs: the same camera in every notation; unusable ones give one line."""

from __future__ import annotations

import contextlib
import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analyze.cameras.calibration_toml import toml_entries
from analyze.cameras.camera_file import read_camera
from analyze.errors import CalibrationError
from analyze.sources.foreign_calibrations import parse_calibration
from analyze.tracking.camera_model import UNSTATED_STRAIN_SD, camera_from_spec, distort, undistort
from schemas.document import DocumentError
from schemas.session_manifest import LensModel

K = [[1430.5, 0.0, 960.25], [0.0, 1429.0, 541.5], [0.0, 0.0, 1.0]]
BENT = [-0.12, 0.05, 3e-4, -2e-4, 0.011]
FISHEYE = [0.03, -0.004, 0.001, -0.0002]
RATIONAL = [0.4, -0.1, 1e-4, 2e-4, 0.02, 0.7, -0.05, 0.03]

CAMERA_INFO = f"""
image_width: 1920
image_height: 1080
camera_name: narrow_stereo
camera_matrix: {{rows: 3, cols: 3, data: [1430.5, 0, 960.25, 0, 1429.0, 541.5, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: {BENT}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [1400, 0, 960, 0, 0, 1400, 540, 0, 0, 0, 1, 0]}}
"""
KALIBR = f"""
cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: {FISHEYE}
  distortion_model: equidistant
  intrinsics: [1430.5, 1429.0, 960.25, 541.5]
  resolution: [1920, 1080]
  rostopic: /cam0/image_raw
"""
ECHOED = {
    "height": 1080,
    "width": 1920,
    "distortion_model": "rational_polynomial",
    "d": RATIONAL,
    "k": np.ravel(K).tolist(),
}
PYTHONS = {"camera_matrix": K, "dist_coeffs": [BENT], "image_size": [1920, 1080], "rms": 0.3}


def by_opencv(path, fisheye=False):
    """Calibration file as OpenCV's own sample program writes it."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Sun Nov  1 10:00:00 2026")
    storage.write("image_width", 1920)
    storage.write("image_height", 1080)
    storage.write("fisheye_model", int(fisheye))
    storage.write("camera_matrix", np.array(K))
    storage.write("distortion_coefficients", np.array([FISHEYE if fisheye else BENT]).T)
    storage.release()
    return path


def spec_of(text, **options):
    return parse_calibration(text.encode(), "lens", **options)[0]


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".json"])
@pytest.mark.parametrize("fisheye", [False, True])
def test_calibration_files_written_by_opencv(tmp_path, suffix, fisheye):
    found = read_camera(by_opencv(tmp_path / f"lens{suffix}", fisheye))
    spec = found.calibration
    assert (spec.model is LensModel.FISHEYE) == fisheye
    assert (spec.width, spec.height, spec.K, found.placed) == (1920, 1080, K, False)
    assert spec.distortion == (FISHEYE if fisheye else BENT)


def test_old_opencv_file_with_yaml_directive(tmp_path):
    path = by_opencv(tmp_path / "lens.yml")
    old = (
        path.read_text()
        .replace("%YAML 1.2", "%YAML:1.0")
        .replace("camera_matrix", "Camera_Matrix")
        .replace("image_width", "image_Width")
    )
    assert spec_of(old).K == K


@pytest.mark.parametrize(
    ("text", "model", "distortion"),
    [
        (CAMERA_INFO, LensModel.PINHOLE, BENT),
        (KALIBR, LensModel.FISHEYE, FISHEYE),
        (KALIBR.replace("equidistant", "radtan"), LensModel.PINHOLE, [*FISHEYE, 0.0]),
        (KALIBR.replace("equidistant", "none").replace(str(FISHEYE), "[]"), LensModel.PINHOLE, [0.0] * 5),
        (json.dumps(PYTHONS), LensModel.PINHOLE, BENT),
        (json.dumps(ECHOED), LensModel.PINHOLE, RATIONAL),
        (CAMERA_INFO + "\n---\n", LensModel.PINHOLE, BENT),
        (CAMERA_INFO + "\n---\n" + CAMERA_INFO + "\n---\n", LensModel.PINHOLE, BENT),
    ],
)
def test_one_camera_in_every_notation(text, model, distortion):
    spec = spec_of(text)
    assert (spec.model, spec.K, spec.width, spec.height, spec.distortion) == (
        model,
        K,
        1920,
        1080,
        distortion,
    )
    camera = camera_from_spec(spec)
    inside = np.array([[300.0, 200.0], [960.0, 540.0], [1500.0, 900.0]])
    assert np.abs(distort(camera, undistort(camera, inside)) - inside).max() < 1e-3


def test_pose_and_line_time_may_be_added():
    place = np.diag([1.0, -1.0, -1.0, 1.0]).tolist()
    spec, placed = parse_calibration(
        json.dumps(PYTHONS | {"T_world_camera": place, "line_time_s": 9.3e-6}).encode(), "lens", as_json=True
    )
    assert placed
    assert (spec.T_world_camera, spec.line_time_s) == (place, 9.3e-6)
    assert camera_from_spec(spec).line_time_s == 9.3e-6
    assert "line_time_s" in spec.model_dump(mode="json")
    assert "line_time_s" not in spec_of(json.dumps(PYTHONS)).model_dump(mode="json")


def test_pose_and_line_time_may_be_beside_kalibrs_camera():
    place = np.diag([1.0, -1.0, -1.0, 1.0]).tolist()
    spec, placed = parse_calibration(
        f"{KALIBR}\nT_world_camera: {place}\nline_time_s: 9.3e-6\n".encode(), "lens"
    )
    assert placed
    assert (spec.T_world_camera, spec.line_time_s) == (place, 9.3e-6)


@pytest.mark.parametrize("suffix", [".xml", ".txt"])
def test_other_calibration_formats_are_refused_with_the_supported_ones(tmp_path, suffix):
    path = tmp_path / f"lens{suffix}"
    path.write_text("<opencv_storage/>")
    with pytest.raises(CalibrationError, match=f"{suffix} is not read: save the calibration as YAML or JSON"):
        read_camera(path)


def without(entries, *names):
    return json.dumps({key: value for key, value in entries.items() if key not in names})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (without(PYTHONS, "image_size"), "lens: contains no image size: add image_width and image_height"),
        (without(PYTHONS, "camera_matrix"), "lens: contains no camera matrix"),
        (
            json.dumps(PYTHONS | {"image_size": [640, 480]}),
            r"lens: the principal point \(960, 542\) lies outside the image of 640 x 480 px",
        ),
        (json.dumps(PYTHONS | {"image_size": [1920.5, 1080]}), "lens: its image size is not valid"),
        (
            json.dumps(PYTHONS | {"camera_matrix": [K[0], K[1], [0, 0, 2]]}),
            "lens: its camera matrix is not valid",
        ),
        (
            json.dumps(PYTHONS | {"camera_matrix": [[1430, 5, 960], K[1], K[2]]}),
            "lens: its camera matrix has a skew of 5 px",
        ),
        (json.dumps(PYTHONS | {"camera_matrix": "big"}), "lens: the camera matrix has 0 numbers, not 4 or 9"),
        (
            json.dumps(PYTHONS | {"dist_coeffs": [0.1, "x", 0, 0]}),
            "lens: the distortion contains 'x', which is not a number",
        ),
        (
            json.dumps(PYTHONS | {"dist_coeffs": [0.1] * 12}),
            r"lens: 12 coefficients \(thin prism or tilted sensor\) are not supported",
        ),
        (
            json.dumps(PYTHONS | {"distortion_model": "equidistant"}),
            "lens: a fisheye has 4 coefficients k1, k2, k3, k4, not 5",
        ),
        (KALIBR.replace("equidistant", "fov"), "lens: distortion model 'fov' is not supported: plumb_bob"),
        (
            KALIBR.replace("pinhole", "omni"),
            "lens: camera model 'omni' is not supported: calibrate as pinhole",
        ),
        (
            KALIBR + KALIBR.replace("cam0", "cam1"),
            r"lens: contains 2 cameras \(cam0, cam1\): keep only the one that took",
        ),
        ("just words", "lens: contains no camera calibration"),
        ("a: [1, 2", "lens: is not valid YAML"),
        ("a: !!python/object/apply:os.system ['true']", "lens: is not valid YAML"),
        ("[" * 1_000, "lens: is not valid YAML"),
        ("x" * (1 << 21), "lens: 2.1 MB is too large for a camera calibration"),
    ],
)
def test_unusable_calibration_is_one_line(text, said):
    with pytest.raises(CalibrationError, match=f"^{said}") as caught:
        parse_calibration(text.encode(), "lens")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "entries", [{"line_time_s": 0.5}, {"line_time_s": "fast"}, {"T_world_camera": np.zeros((4, 4)).tolist()}]
)
def test_invalid_pose_or_line_time_is_named(entries):
    with pytest.raises(DocumentError, match=f"^lens: {next(iter(entries))}"):
        parse_calibration(json.dumps(PYTHONS | entries).encode(), "lens")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(CalibrationError, match="no such camera file: check the path"):
        read_camera(tmp_path / "lens.yaml")


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=10)
        | st.dictionaries(st.sampled_from(["data", "rows", "cam0", "K"]), inner, max_size=3)
    ),
    max_leaves=10,
)
NAMES = [
    "camera_matrix",
    "K",
    "d",
    "dist_coeffs",
    "image_width",
    "image_height",
    "resolution",
    "distortion_model",
    "camera_model",
    "cam0",
    "calibration",
]
TEXTS = (
    st.dictionaries(st.sampled_from([*NAMES, "T_world_camera", "line_time_s"]), VALUES, max_size=6).map(
        lambda drawn: json.dumps(PYTHONS | drawn)
    )
    | st.tuples(st.sampled_from([CAMERA_INFO, KALIBR]), st.integers(0, 500), st.text(max_size=3)).map(
        lambda t: t[0][: t[1]] + t[2] + t[0][t[1] :]
    )
    | st.text(max_size=40)
)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    data=TEXTS.map(lambda text: text.encode("utf-8", "surrogatepass")) | st.binary(max_size=60),
    as_json=st.booleans(),
)
def test_any_content_is_a_lens_or_one_line(data, as_json):
    with contextlib.suppress(CalibrationError, DocumentError):
        camera_from_spec(parse_calibration(data, "lens", as_json=as_json)[0])


def test_strain_is_that_of_the_file_or_that_of_a_usual_calibration():
    stated = parse_calibration(json.dumps(PYTHONS | {"strain_sd": 3e-4}).encode(), "lens")[0]
    assert camera_from_spec(stated).strain_sd == 3e-4
    assert "strain_sd" not in spec_of(json.dumps(PYTHONS)).model_dump(mode="json")
    assert camera_from_spec(spec_of(json.dumps(PYTHONS))).strain_sd == UNSTATED_STRAIN_SD


def test_new_calibration_keeps_the_line_time():
    calibration = parse_calibration(json.dumps(PYTHONS | {"line_time_s": 9.3e-6}).encode(), "lens")[0]
    lens = SimpleNamespace(
        model=LensModel.PINHOLE, width=1920, height=1080, camera_matrix=np.array(K), distortion=np.array(BENT)
    )
    rig = SimpleNamespace(camera=SimpleNamespace(calibration=calibration))
    found = SimpleNamespace(lens=lens, rms_px=0.1, strain_sd=2.34e-4)
    answer = SimpleNamespace(calibration=found, world_camera=None, rig=rig)
    assert toml_entries(answer)["strain_sd"] == "2.3e-04"
    assert toml_entries(answer)["line_time_s"] == "9.3e-06"
    answer.rig = None
    assert "line_time_s" not in toml_entries(answer)
