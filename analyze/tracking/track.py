"""Markers through the frames of one strike: found once in the whole image, then followed where the motion says they are."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.errors import TrackingError
from analyze.tracking.camera_model import distort, pixel_map, undistort
from analyze.tracking.edges import find_again, find_square
from analyze.tracking.marker import Sighting, detect, families_of, is_marker, of_another_family
from analyze.tracking.pose import choose_by_motion, solve_poses
from analyze.tracking.rolling_shutter import at_one_time
from analyze.types import MarkerTrack
from schemas.tags import family_and_id, name_order

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from analyze.tracking.edges import Square, SquareFit
    from analyze.types import Array, CameraModel, ImageFrame, IntArray, Marker

_FULL_SCANS = 2
"""first frames that are searched completely, for markers that should not be there"""
_RESCAN_EVERY = 25
"""frames between full searches while a marker is missing"""
_LOOKED_FOR = 8
"""frames that a lost marker is looked for near its last place; one that has turned away would cost a search in every frame"""
_NEAR_PX = 1.2
"""a fit that moved farther than this from its start is not trusted without OpenCV's reading"""
_LONGEST_READING = 1.05
"""of the time between two frames: no sensor reads its rows for longer"""


@dataclass(frozen=True)
class Gap:
    """Frames in which a marker was not found."""

    marker_id: int | str
    start_ns: int
    """first frame without it"""
    frames: int


@dataclass(frozen=True)
class TrackingReport:
    """Tracks with what a reader must know about them."""

    tracks: tuple[MarkerTrack, ...]
    unknown_ids: tuple[int | str, ...]
    """markers of its families that the object does not carry"""
    gaps: tuple[Gap, ...]
    image_times_ns: IntArray
    """of all images that were looked at"""

    @property
    def unmarked_ns(self) -> IntArray:
        """Times of the images in which no marker was found."""
        return np.setdiff1d(self.image_times_ns, np.concatenate([np.zeros(0, dtype=np.int64), *(track.frame_ns for track in self.tracks)]))

    @property
    def images_end_ns(self) -> int:
        """Time of the last image, 0 where there was none."""
        return int(self.image_times_ns[-1]) if len(self.image_times_ns) else 0

    @property
    def frames_total(self) -> int:
        """Images that were looked at."""
        return len(self.image_times_ns)


@dataclass(frozen=True)
class _Seen:
    """A marker in one frame."""

    fit: SquareFit
    corners_raw: Array
    """(4, 2) px"""


@dataclass
class _Path:
    """What is known of one marker so far."""

    marker: Marker
    time_ns: list[int] = field(default_factory=list)
    corners_raw: list[Array] = field(default_factory=list)
    corners_ideal: list[Array] = field(default_factory=list)
    sd: list[float] = field(default_factory=list)
    missed: int = 0
    fit: SquareFit | None = None
    """the newest"""

    def predict(self, time_ns: int) -> tuple[Array, Array, float]:
        """Expected raw and ideal corners (4, 2), and how far off they may be [px], at constant velocity."""
        raw, ideal = self.corners_raw[-1], self.corners_ideal[-1]
        if len(self.time_ns) < 2:
            return raw, ideal, 4.0
        step = self.time_ns[-1] - self.time_ns[-2]
        ratio = min((time_ns - self.time_ns[-1]) / step, 4.0) if step > 0 else 0.0
        move = (raw - self.corners_raw[-2]) * ratio
        moved = ideal + (ideal - self.corners_ideal[-2]) * ratio
        return raw + move, moved, 6.0 + 1.5 * float(np.abs(move).max()) + 4.0 * self.missed


