"""Tracks of a tossed object by its own print, in rendered images, beside the true poses."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from acquire.virtual.packaging import PrintKind
from analyze.tracking.camera_model import project_ideal, undistort, world_to_camera
from analyze.tracking.pose import marker_corners
from analyze.tracking.print_flight import PrintFlight
from analyze.types import ImageFrame, MarkerTrack
from tests.printed import PrintedObject
from tests.tossed import T0_NS, TossedObject

OBJECT = PrintedObject("carton", 2, exact=True)


@cache
def tossed() -> TossedObject:
    return OBJECT.tossed()


@cache
def frames() -> tuple[ImageFrame, ...]:
    """Images from shortly before the release until shortly after the landing."""
    thrown = tossed()
    return tuple(
        thrown.frames(first_ns=thrown.release_ns - 40_000_000, last_ns=thrown.landing_ns + 20_000_000)
    )


def flying(time_ns: np.ndarray) -> np.ndarray:
    thrown = tossed()
    world_ns = time_ns - T0_NS
    return (world_ns > thrown.release_ns + 10_000_000) & (world_ns < thrown.landing_ns - 10_000_000)


def errors(track: MarkerTrack) -> np.ndarray:
    """Errors (n, 4, 2) of the corners in flight [px], in the frames of a track."""
    view = next(each for each in OBJECT.views if each.name == track.marker_id)
    square = marker_corners(view.size) @ view.T_object_view[:3, :3].T + view.T_object_view[:3, 3]
    com, turn = tossed().com_and_rotation(track.time_ns)
    arms = square - np.array(OBJECT.thing.body.com_object)
    R, t = world_to_camera(OBJECT.camera)
    true = project_ideal(OBJECT.camera, (np.einsum("nij,kj->nki", turn, arms) + com[:, None]) @ R.T + t)
    return (undistort(OBJECT.camera, track.corners_px) - true)[flying(track.time_ns)]


def test_corners_of_the_views_are_found_to_a_fifth_of_a_pixel() -> None:
    tracks = PrintFlight(OBJECT.camera, OBJECT.views).tracks(frames())
    seen = np.unique(np.concatenate([track.time_ns[flying(track.time_ns)] for track in tracks]))
    all_ns = np.array([frame.time_ns for frame in frames()])
    assert len(seen) >= 0.9 * flying(all_ns).sum()
    off = np.concatenate([errors(track).reshape(-1, 8) for track in tracks])
    sd = np.concatenate([track.corner_sd_px[flying(track.time_ns)] for track in tracks])
    assert np.median(np.abs(off)) < 0.2
    assert np.sqrt(np.median(np.mean((off / sd[:, None]) ** 2, axis=1))) == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("other", [{"print_seed": 9}, {"kind": PrintKind.BLANK}])
def test_another_print_is_not_followed(other: dict) -> None:
    """Views of an object that looks otherwise: no pose rather than a wrong one."""
    another = PrintedObject("carton", 2, **{"kind": PrintKind.PRINT, "exact": True, **other})
    assert PrintFlight(OBJECT.camera, another.views).tracks(frames()[::2]) == []


def test_nothing_is_followed_in_still_images() -> None:
    still = [ImageFrame(T0_NS + n, n, frames()[0].image) for n in range(4)]
    assert PrintFlight(OBJECT.camera, OBJECT.views).tracks(still) == []
    assert PrintFlight(OBJECT.camera, OBJECT.views).tracks([]) == []
