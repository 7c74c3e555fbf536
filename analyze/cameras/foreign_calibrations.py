"""Lenses as other programs write them down: OpenCV (YAML, JSON), Kalibr, ROS camera_info; each becomes our CameraCalibrationSpec.

They name the same numbers differently: names are compared without case, underscores and dashes. A matrix may be nested lists or
`data` beside `rows` and `cols`. Nothing in such a file is run: YAML is read with the safe constructors and OpenCV's one matrix type.
"""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode

from analyze.errors import CalibrationError
from analyze.types import Array
from schemas.document import validate
from schemas.session_manifest import CameraCalibrationSpec, LensModel

SUFFIXES = (".yaml", ".yml", ".json")
MOST_BYTES = 1 << 20
"""of a calibration; a file that is larger is something else"""

_MODELS = {
    **dict.fromkeys(
        ("plumbbob", "radtan", "radialtangential", "rationalpolynomial", "brownconrady", "pinhole", "opencv"), LensModel.PINHOLE
    ),
    **dict.fromkeys(("equidistant", "fisheye", "kannalabrandt", "kannalabrandt4", "kb4", "opencvfisheye"), LensModel.FISHEYE),
}
_READ = "plumb_bob (radtan), rational_polynomial and equidistant (fisheye) are"
_CAMERA_MATRIX = ("cameramatrix", "intrinsicmatrix", "intrinsics", "mtx", "k")
_DISTORTION = (
    "distortioncoefficients",
    "distortioncoeffs",
    "distcoeffs",
    "distcoefficients",
    "distcoeff",
    "distcoefs",
    "distortion",
    "dist",
    "d",
)
_WIDTH, _HEIGHT = ("imagewidth", "width"), ("imageheight", "height")
_ADDED = ("tworldcamera", "linetimes")
_SIZE = ("resolution", "imagesize", "imgsize")


def read_calibration(path: Path) -> tuple[CameraCalibrationSpec, bool]:
    """The lens of a camera file of another program, and whether it says where the camera stands.

    Beside the program's own entries the file may hold `T_world_camera` (4 x 4) and `line_time_s`. Without the first it is the unit matrix.

    Raises:
        CalibrationError: the file cannot be read, or holds no lens of a kind that is known.
        DocumentError: an entry cannot be used.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise CalibrationError(f"{path}: no such camera file: check the path") from None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    return parse_calibration(data, str(path), as_json=path.suffix.lower() == ".json")


def parse_calibration(data: bytes, name: str, *, as_json: bool = False) -> tuple[CameraCalibrationSpec, bool]:
    """`read_calibration` of a file's content; messages begin with `name`."""
    if len(data) > MOST_BYTES:
        raise CalibrationError(
            f"{name}: {len(data) / 1e6:.1f} MB is no camera calibration: give the file that holds camera matrix and distortion"
        )
    kind = "JSON" if as_json else "YAML"
    try:
        text = data.decode("utf-8-sig")
        found = json.loads(text) if as_json else _yaml(text)
    except (ValueError, RecursionError, YAMLError):
        raise CalibrationError(f"{name}: is not valid {kind}: give a calibration of OpenCV, Kalibr or ROS, or a rig file (.toml)") from None
    except (TypeError, AttributeError, KeyError, IndexError, OverflowError, ArithmeticError):  # what a YAML reader makes of nonsense
        raise CalibrationError(f"{name}: is not valid {kind}: give a calibration of OpenCV, Kalibr or ROS, or a rig file (.toml)") from None
    return calibration_of(_one_camera(found, name), name)


