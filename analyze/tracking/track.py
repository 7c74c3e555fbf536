"""Tracking of markers through the frames of one strike: found in the whole image, then followed.

A strike is one impact that tips the object; its frames are the images around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import TrackingError
from analyze.tracking.camera_model import distort, pixel_map, undistort
from analyze.tracking.edges import find_square, refit_square
from analyze.tracking.marker import Sighting, detect, families_of, is_marker, marker_of_other_family
from analyze.tracking.marker_path import FoundMarker, MarkerPath, marker_spread
from analyze.tracking.pose import choose_by_motion, solve_poses
from analyze.tracking.print_likeness import RestView
from analyze.tracking.print_points import PrintPoints
from analyze.tracking.rolling_shutter import corners_at_one_time, delays_by_frame, row_delay_s
from analyze.types import MarkerTrack
from schemas.tags import family_and_id, name_order

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from analyze.tracking.edges import Square, SquareFit
    from analyze.types import Array, CameraModel, ImageFrame, IntArray, Marker

_FULL_SCANS = 2
"""number of first frames that are searched completely, to report unexpected markers"""
_RESCAN_EVERY = 25
"""frames between full searches while a marker is missing"""
_MAX_LOCAL_SEARCHES = 8
"""number of frames in which a lost marker is searched near its last position; without a limit a marker that
has turned away would cost a search in every frame"""
_MAX_TRUSTED_MOVE_PX = 1.2
"""distance of a fit from its start [px] beyond which OpenCV must confirm the marker"""


@dataclass(frozen=True)
class TrackingReport:
    """Tracks of an object's markers in the frames of a strike, unknown markers, and the frames' times."""

    tracks: tuple[MarkerTrack, ...]
    """tracks of the object's markers that were found"""
    unknown_ids: tuple[int | str, ...]
    """markers of the object's families that it does not carry, seen in two full searches (or the only one)"""
    image_times_ns: IntArray
    """(n,) log times of all images that were searched [ns]"""
    rest_view: RestView | None = None
    """the object at rest, where it is followed by its print; None with markers"""
    print_points: PrintPoints | None = None
    """some of the points of its print; None with markers"""

    @property
    def unmarked_ns(self) -> IntArray:
        """Log times (n,) [ns] of the searched images in which no marker was found."""
        return np.setdiff1d(
            self.image_times_ns,
            np.concatenate([np.zeros(0, dtype=np.int64), *(track.frame_ns for track in self.tracks)]),
        )

    @property
    def images_end_ns(self) -> int:
        """Log time [ns] of the last searched image, 0 if there was none."""
        return int(self.image_times_ns[-1]) if len(self.image_times_ns) else 0

    @property
    def frames_total(self) -> int:
        """Number of images that were searched for markers."""
        return len(self.image_times_ns)


