"""Reads lens calibrations of other programs: OpenCV (YAML, JSON), Kalibr, and ROS camera_info.

Programs name the same numbers differently: names are compared without case, blanks, underscores and dashes. A
matrix may be a list, nested lists, or a mapping with its numbers as `data`. Nothing in such a file is
executed: YAML is read with the safe constructors and OpenCV's one matrix type.
"""

from __future__ import annotations

import json
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
from schemas.input_file import MAX_TEXT_BYTES, read_bytes
from schemas.session_manifest import CameraCalibrationSpec, LensModel

SUFFIXES = (".yaml", ".yml", ".json")
MAX_BYTES = 1 << 20
"""largest size of a calibration file [bytes]; a larger file is something else"""

_MODELS = {
    **dict.fromkeys(
        ("plumbbob", "radtan", "radialtangential", "rationalpolynomial", "brownconrady", "pinhole", "opencv"),
        LensModel.PINHOLE,
    ),
    **dict.fromkeys(
        ("equidistant", "fisheye", "kannalabrandt", "kannalabrandt4", "kb4", "opencvfisheye"),
        LensModel.FISHEYE,
    ),
}
READ_MODELS_TEXT = "plumb_bob (radtan), rational_polynomial and equidistant (fisheye) are"
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
ADDED_NAMES = ("tworldcamera", "linetimes", "strainsd")
"""names, in lower case without underscores, of entries that users may add to another program's file"""
_SIZE = ("resolution", "imagesize", "imgsize")


def read_calibration(path: Path) -> tuple[CameraCalibrationSpec, bool]:
    """Read the lens, and the camera's pose if stated, from another program's camera file.

    A file named .json is read as JSON, any other as YAML. Beside the program's own entries it may contain
    `T_world_camera`, the pose of the camera in the world frame (4 x 4, from camera to world coordinates,
    translation in m; the unit matrix by default), `line_time_s`, the delay between the readout of
    neighbouring rows [s], and `strain_sd`, the standard deviation of the strain that the lens leaves in the
    image (relative error of a length in one direction against one across it).

    Returns:
        The calibration (lens, image size, pose, row delay, strain); True if the file has `T_world_camera`.

    Raises:
        CalibrationError: the file cannot be read, contains several cameras, or no lens of a known model.
        DocumentError: an entry has a value that is not allowed.
    """
    try:
        data = read_bytes(path, MAX_TEXT_BYTES)
    except FileNotFoundError:
        raise CalibrationError(f"{path}: no such camera file: check the path") from None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    return parse_calibration(data, str(path), as_json=path.suffix.lower() == ".json")


def parse_calibration(data: bytes, name: str, *, as_json: bool = False) -> tuple[CameraCalibrationSpec, bool]:
    """Parse the content of another program's camera file: OpenCV, Kalibr or ROS camera_info.

    Args:
        data: content of the file, UTF-8, at most `MAX_BYTES`.
        name: name of the file, for error messages.
        as_json: True if the content is JSON, False if it is YAML.

    Returns:
        The calibration, and True if the content has the camera's pose `T_world_camera`.

    Raises:
        CalibrationError: the content is too large, not valid, contains several cameras, or no lens of a known
            model.
        DocumentError: an entry has a value that is not allowed.
    """
    if len(data) > MAX_BYTES:
        raise CalibrationError(
            f"{name}: {len(data) / 1e6:.1f} MB is too large for a camera calibration: give the file with "
            "camera matrix and distortion"
        )
    kind = "JSON" if as_json else "YAML"
    try:
        text = data.decode("utf-8-sig")
        found = json.loads(text) if as_json else _yaml(text)
    # The YAML reader raises all of these on malformed input.
    except (ValueError, RecursionError, YAMLError, TypeError, AttributeError, LookupError, ArithmeticError):
        raise CalibrationError(
            f"{name}: is not valid {kind}: give a calibration of OpenCV, Kalibr or ROS, or a rig file (.toml)"
        ) from None
    return calibration_of(_one_camera(found, name), name)


def calibration_of(entries: Mapping[str, Any], name: str) -> tuple[CameraCalibrationSpec, bool]:
    """Convert one camera's entries, under any of the known names, to a calibration.

    Args:
        entries: camera matrix [px] and image size [px]; distortion, lens model, `T_world_camera`,
            `line_time_s` and `strain_sd` may be missing (no distortion, pinhole, unit matrix, 0, unknown).
        name: name of the file or topic, for error messages.

    Returns:
        The calibration, and True if the entries have the camera's pose `T_world_camera`.

    Raises:
        CalibrationError: camera matrix or image size is missing, the lens model is not known, an entry has
            the wrong number or kind of values, or the principal point lies outside the image.
        DocumentError: `T_world_camera` is not a pose, or `line_time_s` or `strain_sd` is not allowed.
    """
    K = _camera_matrix(entries, name)
    width, height = _size(entries, name)
    if not (0.0 < K[0, 2] < width and 0.0 < K[1, 2] < height):
        raise CalibrationError(
            f"{name}: the principal point ({K[0, 2]:.0f}, {K[1, 2]:.0f}) lies outside the image of {width} x "
            f"{height} px: the calibration belongs to another image size"
        )
    model = _model(entries, name)
    place = _first(entries, ADDED_NAMES[:1])
    spec: dict[str, Any] = {
        "model": model.value,
        "width": width,
        "height": height,
        "K": K.tolist(),
        "distortion": _coefficients(entries, model, name),
        "T_world_camera": np.eye(4).tolist()
        if place is None
        else _numbers(place, name, "T_world_camera", (16,)).reshape(4, 4).tolist(),
    }
    for key, plain in zip(("line_time_s", "strain_sd"), ADDED_NAMES[1:], strict=True):
        stated = _first(entries, (plain,))
        if stated is not None:
            spec[key] = stated
    return validate(CameraCalibrationSpec, spec, name), place is not None


