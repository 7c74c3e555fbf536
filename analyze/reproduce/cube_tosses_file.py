"""File of tosses of a cube (.npz): poses of the cube at a fixed rate, toss after toss."""

from __future__ import annotations

import lzma
import struct
import warnings
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analyze.errors import RecordingError
from analyze.geometry.rotations import matrix_from_wxyz
from analyze.motion.body_motion import BodyMotion
from analyze.types import Array

DEFAULT_DATA: Final = Path("../shared/data/contactnets_tosses.npz")
_DOCS: Final = "docs/reference/reproduce.md"
FRAME_RATE_HZ: Final = 148.0
MAX_UNPACKED_BYTES: Final = 200_000_000
"""Largest size [bytes] to which a file of tosses may unpack; the published one has 2 MB."""
_NUMPY_ERRORS: Final = (OSError, ValueError, KeyError, TypeError, MemoryError, SyntaxError, TokenError)
"""Errors of numpy on headers that are damaged or announce more than there is."""
_ZIP_ERRORS: Final = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, NotImplementedError)


def read_tosses(path: Path) -> list[BodyMotion]:
    """Read the motions of the tosses from a packed file (.npz), with poses at `FRAME_RATE_HZ`.

    Returns:
        Motion of each toss: poses of the cube in the world frame by time [s]. Lengths are in the file's own
        unit, which it calls metre.

    Raises:
        RecordingError: the file does not exist, or does not contain packed tosses with valid poses.
    """
    if not path.is_file():
        raise RecordingError(
            f"{path}: not found: give --data FILE, the tosses of DAIRLab/contact-nets, packed as in {_DOCS}"
        )
    try:
        lengths, position, quaternion = _columns(path)
    except (EOFError, RuntimeError, *_NUMPY_ERRORS, *_ZIP_ERRORS) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: not a file of packed tosses ({reason}): see {_DOCS}") from None
    total = int(lengths.sum()) if lengths.ndim == 1 else -1
    if position.shape != (total, 3) or quaternion.shape != (total, 4) or np.any(lengths < 2):
        raise RecordingError(f"{path}: the toss lengths do not match the number of poses: see {_DOCS}")
    norm = np.linalg.norm(quaternion, axis=1)
    if not (np.all(np.isfinite(position)) and np.all(np.abs(norm - 1) < 0.01)):
        raise RecordingError(
            f"{path}: holds invalid poses (not finite, or quaternions not of unit length): see {_DOCS}"
        )
    R = matrix_from_wxyz(quaternion / norm[:, None])
    ends = np.cumsum(lengths)
    return [
        BodyMotion(np.arange(end - start) / FRAME_RATE_HZ, position[start:end], R[start:end])
        for start, end in zip(np.append(0, ends[:-1]), ends, strict=True)
    ]


def _columns(path: Path) -> tuple[NDArray[np.int64], Array, Array]:
    """Numbers of frames (t,), positions and quaternions of all frames of a file of t tosses, unchecked.

    Raises:
        Exception: one of many, as the file is damaged or none of tosses.
    """
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(item.file_size for item in archive.infolist())
    if unpacked > MAX_UNPACKED_BYTES:
        raise ValueError(f"unpacks to {unpacked / 1e6:.0f} MB, more than {MAX_UNPACKED_BYTES / 1e6:.0f} MB")
    with warnings.catch_warnings(), np.load(path, allow_pickle=False) as packed:
        warnings.simplefilter("ignore")  # a damaged header looks like one of Python 2
        return (
            np.asarray(packed["length"], dtype=np.int64),
            np.asarray(packed["position_m"], dtype=np.float64),
            np.asarray(packed["quaternion_wxyz"], dtype=np.float64),
        )