def calibration_of(entries: Mapping[str, Any], name: str) -> tuple[CameraCalibrationSpec, bool]:
    """One camera's entries, under whatever names, as our calibration.

    Raises:
        CalibrationError: they hold no lens of a kind that is known.
        DocumentError: an entry cannot be used.
    """
    K = _camera_matrix(entries, name)
    width, height = _size(entries, name)
    if not (0.0 < K[0, 2] < width and 0.0 < K[1, 2] < height):
        raise CalibrationError(
            f"{name}: the middle ({K[0, 2]:.0f}, {K[1, 2]:.0f}) lies outside its image of {width} x {height} px: its numbers are of "
            "another image size"
        )
    model = _model(entries, name)
    place = _first(entries, _ADDED[:1])
    spec: dict[str, Any] = {
        "model": model.value,
        "width": width,
        "height": height,
        "K": K.tolist(),
        "distortion": _coefficients(entries, model, name),
        "T_world_camera": np.eye(4).tolist() if place is None else _numbers(place, name, "T_world_camera", (16,)).reshape(4, 4).tolist(),
    }
    line_time = _first(entries, _ADDED[1:])
    if line_time is not None:
        spec["line_time_s"] = line_time
    return validate(CameraCalibrationSpec, spec, name), place is not None


# --- entries ------------------------------------------------------------------------------------------------------


def _camera_matrix(entries: Mapping[str, Any], name: str) -> Array:
    """(3, 3); of four numbers (Kalibr) fx, fy, cx, cy."""
    found = _first(entries, _CAMERA_MATRIX)
    if found is None:
        raise CalibrationError(
            f"{name}: holds no camera matrix (camera_matrix, K or intrinsics): give a calibration of OpenCV, Kalibr or ROS"
        )
    values = _numbers(found, name, "the camera matrix", (4, 9))
    K = np.eye(3)
    if len(values) == 4:
        K[0, 0], K[1, 1], K[0, 2], K[1, 2] = values
    else:
        K = values.reshape(3, 3)
    if not (K[0, 0] > 0 and K[1, 1] > 0) or K[2].tolist() != [0, 0, 1] or K[1, 0] != 0:
        raise CalibrationError(f"{name}: its camera matrix is none: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, row by row")
    if abs(K[0, 1]) > 1e-6 * K[0, 0]:
        raise CalibrationError(f"{name}: its camera matrix has a skew of {K[0, 1]:g} px, which is not read: calibrate without skew")
    return K


def _size(entries: Mapping[str, Any], name: str) -> tuple[int, int]:
    width, height = _first(entries, _WIDTH), _first(entries, _HEIGHT)
    if width is None or height is None:
        both = _first(entries, _SIZE)
        if both is None:
            raise CalibrationError(f"{name}: does not say of which image size it is: add image_width and image_height, in pixels")
        width, height = _numbers(both, name, "the image size", (2,)).tolist()
    found = [_whole(value) for value in (width, height)]
    if found[0] is None or found[1] is None:
        raise CalibrationError(f"{name}: its image size is not understood: image_width and image_height are whole pixels")
    return found[0], found[1]


def _whole(value: Any) -> int | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value != int(value):
        return None
    return int(value) if 0 < value < 1 << 20 else None


def _model(entries: Mapping[str, Any], name: str) -> LensModel:
    """By `distortion_model` (ROS, Kalibr), `model` (ours) or `fisheye_model` (OpenCV's sample); a pinhole where nothing is said."""
    camera = _first(entries, ("cameramodel",))
    if camera is not None and _plain(camera) not in _MODELS:
        raise CalibrationError(
            f"{name}: camera model {camera!r:.40} is not read: calibrate as pinhole with radtan or equidistant distortion"
        )
    said = _first(entries, ("distortionmodel", "model"))
    if said is None:
        said = camera if camera is not None else ("fisheye" if _first(entries, ("fisheyemodel", "fisheye")) == 1 else "pinhole")
    if _plain(said) in {"none", ""} and not _listed(_first(entries, _DISTORTION)):
        return LensModel.PINHOLE
    model = _MODELS.get(_plain(said))
    if model is None:
        raise CalibrationError(f"{name}: distortion model {said!r:.40} is not read: {_READ}")
    return model


