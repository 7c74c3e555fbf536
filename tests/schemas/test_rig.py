"""Physical bounds of a rig file's numbers: each refusal names the entry, the value and the range."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from typing import Any

import pytest

from schemas.document import DocumentError, validate
from schemas.rig import RigConfig

RIG: dict[str, Any] = {
    "camera": {
        "address": "127.0.0.2",
        "calibration": {
            "width": 656,
            "height": 492,
            "K": [[1430, 0, 328], [0, 1430, 246], [0, 0, 1]],
            "distortion": [0.0, 0.0, 0.0, 0.0],
            "rms_px": 0.2,
            "strain_sd": 1e-4,
            "T_world_camera": [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]],
        },
    },
    "level": {"towards_x_rad": 0.0, "towards_x_sd_rad": 0.001},
}


def numbers(entries: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of all numbers in a document."""
    for key, value in entries.items() if isinstance(entries, dict) else enumerate(entries):
        if isinstance(value, dict | list | tuple):
            yield from numbers(value, (*path, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*path, key)


WHOLE = validate(RigConfig, RIG, "rig.toml").model_dump(mode="json")


@pytest.mark.parametrize("path", list(numbers(WHOLE)), ids=lambda path: ".".join(map(str, path)))
@pytest.mark.parametrize("value", [1e308, -1e308, int(308 * "9"), 1e30], ids=lambda value: f"{value:.0e}")
def test_every_number_has_bounds(path: tuple[str | int, ...], value: float) -> None:
    changed = copy.deepcopy(WHOLE)
    place: Any = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(DocumentError) as refusal:
        validate(RigConfig, changed, "rig.toml")
    line = str(refusal.value)
    name = ".".join(str(key) for key in path if isinstance(key, str))
    assert line.startswith(f"rig.toml: {name}")
    assert "\n" not in line
    assert len(line) < 300


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("frame_rate_hz", 1e308, r"should be at least 0\.01 and at most 100000\.0, not 1e\+308"),
        (
            "width",
            int(308 * "9"),
            r"should be more than 0 and at most 100000, not 99999999\.\.\. \(308 digits\)",
        ),
        ("width", 1e308, r"should be a whole number, not 1e\+308"),
    ],
)
def test_a_refusal_names_value_and_range(name: str, value: float, text: str) -> None:
    changed = copy.deepcopy(RIG)
    changed["camera"][name] = value
    with pytest.raises(DocumentError, match=re.escape(f"rig.toml: camera.{name}: ") + text):
        validate(RigConfig, changed, "rig.toml")


@pytest.mark.parametrize(
    ("K", "text"),
    [
        ([[1e308, 0, 328], [0, 1430, 246], [0, 0, 1]], r"fx = 1e\+308 px must be from 1 to 1e\+06 px"),
        ([[1430, 0, 328], [0, 0, 246], [0, 0, 1]], "fy = 0 px must be from 1"),
        ([[1430, 0, 1e300], [0, 1430, 246], [0, 0, 1]], r"cx = 1e\+300 px must be from -1e\+06"),
        ([[1430, 0, 328], [0, 1430, 246], [0, 0, 1e-308]], r"it must be \[\[fx, 0, cx\]"),
    ],
)
def test_a_camera_matrix_is_that_of_a_lens(K: list[list[float]], text: str) -> None:
    changed = copy.deepcopy(RIG)
    changed["camera"]["calibration"]["K"] = K
    with pytest.raises(DocumentError, match=text):
        validate(RigConfig, changed, "rig.toml")
