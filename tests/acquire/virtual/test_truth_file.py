"""Damaged ground-truth files of the virtual world are refused with their name."""

from pathlib import Path

import pytest

from acquire.errors import AcquireError
from acquire.virtual.truth_file import TruthWriter, read_truth_file
from schemas.proto import percuss_pb2 as pb


def test_message_that_protobuf_cannot_decode_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "truth.bin"
    TruthWriter(path, pb.TruthBody(mass_kg=0.05)).close()
    data = path.read_bytes()
    path.write_bytes(data[:1] + b"\xff" * (len(data) - 1))
    with pytest.raises(AcquireError, match=r"truth\.bin.*damaged"):
        list(read_truth_file(path))