def _coefficients(entries: Mapping[str, Any], model: LensModel, name: str) -> list[float]:
    """OpenCV's k1, k2, p1, p2, k3 or with k4, k5, k6 too; its fisheye's k1, k2, k3, k4."""
    found = _first(entries, _DISTORTION)
    values: list[float] = [] if not _listed(found) else _numbers(found, name, "the distortion", (1, 2, 4, 5, 8, 12, 14)).tolist()
    full = 4 if model is LensModel.FISHEYE else 5 if not any(values[5:8]) else 8
    if any(values[full:]):
        if model is LensModel.FISHEYE:
            raise CalibrationError(f"{name}: a fisheye has 4 coefficients k1, k2, k3, k4, not {len(values)}: {_READ} read")
        raise CalibrationError(f"{name}: {len(values)} coefficients (thin prism or tilted sensor) are not read: calibrate with 5 or 8")
    return (values + [0.0] * full)[:full]


# --- reading ------------------------------------------------------------------------------------------------------


def _one_camera(found: Any, name: str) -> Mapping[str, Any]:
    """The entries of the one camera in it: of Kalibr's cam0, or the file's own."""
    if not isinstance(found, dict):
        raise CalibrationError(f"{name}: holds no camera calibration: give one of OpenCV, Kalibr or ROS, or a rig file (.toml)")
    cameras = [key for key, value in found.items() if isinstance(key, str) and re.fullmatch(r"cam\d+", key) and isinstance(value, dict)]
    if len(cameras) > 1:
        raise CalibrationError(f"{name}: holds {len(cameras)} cameras ({', '.join(cameras[:4])}): leave the one that filmed in the file")
    inner = found[cameras[0]] if cameras else found.get("calibration")
    # What we let people add may stand beside the camera's own entries, or among them.
    return {**{key: value for key, value in found.items() if _plain(key) in _ADDED}, **inner} if isinstance(inner, dict) else found


def _first(entries: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    """The value under the first of the names that is there; None where none is."""
    plain = {_plain(key): value for key, value in entries.items()}
    return next((plain[name] for name in names if plain.get(name) is not None), None)


def _plain(text: Any) -> str:
    return re.sub(r"[\s_-]", "", str(text)).lower()


def _listed(value: Any) -> bool:
    """Whether it holds any number."""
    inner = value.get("data") if isinstance(value, dict) else value
    return inner is not None and inner != []


def _numbers(value: Any, name: str, what: str, counts: tuple[int, ...]) -> Array:
    """(n,) numbers of a list, of lists, or of a matrix with `data`; n as allowed."""
    inner = value.get("data") if isinstance(value, dict) else value
    flat: list[float] = []
    rows = inner if isinstance(inner, list) else []
    for row in rows:
        for each in row if isinstance(row, list) else [row]:
            if isinstance(each, bool) or not isinstance(each, int | float) or not abs(each) < 1e12:
                raise CalibrationError(f"{name}: {what} holds {each!r:.40}, which is no number")
            flat.append(float(each))
    if len(flat) not in counts:
        few = " or ".join(str(count) for count in counts)
        raise CalibrationError(f"{name}: {what} has {len(flat)} numbers, not {few}")
    return np.array(flat, dtype=np.float64)


class _Constructor(SafeConstructor):
    """YAML's plain types, and OpenCV's matrix as the mapping that it is written as."""


def _matrix(constructor: SafeConstructor, node: Any) -> dict[Any, Any]:
    if not isinstance(node, MappingNode):
        raise YAMLError("a matrix that is no mapping")
    return constructor.construct_mapping(node, deep=True)


_Constructor.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def _yaml(text: str) -> Any:
    """The first document; OpenCV's `%YAML:1.0`, which is no YAML, is left out."""
    lines = text.splitlines()
    if lines and lines[0].startswith("%YAML"):
        lines = lines[1:]
    reader = YAML(typ="safe", pure=True)
    reader.Constructor = _Constructor
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an anchor used twice, an integer with a dot: none of it bears on a lens
        return next(iter(reader.load_all("\n".join(lines))), None)
