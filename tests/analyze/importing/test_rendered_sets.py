"""Thirty shuffled sets of rendered phone videos: matched, or refused for the right video and reason.

Once with tags of known place, once with tags glued on anywhere; then one video of each tag is asked for.
"""

from __future__ import annotations

import re

import pytest

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.prepared_import import Assignment
from tests.analyze.importing.rendered_sets import Pool, VideoSet, video_set, write_pool

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


@pytest.fixture(scope="module")
def unplaced_pool(tmp_path_factory) -> Pool:
    return write_pool(tmp_path_factory.mktemp("unplaced"), placed=False)


UNPLACED_REASONS = REASONS | {
    "not planned": "one of them shows another edge|tips over an edge of no planned strike|"
    "two tags would lie on one side",
    "names swapped": "by its name it is .* but the images show|cannot show all of these strikes|"
    "two tags would lie on one side",
}


def outcome(pool: Pool, videos: VideoSet) -> list[str] | str:
    """Strikes of the videos in their order, or the line with which they are refused."""
    options = ImportOptions(tuple(videos.paths), *(pool.files[name] for name in ("object", "plan", "camera")))
    try:
        with prepare(options) as prepared:
            return [window.plan_strike_id for window in prepared.windows]
    except ImportRefused as refused:
        return str(refused)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(30))
def test_rendered_set_without_places_is_matched_once_the_videos_asked_for_are_named(
    unplaced_pool, seed, tmp_path
):
    videos = video_set(unplaced_pool, seed, tmp_path)
    shown = [f"s{number + 1}" for number in videos.strikes]
    found = outcome(unplaced_pool, videos)
    if "the shape looks the same from several sides: rename" in found:
        for number, path in enumerate(videos.paths):
            if f"{path.name} may be s" in found:
                videos.paths[number] = path.rename(path.with_name(f"{shown[number]}.mp4"))
        found = outcome(unplaced_pool, videos)
    else:
        assert videos.kind in ("not planned", "names swapped"), "a box cannot be matched without a name"
    if videos.kind == "shuffled":
        assert found == shown
        return
    assert isinstance(found, str)
    assert "\n" not in found
    assert re.search(UNPLACED_REASONS[videos.kind], found)
    odd = (0, 1) if videos.kind == "names swapped" else (videos.odd,)
    assert any(videos.paths[number].name.removesuffix(".mp4") in found for number in odd)
