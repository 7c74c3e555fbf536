"""Truth file of the virtual world: true mass properties, poses and contacts.

Its contents are merged into the recording later (`truth.merge_truth`).

Layout: a varint length and a TruthBody (mass properties, friction, table tilt, camera pose, seed); then any
number of (kind byte, varint length, protobuf message), kind 1 = TruthPose, 2 = TruthContact.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

# protobuf has no public reader and writer for streams.
from google.protobuf.internal.decoder import _DecodeVarint32  # pyright: ignore[reportAttributeAccessIssue]
from google.protobuf.internal.encoder import _VarintBytes  # pyright: ignore[reportAttributeAccessIssue]
from google.protobuf.message import DecodeError

from acquire.errors import AcquireError
from schemas.proto import percuss_pb2 as pb

TruthMessage = pb.TruthBody | pb.TruthPose | pb.TruthContact

_POSE, _CONTACT = 1, 2


class TruthWriter:
    """Writer of a truth file, readable by its owner only; an existing file is replaced.

    Args:
        path: path of the file.
        body: true mass properties, with friction, table tilt, camera pose and seed; written first.
    """

    def __init__(self, path: Path, body: pb.TruthBody) -> None:
        self.path = path
        path.unlink(missing_ok=True)
        self._file = os.fdopen(
            os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb", buffering=1 << 16
        )
        self._file.write(_delimited(body))

    def pose(self, message: pb.TruthPose) -> None:
        """Append a true pose of object and arm to the file; it may stay buffered until `flush`."""
        self._file.write(bytes([_POSE]) + _delimited(message))

    def contact(self, message: pb.TruthContact) -> None:
        """Append a true contact of the striker to the file; it may stay buffered until `flush`."""
        self._file.write(bytes([_CONTACT]) + _delimited(message))

    def flush(self) -> None:
        """Write all buffered messages to the file."""
        self._file.flush()

    def close(self) -> None:
        """Write all buffered messages and close the file."""
        self._file.close()


def read_truth_file(path: Path) -> Iterator[TruthMessage]:
    """Yield all messages of a truth file in order: first the mass properties, then poses and contacts.

    Raises:
        AcquireError: the file cannot be read, ends within a message, or holds a damaged message or one of
            unknown kind.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        problem = f"{path}: cannot be read ({error.strerror}): check that the virtual world started"
        raise AcquireError(problem) from None
    try:
        body, at = _read(data, 0)
        yield pb.TruthBody.FromString(body)
        while at < len(data):
            kind = {_POSE: pb.TruthPose, _CONTACT: pb.TruthContact}[data[at]]
            message, at = _read(data, at + 1)
            yield kind.FromString(message)
    except (IndexError, KeyError, ValueError, DecodeError):
        raise AcquireError(
            f"{path}: ends within a message, is damaged or is no truth file of the virtual world: "
            "run the demo again"
        ) from None


def _read(data: bytes, at: int) -> tuple[bytes, int]:
    length, at = _DecodeVarint32(data, at)
    if at + length > len(data):
        raise ValueError("cut short")
    return data[at : at + length], at + length


def _delimited(message: TruthMessage) -> bytes:
    data = message.SerializeToString()
    return _VarintBytes(len(data)) + data
