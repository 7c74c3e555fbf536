"""File of planar impacts (.mat): states of a dropped ellipse just before and just after it hits a table."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import struct
import warnings
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from analyze.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

    from analyze.types import Array

_DOCS: Final = "docs/reference/reproduce.md"
MAX_BYTES: Final = 20_000_000
"""Largest size [bytes] of a file of impacts; the published one has 0.2 MB."""
MAX_LEVER_M: Final = 1.0
"""Largest distance [m] of the point of contact from the middle that is plausible for a dropped object."""
_MAT_ERRORS: Final = (
    OSError,
    EOFError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    SystemError,
    MatReadError,
    struct.error,
    zlib.error,
)
"""Errors of scipy on files that are damaged, of another version, or not MATLAB's."""
_COLUMNS: Final = (("states_i", 6), ("states_f", 6), ("n", 3), ("d", 3))
"""Fields of the file's `data`, and their numbers of columns."""


@dataclass(frozen=True)
class PlanarImpacts:
    """Impacts of a body in a vertical plane onto a level table, x along it and y up, one impact a row."""

    before: Array
    """(n, 3) velocity of the middle [m/s], x and y, and angular velocity [rad/s] before the impact"""
    after: Array
    """(n, 3) the same after it"""
    arm: Array
    """(n,) x of the point of contact, seen from the middle [m]"""
    height: Array
    """(n,) height of the middle over the point of contact [m]"""

    def __len__(self) -> int:
        return len(self.arm)


def read_impacts(path: Path) -> PlanarImpacts:
    """Read the impacts of a MATLAB file (.mat, up to version 7) with the struct `data`.

    Its fields are those of `mcubelab/planar-impact-dataset`, processed_data/data_ellipse.mat.

    Raises:
        RecordingError: the file does not exist, or does not contain impacts with valid numbers.
    """
    remedy = f"give data_ellipse.mat of mcubelab/planar-impact-dataset, as in {_DOCS}"
    if not path.is_file():
        raise RecordingError(f"{path}: not found: {remedy}")
    if (size := path.stat().st_size) > MAX_BYTES:
        raise RecordingError(
            f"{path}: {size / 1e6:.0f} MB, a file of impacts has {MAX_BYTES / 1e6:.0f} at most: {remedy}"
        )
    try:
        columns = _columns(path)
    except _MAT_ERRORS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: not a file of impacts ({reason[:120]}): {remedy}") from None
    before, after, normal, tangent = columns
    if not all(np.all(np.isfinite(column)) for column in columns):
        raise RecordingError(f"{path}: holds states that are not finite: {remedy}")
    if not (np.all(normal[:, :2] == (0.0, 1.0)) and np.all(tangent[:, :2] == (1.0, 0.0))):
        raise RecordingError(f"{path}: the table's normal is not along y in every impact: {remedy}")
    if np.any(np.abs([normal[:, 2], tangent[:, 2]]) > MAX_LEVER_M) or np.any(tangent[:, 2] <= 0):
        raise RecordingError(
            f"{path}: a point of contact lies above the middle, or more than {MAX_LEVER_M:g} m off: {remedy}"
        )
    return PlanarImpacts(before[:, 3:], after[:, 3:], normal[:, 2], tangent[:, 2])


def _columns(path: Path) -> list[Array]:
    """Arrays (n, 6), (n, 6), (n, 3) and (n, 3) of a file of n impacts, their values unchecked.

    Raises:
        Exception: one of many, as the file is damaged or none of impacts.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a damaged file may hold a variable twice
        data = loadmat(path, variable_names=["data"]).get("data")
    if not isinstance(data, np.ndarray) or data.dtype.names is None or data.size != 1:
        raise ValueError("it has no struct 'data'")
    fields = data.reshape(-1)[0]
    found: list[Array] = []
    for name, width in _COLUMNS:
        if name not in data.dtype.names:
            raise ValueError(f"'data' has no field '{name}'")
        values = fields[name]
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
            raise ValueError(f"'{name}' does not hold real numbers")
        if values.ndim != 2 or values.shape[1] != width:
            raise ValueError(f"'{name}' is {values.shape}, not (impacts, {width})")
        found.append(values.astype(np.float64))
    if len({len(column) for column in found}) != 1:
        raise ValueError("its fields differ in their number of impacts")
    return found
