"""Thirty shuffled sets of rendered phone videos: matched, or refused for the right video and reason."""

from __future__ import annotations

import pytest

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.prepared_import import Assignment
from tests.analyze.importing.rendered_sets import Pool, video_set, write_pool

REASONS = {
    "wrong end": "its tag turns the other way round than in the plan's strikes",
    "not planned": "over an edge of no planned strike; nearest is s",
    "hand-held": "its tag is seen, but is never at rest: put the camera on a stand",
    "no tip": "no tag is at rest in view and then tips",
}


@pytest.fixture(scope="module")
def pool(tmp_path_factory) -> Pool:
    return write_pool(tmp_path_factory.mktemp("pool"))


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(30))
def test_rendered_set_is_matched_or_refused_with_the_right_reason(pool, seed, tmp_path):
    videos = video_set(pool, seed, tmp_path)
    options = ImportOptions(tuple(videos.paths), *(pool.files[name] for name in ("object", "plan", "camera")))
    shown = [f"s{number + 1}" for number in videos.strikes]
    if videos.kind == "shuffled":
        with prepare(options) as prepared:
            assert [window.plan_strike_id for window in prepared.windows] == shown
            assert prepared.assignment is Assignment.IMAGES
        return
    with pytest.raises(ImportRefused) as caught:
        prepare(options)
    said = str(caught.value)
    assert "\n" not in said
    if videos.kind == "names swapped":
        first = videos.paths[0]
        assert said.startswith(f"{first.name}: by its name it is {first.stem} (")
        assert f"but the images show {shown[0]} (" in said
    else:
        assert said.startswith(f"{videos.paths[videos.odd].name}: ")
        assert REASONS[videos.kind] in said