class MarkerFollower:
    """Finds the markers of one object frame by frame. Feed frames in the order of time.

    Args:
        camera: that took the frames.
        markers: all that the object carries.
        expected: ids of those that the camera shall see; once one of them was found the others are not followed, each costs milliseconds.
        rescan_every: frames between full searches while a marker is missing.
    """

    def __init__(
        self, camera: CameraModel, markers: Sequence[Marker], expected: Sequence[int | str] = (), rescan_every: int = _RESCAN_EVERY
    ) -> None:
        self._camera = camera
        self._pixels = pixel_map(camera)
        self._paths = {marker.id: _Path(marker) for marker in markers}
        self._rescan_every = rescan_every
        self._known = frozenset(self._paths)
        self._expected = frozenset(expected) & self._known
        self._families = families_of(self._known)
        self._unknown: dict[int | str, int] = {}
        self._first: NDArray[np.uint8] | None = None
        self._gaps: list[Gap] = []
        self._image_times_ns: list[int] = []

    @property
    def frames_total(self) -> int:
        """Frames that were given."""
        return len(self._image_times_ns)

    def add(self, frame: ImageFrame) -> dict[int | str, Square]:
        """Markers found in this frame, by id.

        Raises:
            TrackingError: one marker stands in the image twice.
        """
        if frame.image.shape != (self._camera.height, self._camera.width):
            raise TrackingError(
                f"image {frame.sequence} has {frame.image.shape[1]} x {frame.image.shape[0]} px, the calibration"
                f" {self._camera.width} x {self._camera.height}: recalibrate, or use the rig file of this recording"
            )
        self._image_times_ns.append(frame.time_ns)
        if self._first is None:
            self._first = frame.image
        found: dict[int | str, _Seen] = {}
        for marker_id, path in self._paths.items():
            if path.time_ns and (seen := self._follow(frame, path)) is not None:
                found[marker_id] = seen
        missing = [marker_id for marker_id, path in self._paths.items() if marker_id not in found and path.time_ns]
        # Nothing seen yet: search more often than for what is merely hidden.
        due = self.frames_total <= _FULL_SCANS or (self.frames_total % self._rescan_every == 0 and len(found) < len(self._paths))
        if due or any(self._paths[i].missed == 1 for i in missing):
            for sighting in self._scan(frame):
                if sighting.marker_id not in found and (seen := self._found(frame, sighting)) is not None:
                    found[sighting.marker_id] = seen
        self._note(frame, found)
        if any(self._paths[marker_id].time_ns for marker_id in self._expected):
            self._paths = {marker_id: self._paths[marker_id] for marker_id in self._paths if marker_id in self._expected}
            self._expected = frozenset()
        return {marker_id: seen.fit.square for marker_id, seen in found.items()}

    def report(self) -> TrackingReport:
        """Tracks of all markers that were found, with poses.

        Raises:
            TrackingError: only markers that the object does not carry were seen, or the camera's line time is none of these frames.
        """
        late = self._lateness()
        tracks = tuple(track for path in self._paths.values() if (track := self._track(path, late)) is not None)
        unknown = tuple(sorted((i for i, times in self._unknown.items() if times >= min(2, self.frames_total)), key=name_order))
        known = ", ".join(str(i) for i in sorted(self._known, key=name_order)) or "none"
        if not tracks and not unknown and self._first is not None and (other := of_another_family(self._first, self._families)) is not None:
            family, tag_id = family_and_id(other)
            raise TrackingError(
                f"what looks like marker {tag_id} of {family} is in view, the object carries {known}: correct its family in the object file"
            )
        if unknown and not tracks:
            raise TrackingError(f"marker {unknown[0]} is in view, but the object carries {known}: correct the object file or the marker")
        return TrackingReport(tracks, unknown, tuple(self._gaps), np.array(self._image_times_ns, dtype=np.int64))

    def _follow(self, frame: ImageFrame, path: _Path) -> _Seen | None:
        expected, expected_ideal, reach = path.predict(frame.time_ns)
        if path.missed == 0:
            fit = None if path.fit is None else find_again(frame.image, path.fit, expected_ideal)
            fit = fit or find_square(frame.image, self._pixels, expected_ideal, expected)
            seen = None if fit is None else self._placed(fit)
            if seen is not None and self._trusted(frame, seen, expected, path.marker.id):
                return seen
        if path.missed >= _LOOKED_FOR:
            return None
        margin = int(reach + 0.35 * float(np.ptp(expected, axis=0).max())) + 2
        left, top = np.maximum(np.floor(expected.min(axis=0)).astype(int) - margin, 0)
        right, bottom = np.ceil(expected.max(axis=0)).astype(int) + margin
        region = frame.image[top:bottom, left:right]
        if min(region.shape) < 16:
            return None
        for sighting in detect(region, families_of([path.marker.id]), (int(left), int(top))):
            if sighting.marker_id == path.marker.id:
                return self._found(frame, sighting)
        return None

    def _trusted(self, frame: ImageFrame, seen: _Seen, expected: Array, marker_id: int | str) -> bool:
        return float(np.abs(seen.corners_raw - expected).max()) < _NEAR_PX and is_marker(frame.image, seen.corners_raw, marker_id)

    def _found(self, frame: ImageFrame, sighting: Sighting) -> _Seen | None:
        ideal = undistort(self._camera, sighting.corners_px)
        fit = find_square(frame.image, self._pixels, ideal, sighting.corners_px)
        return None if fit is None else self._placed(fit)

    def _placed(self, fit: SquareFit) -> _Seen:
        return _Seen(fit, distort(self._camera, fit.square.corners))

    def _scan(self, frame: ImageFrame) -> list[Sighting]:
        known: list[Sighting] = []
        seen: set[int | str] = set()
        for sighting in detect(frame.image, self._families):
            if sighting.marker_id in seen and sighting.marker_id in self._known:
                raise TrackingError(f"marker {sighting.marker_id} is in view twice: cover or remove one, every marker needs its own id")
            if sighting.marker_id in self._paths:
                known.append(sighting)
            elif sighting.marker_id not in seen and sighting.marker_id not in self._known:
                self._unknown[sighting.marker_id] = self._unknown.get(sighting.marker_id, 0) + 1
            seen.add(sighting.marker_id)
        return known

    def _note(self, frame: ImageFrame, found: dict[int | str, _Seen]) -> None:
        for marker_id, path in self._paths.items():
            seen = found.get(marker_id)
            if seen is None:
                if path.time_ns:
                    path.missed += 1
                    if path.missed == 1:
                        self._gaps.append(Gap(marker_id, frame.time_ns, 1))
                    else:
                        index = max(i for i, gap in enumerate(self._gaps) if gap.marker_id == marker_id)
                        self._gaps[index] = Gap(marker_id, self._gaps[index].start_ns, path.missed)
                continue
            path.missed = 0
            path.fit = seen.fit
            path.time_ns.append(frame.time_ns)
            path.corners_ideal.append(seen.fit.square.corners)
            path.corners_raw.append(seen.corners_raw)
            path.sd.append(seen.fit.square.sd)

    def _lateness(self) -> dict[int, float]:
        """By how much [s] the middle of the markers in view is read later than the middle row, by frame; none of a global shutter."""
        if not self._camera.line_time_s:
            return {}
        rows: dict[int, list[float]] = {}
        for path in self._paths.values():
            for time_ns, corners in zip(path.time_ns, path.corners_raw, strict=True):
                rows.setdefault(time_ns, []).append(float(corners[:, 1].mean()))
        reading_s = abs(self._camera.line_time_s) * self._camera.height
        apart_s = 1e-9 * float(np.median(np.diff(sorted(rows)))) if len(rows) > 1 else reading_s
        if reading_s > _LONGEST_READING * apart_s:
            raise TrackingError(
                f"line_time_s says that an image is read in {1000 * reading_s:.1f} ms, but one comes every {1000 * apart_s:.1f} ms: "
                "correct it, or the frame rate"
            )
        return {time_ns: self._late(float(np.mean(found))) for time_ns, found in rows.items()}

    def _late(self, row: Any) -> Any:
        """By how much [s] a row is read later than the middle row, of which a frame's time is."""
        return self._camera.line_time_s * (row - 0.5 * (self._camera.height - 1))

    def _track(self, path: _Path, late: dict[int, float]) -> MarkerTrack | None:
        if not path.time_ns:
            return None
        raw, ideal = np.array(path.corners_raw), np.array(path.corners_ideal)
        late_ns: IntArray | None = None
        if late:
            common_s = np.array([late[time_ns] for time_ns in path.time_ns])
            since_s: Array = 1e-9 * (np.array(path.time_ns, dtype=np.int64) - path.time_ns[0]).astype(np.float64)
            ideal = at_one_time(since_s, ideal, self._late(raw[..., 1]), common_s, float(np.median(path.sd)))
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
            R_camera_marker=np.array([pair.R_camera_marker[c] for pair, c in zip(pairs, chosen, strict=True)]),
            p_camera_marker=np.array([pair.p_camera_marker[c] for pair, c in zip(pairs, chosen, strict=True)]),
            frames_total=self.frames_total,
            late_ns=late_ns,
        )


def track_markers(
    frames: Iterable[ImageFrame], camera: CameraModel, markers: Sequence[Marker], expected: Sequence[int | str] = ()
) -> TrackingReport:
    """Follow `markers` through `frames` (in the order of time), with what else was seen; see MarkerFollower.

    Raises:
        TrackingError: a marker is in view twice, or only unknown ones are.
    """
    follower = MarkerFollower(camera, markers, expected)
    for frame in frames:
        follower.add(frame)
    return follower.report()