# --- entries


def _camera_matrix(entries: Mapping[str, Any], name: str) -> Array:
    """Camera matrix (3, 3) [px] from nine numbers by row, or from Kalibr's four: fx, fy, cx, cy.

    Raises:
        CalibrationError: the matrix is missing, has skew, or is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].
    """
    found = _first(entries, _CAMERA_MATRIX)
    if found is None:
        raise CalibrationError(
            f"{name}: contains no camera matrix (camera_matrix, K or intrinsics): give a calibration of "
            "OpenCV, Kalibr or ROS"
        )
    values = _numbers(found, name, "the camera matrix", (4, 9))
    K = np.eye(3)
    if len(values) == 4:
        K[0, 0], K[1, 1], K[0, 2], K[1, 2] = values
    else:
        K = values.reshape(3, 3)
    if not (K[0, 0] > 0 and K[1, 1] > 0) or K[2].tolist() != [0, 0, 1] or K[1, 0] != 0:
        raise CalibrationError(
            f"{name}: its camera matrix is not valid: it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in "
            "pixels, row by row"
        )
    if abs(K[0, 1]) > 1e-6 * K[0, 0]:
        raise CalibrationError(
            f"{name}: its camera matrix has a skew of {K[0, 1]:g} px, which is not supported: calibrate "
            "without skew"
        )
    return K


def _size(entries: Mapping[str, Any], name: str) -> tuple[int, int]:
    """Width and height of the image [px], from two entries of a camera file or from one with both.

    Raises:
        CalibrationError: the entries are missing, or are not whole pixels.
    """
    width, height = _first(entries, _WIDTH), _first(entries, _HEIGHT)
    if width is None or height is None:
        both = _first(entries, _SIZE)
        if both is None:
            raise CalibrationError(
                f"{name}: contains no image size: add image_width and image_height, in pixels"
            )
        width, height = _numbers(both, name, "the image size", (2,)).tolist()
    found = [_whole(value) for value in (width, height)]
    if found[0] is None or found[1] is None:
        raise CalibrationError(
            f"{name}: its image size is not valid: image_width and image_height must be whole pixels"
        )
    return found[0], found[1]