class MarkerFollower:
    """Tracker of the markers of one object; frames are added one by one in order of time.

    Args:
        camera: camera that took the frames.
        markers: all markers of the object.
        expected: ids of the markers expected in view. Once one of them is found, all markers that are not
            expected are dropped, with their earlier observations, because each costs milliseconds per frame.
        rescan_every: frames between full searches while a marker is missing.
        rigid: True to search, while a marker is in view, only where the others on the body can be; for
            markers at known places on it.
    """

    def __init__(
        self,
        camera: CameraModel,
        markers: Sequence[Marker],
        expected: Sequence[int | str] = (),
        rescan_every: int = _RESCAN_EVERY,
        rigid: bool = False,
    ) -> None:
        """Prepare the tracker; no frame is searched yet."""
        self._camera = camera
        self._pixels = pixel_map(camera)
        self._paths = {marker.id: MarkerPath(marker) for marker in markers}
        self._rescan_every = rescan_every
        self._local_searches = min(_MAX_LOCAL_SEARCHES, rescan_every)
        self._spread = marker_spread(markers) if rigid else {}
        self._known = frozenset(self._paths)
        self._expected = frozenset(expected) & self._known
        self._families = families_of(self._known)
        self._unknown: dict[int | str, int] = {}
        self._first: NDArray[np.uint8] | None = None
        self._image_times_ns: list[int] = []

    @property
    def frames_total(self) -> int:
        """Number of frames added so far."""
        return len(self._image_times_ns)

    def add(self, frame: ImageFrame) -> dict[int | str, Square]:
        """Find the markers in one frame; return by id each one's black square, fitted to its edges.

        A `Square` has four corners in ideal (distortion-free) pixels, with covariance. The observations are
        added to the tracks. The result is empty if no marker of the object is found.

        Args:
            frame: image of the calibration's size, later than those before.

        Raises:
            TrackingError: a marker is in the image twice, or the image has another size than the calibration.
        """
        if frame.image.shape != (self._camera.height, self._camera.width):
            raise TrackingError(
                f"image {frame.sequence} has {frame.image.shape[1]} x {frame.image.shape[0]} px,"
                f" the calibration {self._camera.width} x {self._camera.height}:"
                " recalibrate, or use the rig file of this recording"
            )
        self._image_times_ns.append(frame.time_ns)
        if self._first is None:
            self._first = frame.image
        found: dict[int | str, FoundMarker] = {}
        for marker_id, path in self._paths.items():
            if path.time_ns and (seen := self._follow(frame, path)) is not None:
                found[marker_id] = seen
        # Full searches in the first frames, and at intervals while a marker is missing.
        due = self.frames_total <= _FULL_SCANS or (
            self.frames_total % self._rescan_every == 0 and len(found) < len(self._paths)
        )
        if due or any(path.missed == 1 for i, path in self._paths.items() if i not in found):
            for sighting in self._scan(frame, self._region(found)):
                if (
                    sighting.marker_id not in found
                    and (seen := self._refined_sighting(frame, sighting)) is not None
                ):
                    found[sighting.marker_id] = seen
        self._record(frame, found)
        if any(self._paths[marker_id].time_ns for marker_id in self._expected):
            self._paths = {
                marker_id: self._paths[marker_id] for marker_id in self._paths if marker_id in self._expected
            }
            self._expected = frozenset[int | str]()
        return {marker_id: seen.fit.square for marker_id, seen in found.items()}

    def report(self) -> TrackingReport:
        """Tracks (poses over time) of the followed markers, unknown markers seen, and times of all frames.

        The poses of tracks are in the camera frame. Once an expected marker is found, the markers that are
        not expected have no track, even if they were seen before. Unknown markers are those of the object's
        families that are not on it, seen in two full searches (in one, if there was only one frame). If no
        marker was seen, tracks and unknown markers are empty. Times are log times [ns].

        Raises:
            TrackingError: only markers that are not on the object were seen, or the line time (delay from
                image row to row) is too long for the frame rate.
        """
        delays_s = delays_by_frame(self._camera, self._paths.values())
        tracks = tuple(
            track for path in self._paths.values() if (track := self._track(path, delays_s)) is not None
        )
        unknown = tuple(
            sorted(
                (i for i, times in self._unknown.items() if times >= min(2, self.frames_total)),
                key=name_order,
            )
        )
        known = ", ".join(str(i) for i in sorted(self._known, key=name_order)) or "none"
        if (
            not tracks
            and not unknown
            and self._first is not None
            and (other := marker_of_other_family(self._first, self._families)) is not None
        ):
            family, tag_id = family_and_id(other)
            raise TrackingError(
                f"marker {tag_id} of {family} seems to be in view, the object carries {known}:"
                " correct the family in the object file"
            )
        if unknown and not tracks:
            raise TrackingError(
                f"marker {unknown[0]} is in view, but the object carries {known}:"
                " correct the object file or the marker"
            )
        return TrackingReport(tracks, unknown, np.array(self._image_times_ns, dtype=np.int64))

    def _follow(self, frame: ImageFrame, path: MarkerPath) -> FoundMarker | None:
        """Find a marker near its expected position: its fitted square and raw corners, or None.

        Tried are the edges at the expected corners, if it was found in the last frame, and then a search of
        the region around them, unless the marker has been missing for `_MAX_LOCAL_SEARCHES` (8) frames, or as
        many as pass between full searches.

        Args:
            frame: the image.
            path: earlier observations of the marker, at least one.
        """
        expected, expected_ideal, reach = path.predict(frame.time_ns)
        if path.missed == 0:
            fit = None if path.fit is None else refit_square(frame.image, path.fit, expected_ideal)
            fit = fit or find_square(frame.image, self._pixels, expected_ideal, expected)
            seen = None if fit is None else self._with_raw_corners(fit)
            if (
                seen is not None
                and float(np.abs(seen.corners_raw - expected).max()) < _MAX_TRUSTED_MOVE_PX
                and is_marker(frame.image, seen.corners_raw, path.marker.id)
            ):
                return seen
        if path.missed >= self._local_searches:
            return None
        margin = int(reach + 0.35 * float(np.ptp(expected, axis=0).max())) + 2
        left, top = np.maximum(np.floor(expected.min(axis=0)).astype(int) - margin, 0)
        right, bottom = np.ceil(expected.max(axis=0)).astype(int) + margin
        region = frame.image[top:bottom, left:right]
        if min(region.shape) < 16:
            return None
        outline = np.linalg.norm(expected - np.roll(expected, 1, axis=0), axis=1).sum()
        least = 0.5 * float(outline) if self._spread else 0.0
        for sighting in detect(region, families_of([path.marker.id]), (int(left), int(top)), least):
            if sighting.marker_id == path.marker.id:
                return self._refined_sighting(frame, sighting)
        return None

    def _refined_sighting(self, frame: ImageFrame, sighting: Sighting) -> FoundMarker | None:
        """Square fitted to a detected marker's edges in the image, with its corners; None if the fit fails.

        The square is in pixels free of lens distortion; its corners (4, 2) are given as in the image, with
        distortion [raw px], too.

        Args:
            frame: the image.
            sighting: the marker as detected, from whose corners [raw px] the fit starts.
        """
        ideal = undistort(self._camera, sighting.corners_px)
        fit = find_square(frame.image, self._pixels, ideal, sighting.corners_px)
        return None if fit is None else self._with_raw_corners(fit)

    def _with_raw_corners(self, fit: SquareFit) -> FoundMarker:
        """Marker found in a frame: its fitted square, and corners (4, 2) with lens distortion [raw px].

        Args:
            fit: the square fitted to the marker's edges, with corners free of distortion.
        """
        return FoundMarker(fit, distort(self._camera, fit.square.corners))

    def _region(self, found: dict[int | str, FoundMarker]) -> tuple[slice, slice]:
        """Rows and columns of the image to search: all, or those where the body's other markers can be."""
        low, high = np.zeros(2, dtype=int), np.array([self._camera.width, self._camera.height])
        if self.frames_total > _FULL_SCANS:
            for marker_id, seen in found.items():
                edges = np.linalg.norm(seen.corners_raw - np.roll(seen.corners_raw, 1, axis=0), axis=1)
                spread_px = self._spread.get(marker_id, np.inf) * float(edges.max())
                if np.isfinite(spread_px):
                    centre = seen.corners_raw.mean(axis=0)
                    low = np.maximum(low, (centre - spread_px).astype(int))
                    high = np.minimum(high, (centre + spread_px).astype(int) + 1)
        return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))

    def _scan(self, frame: ImageFrame, region: tuple[slice, slice]) -> list[Sighting]:
        """Search a region of the image for the followed markers, and count the sightings of unknown ones.

        Args:
            frame: the image.
            region: rows and columns to search.

        Returns:
            List of the followed markers in the frame, with corners accurate to about half a pixel; empty if
            none is there.

        Raises:
            TrackingError: a marker of the object is in the image twice.
        """
        known: list[Sighting] = []
        seen: set[int | str] = set()
        rows, columns = region
        for sighting in detect(frame.image[rows, columns], self._families, (columns.start, rows.start)):
            if sighting.marker_id in seen and sighting.marker_id in self._known:
                raise TrackingError(
                    f"marker {sighting.marker_id} is in view twice: cover or remove one,"
                    " every marker needs its own id"
                )
            if sighting.marker_id in self._paths:
                known.append(sighting)
            elif sighting.marker_id not in seen and sighting.marker_id not in self._known:
                self._unknown[sighting.marker_id] = self._unknown.get(sighting.marker_id, 0) + 1
            seen.add(sighting.marker_id)
        return known

    def _record(self, frame: ImageFrame, found: dict[int | str, FoundMarker]) -> None:
        """Append the markers found in a frame to their paths; for the others count one more missed frame.

        The count is of frames missed in a row: it returns to 0 when the marker is found. Frames before a
        marker was first found do not count.
        """
        for marker_id, path in self._paths.items():
            seen = found.get(marker_id)
            if seen is None:
                path.missed += bool(path.time_ns)
                continue
            path.missed = 0
            path.fit = seen.fit
            path.time_ns.append(frame.time_ns)
            path.corners_ideal.append(seen.fit.square.corners)
            path.corners_raw.append(seen.corners_raw)
            path.sd.append(seen.fit.square.sd)

    def _track(self, path: MarkerPath, delays_s: dict[int, float]) -> MarkerTrack | None:
        """Track of one marker: corners and poses in the camera frame by frame; None if it was never found.

        It is corrected for a rolling shutter. Frames in which the corners are no view of a square are left
        out; None also if no frame remains.

        Args:
            path: corners of the marker in all frames in which it was found.
            delays_s: time to which all corners of a frame are moved, less that of the image's middle row [s],
                by the frame's log time [ns]; empty for a global shutter.
        """
        if not path.time_ns:
            return None
        raw, ideal = np.array(path.corners_raw), np.array(path.corners_ideal)
        late_ns: IntArray | None = None
        if delays_s:
            common_s = np.array([delays_s[time_ns] for time_ns in path.time_ns])
            since_s: Array = 1e-9 * (np.array(path.time_ns, dtype=np.int64) - path.time_ns[0]).astype(
                np.float64
            )
            ideal = corners_at_one_time(
                since_s, ideal, row_delay_s(self._camera, raw[..., 1]), common_s, float(np.median(path.sd))
            )
            raw, late_ns = distort(self._camera, ideal), np.rint(1e9 * common_s).astype(np.int64)
        solved = solve_poses(ideal, path.marker.size, self._camera.K)
        kept = [i for i, pair in enumerate(solved) if pair is not None]
        pairs = [pair for pair in solved if pair is not None]
        if not kept:
            return None
        late_ns = None if late_ns is None else late_ns[kept]
        time_ns = np.array(path.time_ns, dtype=np.int64)[kept] + (0 if late_ns is None else late_ns)
        sd = np.array(path.sd)[kept]
        chosen = choose_by_motion(pairs, time_ns.astype(float), sd)
        return MarkerTrack(
            marker_id=path.marker.id,
            time_ns=time_ns,
            corners_px=raw[kept],
            corner_sd_px=sd,
            R_camera_marker=np.array(
                [pair.R_camera_marker[c] for pair, c in zip(pairs, chosen, strict=True)]
            ),
            p_camera_marker=np.array(
                [pair.p_camera_marker[c] for pair, c in zip(pairs, chosen, strict=True)]
            ),
            frames_total=self.frames_total,
            late_ns=late_ns,
        )


def track_markers(
    frames: Iterable[ImageFrame],
    camera: CameraModel,
    markers: Sequence[Marker],
    expected: Sequence[int | str] = (),
) -> TrackingReport:
    """Track the markers of an object through all frames of a strike.

    Args:
        frames: images in order of time.
        camera: camera that took them.
        markers: all markers of the object.
        expected: ids of the markers expected in view. Once one of them is found, all markers that are not
            expected are dropped, with their earlier observations.

    Returns:
        Tracks of the followed markers that were found, with poses in the camera frame; unknown markers (in
        view, but not on the object); and the log times [ns] of all frames. Tracks and unknown markers are
        empty if no marker was seen.

    Raises:
        TrackingError: a marker of the object is in view twice, only markers that are not on it are in view,
            an image has another size than the calibration, or the line time (delay from image row to row) is
            too long for the frame rate.
    """
    follower = MarkerFollower(camera, markers, expected)
    for frame in frames:
        follower.add(frame)
    return follower.report()
