"""What the tests of the analysis share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from analyze import evidence


@pytest.fixture(scope="session", autouse=True)
def strikes_are_tracked_once() -> Iterator[None]:
    """Many tests look at the committed sample. A strike of the same file, markers and shape is tracked once; a copy is another file."""
    track, known = evidence._strike, {}

    def remembered(recording, markers, model, record):
        path = recording.path.resolve()
        poses = tuple(None if marker.T_object_marker is None else marker.T_object_marker.tobytes() for marker in markers)
        key = (path, path.stat().st_mtime_ns, record.strike_id, repr(markers), poses, model.vertices.tobytes(), model.volume)
        if key not in known:
            known[key] = track(recording, markers, model, record)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evidence, "_strike", remembered)
        yield