def _whole(value: Any) -> int | None:
    """`value` (an int or float) as an int; None if it is not a whole number from 1 to 2^20 - 1."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1 << 20:
        return None
    return int(value) if value == int(value) else None


def _model(entries: Mapping[str, Any], name: str) -> LensModel:
    """Lens model (pinhole or fisheye) that a camera file's entries state; pinhole if they state none.

    The entries are tried in this order: `distortion_model` (ROS, Kalibr), `model` (this project's rig files),
    `camera_model` (Kalibr), `fisheye_model` equal to 1 (OpenCV's sample). The statement "none" means pinhole
    if there are no distortion coefficients.

    Raises:
        CalibrationError: the stated camera model or distortion model is not supported.
    """
    camera = _first(entries, ("cameramodel",))
    if camera is not None and _plain(camera) not in _MODELS:
        raise CalibrationError(
            f"{name}: camera model {camera!r:.40} is not supported: calibrate as pinhole with radtan or "
            "equidistant distortion"
        )
    stated = _first(entries, ("distortionmodel", "model"))
    if stated is None:
        is_fisheye = _first(entries, ("fisheyemodel", "fisheye")) == 1
        stated = camera if camera is not None else "fisheye" if is_fisheye else "pinhole"
    if _plain(stated) in {"none", ""} and not _listed(_first(entries, _DISTORTION)):
        return LensModel.PINHOLE
    model = _MODELS.get(_plain(stated))
    if model is None:
        raise CalibrationError(
            f"{name}: distortion model {stated!r:.40} is not supported: {READ_MODELS_TEXT}"
        )
    return model


def _coefficients(entries: Mapping[str, Any], model: LensModel, name: str) -> list[float]:
    """Distortion coefficients of a camera file's entries, in OpenCV's order; missing ones are 0.

    Returns:
        For a pinhole k1, k2, p1, p2, k3, and also k4, k5, k6 if any of these three is not 0; for a fisheye
        k1, k2, k3, k4.

    Raises:
        CalibrationError: OpenCV has no model with so many coefficients, or one of those after the ones above
            (thin prism, tilted sensor) is not 0.
    """
    found = _first(entries, _DISTORTION)
    values = list[float]()
    if _listed(found):
        values = _numbers(found, name, "the distortion", (1, 2, 4, 5, 8, 12, 14)).tolist()
    full = 4 if model is LensModel.FISHEYE else 5 if not any(values[5:8]) else 8
    if any(values[full:]):
        if model is LensModel.FISHEYE:
            raise CalibrationError(
                f"{name}: a fisheye has 4 coefficients k1, k2, k3, k4, not {len(values)}: {READ_MODELS_TEXT} "
                "supported"
            )
        raise CalibrationError(
            f"{name}: {len(values)} coefficients (thin prism or tilted sensor) are not supported: calibrate "
            "with 5 or 8"
        )
    return (values + [0.0] * full)[:full]


# --- reading


def _one_camera(found: Any, name: str) -> Mapping[str, Any]:
    """Entries of the only camera in the parsed content `found` of a camera file.

    They are under cam0, cam1, … (Kalibr), under `calibration`, or at the top level. Top-level
    `T_world_camera` (camera's pose), `line_time_s` (row delay) and `strain_sd` are added to them.

    Raises:
        CalibrationError: the content is no mapping, or contains several cameras.
    """
    if not isinstance(found, dict):
        raise CalibrationError(
            f"{name}: contains no camera calibration: give one of OpenCV, Kalibr or ROS, or a rig file "
            "(.toml)"
        )
    cameras = [
        key
        for key, value in found.items()
        if isinstance(key, str) and re.fullmatch(r"cam\d+", key) and isinstance(value, dict)
    ]
    if len(cameras) > 1:
        raise CalibrationError(
            f"{name}: contains {len(cameras)} cameras ({', '.join(cameras[:4])}): keep only the one that "
            "took the images"
        )
    inner = found[cameras[0]] if cameras else found.get("calibration")
    # The entries that users add may be beside the camera's own entries, or among them.
    return (
        {**{key: value for key, value in found.items() if _plain(key) in ADDED_NAMES}, **inner}
        if isinstance(inner, dict)
        else found
    )


def _first(entries: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    """Value of the first entry among `names` that is not None; None if there is no such entry.

    Keys are compared without case, blanks, underscores and dashes; `names` are already in this form.
    """
    plain = {_plain(key): value for key, value in entries.items()}
    return next((plain[name] for name in names if plain.get(name) is not None), None)


def _plain(text: Any) -> str:
    """Text in lower case without blanks, underscores and dashes."""
    return re.sub(r"[\s_-]", "", str(text)).lower()


def _listed(value: Any) -> bool:
    """True if an entry is a value other than None and the empty list; of a mapping its `data` counts."""
    inner = value.get("data") if isinstance(value, dict) else value
    return inner is not None and inner != []


def _numbers(value: Any, name: str, what: str, counts: tuple[int, ...]) -> Array:
    """Numbers (n,) float64 of an entry: a list, a list of lists, or a mapping with either as `data`.

    Args:
        value: the entry.
        name: name of the file, for error messages.
        what: name of the entry, for error messages.
        counts: allowed values of n.

    Raises:
        CalibrationError: an element is not a number between -1e12 and 1e12, or n is not allowed.
    """
    inner = value.get("data") if isinstance(value, dict) else value
    flat: list[float] = []
    rows = inner if isinstance(inner, list) else []
    for row in rows:
        for each in row if isinstance(row, list) else [row]:
            if isinstance(each, bool) or not isinstance(each, int | float) or not abs(each) < 1e12:
                raise CalibrationError(f"{name}: {what} contains {each!r:.40}, which is not a number")
            flat.append(float(each))
    if len(flat) not in counts:
        few = " or ".join(str(count) for count in counts)
        raise CalibrationError(f"{name}: {what} has {len(flat)} numbers, not {few}")
    return np.array(flat, dtype=np.float64)


class _Constructor(SafeConstructor):
    """YAML constructor that reads plain types, and OpenCV's matrix type as a mapping."""


def _matrix(constructor: SafeConstructor, node: Any) -> dict[Any, Any]:
    """Mapping with the entries (rows, cols, dt, data) of a YAML node of OpenCV's matrix type.

    Raises:
        YAMLError: the node is no mapping.
    """
    if not isinstance(node, MappingNode):
        raise YAMLError("a matrix that is no mapping")
    return constructor.construct_mapping(node, deep=True)


_Constructor.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def _yaml(text: str) -> Any:
    """Parse a YAML text; return the content of its first document, None if the text is empty.

    OpenCV's first line `%YAML:1.0`, which is not valid YAML, is skipped. Invalid text raises YAMLError or
    another error of the YAML reader.
    """
    lines = text.splitlines()
    if lines and lines[0].startswith("%YAML"):
        lines = lines[1:]
    reader = YAML(typ="safe", pure=True)
    reader.Constructor = _Constructor
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # about repeated anchors and integers with a dot, which do not affect a lens
        return next(iter(reader.load_all("\n".join(lines))), None)
