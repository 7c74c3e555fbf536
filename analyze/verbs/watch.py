"""`analyze watch`: looks at a recording while it grows, says what is in view, and judges strikes. JSON lines in and out.

Runs as a child of the daemon on a core it shares with the capture: single-threaded, at most twelve images a second are looked at, and
nothing is decoded that is not. Images of a strike are kept as references until they are judged.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

from analyze.errors import AnalyzeError
from analyze.geometry.station import turned_camera
from analyze.motion.contact_time import contact_time
from analyze.motion.scene import at_rest, check_placement, read_scene
from analyze.motion.strike import StrikeTask, analyse_strike, verdict_of
from analyze.pipeline.sections import MeshSections
from analyze.reading.followed_series import FollowedSeries
from analyze.tracking.camera_model import camera_from_spec, pixel_map
from analyze.tracking.marker import families_of
from analyze.tracking.track import track_markers
from analyze.types import Marker
from schemas import topics
from schemas.document import DocumentError, canonical_json, validate
from schemas.result import Verdict
from schemas.tags import name_order
from schemas.watch_lines import JudgeRequest, SeenMarker, StrikeVerdict, WatchEvent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any, TextIO

    from analyze.motion.scene import Scene
    from analyze.types import CameraModel, ImageFrame
    from schemas.object_spec import ObjectSpec
    from schemas.strike_plan import PlannedStrike, StrikePlan

_LOOK_EVERY_NS = 83_000_000
_FRESH_NS = 1_000_000_000
"""what is older than the newest image by more is past: who comes late, or was held up, does not look at it"""
_POLL_S = 0.04
_KEEP_NS = 12_000_000_000
_WAIT_FOR_FILE_S = 3.0
_REST_BEFORE_NS = 600_000_000
_TIP_AFTER_NS = 1_800_000_000
"""what a verdict looks at around the contact: the slowest tip over the top takes about 1 s"""
_MOVED_PX = 3.0
"""a marker that is so far from where it was is no longer at rest; what a hand does near the object moves it less"""


class WatchClock(Protocol):
    """What `watch` needs of time."""

    def monotonic(self) -> float:
        """Seconds."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait."""
        ...


class SystemWatchClock:
    """The machine's clock."""

    def monotonic(self) -> float:
        """Seconds of the monotonic clock."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


class StoredImage(Protocol):
    """An image message as it stands in the file."""

    @property
    def log_time_ns(self) -> int:
        """Mid-exposure."""
        ...


def markers_of(spec: ObjectSpec) -> list[Marker]:
    """Markers of an object as the trackers want them."""
    return [Marker(m.name, m.size_m, None if m.T_object_marker is None else np.array(m.T_object_marker, dtype=float)) for m in spec.marker]


class Observer:
    """What `analyze watch` knows and says. Feed images in the order of time; `decode` is called for those that are looked at."""

    def __init__(
        self,
        camera: CameraModel,
        markers: list[Marker],
        plan: StrikePlan,
        decode: Callable[[Any], ImageFrame],
        sections: MeshSections | None = None,
    ) -> None:
        self._camera = camera
        self._decode = decode
        self._sections = sections
        self._markers = markers
        self._by_id = {marker.id: marker for marker in markers}
        self._families = families_of(self._by_id)
        self._strikes: dict[str, PlannedStrike] = {strike.id: strike for strike in plan.strikes}
        self._expected: PlannedStrike | None = None
        self._scenes: deque[Scene] = deque(maxlen=12)
        self._seen: deque[Scene] = deque()
        """as long as the images are kept"""
        self._images: deque[StoredImage] = deque()
        self._looked_ns = 0
        pixel_map(camera)

    @property
    def newest_ns(self) -> int:
        """log_time of the newest image, 0 before the first."""
        return self._images[-1].log_time_ns if self._images else 0

    def expect(self, plan_strike_id: str) -> None:
        """Compare the placement with this planned strike from now on."""
        self._expected = self._strikes.get(plan_strike_id)

    def keep(self, image: StoredImage) -> None:
        """Take an image in that is too old to be looked at; a strike that is judged may want it."""
        self._images.append(image)
        while image.log_time_ns - self._images[0].log_time_ns > _KEEP_NS:
            self._images.popleft()

    def add(self, image: StoredImage) -> WatchEvent | None:
        """Take an image in; an event where it was time to look at one."""
        self.keep(image)
        if 0 <= image.log_time_ns - self._looked_ns < _LOOK_EVERY_NS:
            return None
        self._looked_ns = image.log_time_ns
        scene = read_scene(self._decode(image), self._camera, self._families)
        self._scenes.append(scene)
        self._seen.append(scene)
        while scene.time_ns - self._seen[0].time_ns > _KEEP_NS:
            self._seen.popleft()
        seen = [
            SeenMarker(id=i, corners_px=np.round(corners, 2).tolist())
            for i, corners in sorted(scene.corners.items(), key=lambda item: name_order(item[0]))
        ]
        still = at_rest(self._scenes)
        error, text = None, ""
        if self._expected is not None:
            check = check_placement(scene, self._by_id, turned_camera(self._camera, self._expected.heading_rad), self._expected)
            error, text = check.error, check.text
        return WatchEvent(
            time_ns=image.log_time_ns,
            markers=seen,
            at_rest=still,
            saturated_fraction=scene.saturated_fraction,
            placement_error_rad=error,
            text=text,
        )

    def judge(self, request: JudgeRequest) -> StrikeVerdict:
        """Verdict on a window whose images are here. Never raises: what cannot be read is a verdict too."""
        planned = self._strikes.get(request.plan_strike_id)
        if planned is None:
            known = ", ".join(self._strikes) or "none"
            return StrikeVerdict(
                strike_id=request.strike_id,
                code=Verdict.UNREADABLE,
                reason=f"the plan has no strike {request.plan_strike_id!r}: it has {known}",
            )
        try:
            camera = turned_camera(self._camera, planned.heading_rad)
            report = track_markers(self._window(request), camera, self._markers, planned.visible_markers)
            section = None if self._sections is None else self._sections.of(planned)
            lands_at = None if self._sections is None else self._sections.lands_at(planned)
            task = StrikeTask(
                request.strike_id, planned, request.contact_time_ns, report.images_end_ns, section, lands_at, report.unmarked_ns
            )
            motion = analyse_strike(report.tracks, self._markers, camera, task)
        except AnalyzeError as error:
            return StrikeVerdict(strike_id=request.strike_id, code=Verdict.UNREADABLE, reason=str(error))
        contact = contact_time(motion.fit) if motion.fit else None
        timed = {"contact_time_ns": contact.time_ns, "contact_time_sd_ns": contact.sd_ns} if contact else {}
        return verdict_of(motion).model_copy(update=timed)

    def _span(self, request: JudgeRequest) -> tuple[int, int]:
        """What is looked at of a window: the rest before the contact, and the tip after it."""
        start, end = request.window_start_ns, request.window_end_ns or self.newest_ns
        contact = request.contact_time_ns or self._began_to_move(start, end)
        if contact:
            start, end = max(start, contact - _REST_BEFORE_NS), min(end, contact + _TIP_AFTER_NS)
        return start, end

    def _began_to_move(self, start: int, end: int) -> int:
        """The last look that saw a marker where it had rested, 0 where none did: for a contact that nobody felt.

        A hand may take seconds; to follow the marker through all of them would take longer than anybody waits for a verdict.
        """
        rest: dict[int | str, Any] = {}
        before = 0
        for scene in self._seen:
            if start <= scene.time_ns <= end:
                for marker, corners in scene.corners.items():
                    if np.abs(corners - rest.setdefault(marker, corners)).max() > _MOVED_PX:
                        return before
                    before = scene.time_ns
        return before

    def _window(self, request: JudgeRequest) -> Iterator[ImageFrame]:
        start, end = self._span(request)
        return (self._decode(image) for image in list(self._images) if start <= image.log_time_ns <= end)


def _read_lines(stream: TextIO, lines: queue.SimpleQueue[str | None]) -> None:
    try:
        for line in stream:
            lines.put(line)
    except (OSError, ValueError):
        pass  # closed under us: the same as its end
    lines.put(None)


def _say(stdout: TextIO, document: WatchEvent | StrikeVerdict) -> bool:
    """Write one line; False when nobody reads any more."""
    try:
        stdout.write(canonical_json(document) + "\n")
        stdout.flush()
    except (OSError, ValueError):
        return False
    return True


def watch(path: Path, stdin: TextIO, stdout: TextIO, clock: WatchClock | None = None) -> None:
    """Follow a recording until `stdin` ends, from file to file where it is a row of them. What had been recorded before is not looked at.

    Args:
        path: the growing recording; it may not exist yet.
        stdin: JudgeRequest lines.
        stdout: WatchEvent and StrikeVerdict lines.
        clock: for pauses and patience; the machine's by default.

    Raises:
        RecordingError: the file is no recording, or did not appear while `stdin` was open.
    """
    clock = clock or SystemWatchClock()
    cv2.setNumThreads(1)
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    reader = threading.Thread(target=_read_lines, args=(stdin, lines), name="watch-stdin", daemon=True)
    reader.start()
    recording = FollowedSeries(path)
    try:
        _follow(recording, lines, stdout, clock)
    finally:
        recording.close()


def _follow(recording: FollowedSeries, lines: queue.SimpleQueue[str | None], stdout: TextIO, clock: WatchClock) -> None:
    observer: Observer | None = None
    topic = ""
    expected = ""
    pending: deque[tuple[float, JudgeRequest]] = deque()
    while True:
        ended = False
        while not lines.empty():
            line = lines.get()
            if line is None:
                ended = True
                break
            try:
                request = validate(JudgeRequest, json.loads(line), "standard input")
            except (DocumentError, ValueError, RecursionError):
                continue  # a line that is not for us
            if request.kind == "expect":
                expected = request.plan_strike_id
                if observer is not None:
                    observer.expect(expected)
            else:
                pending.append((clock.monotonic() + _WAIT_FOR_FILE_S, request))
        messages = recording.poll()
        if observer is None and recording.manifest is not None and (plan := recording.plan) is not None:
            camera = recording.manifest.cameras[0]
            topic = topics.raw_image(camera.name).name
            spec = recording.manifest.object
            sections = MeshSections(spec, lambda: recording.shape_bytes)
            observer = Observer(camera_from_spec(camera.calibration), markers_of(spec), plan, recording.image, sections)
            observer.expect(expected)
        images = [message for message in messages if message.topic == topic]
        fresh_ns = images[-1].log_time_ns - _FRESH_NS if images else 0
        if observer is not None:
            for message in images:
                if message.log_time_ns < fresh_ns:
                    observer.keep(message)
                    continue
                event = observer.add(message)
                if event is not None and not _say(stdout, event):
                    return
        while pending:
            patience, request = pending[0]
            held = observer is not None and observer.newest_ns >= request.window_end_ns
            if not held and not ended and clock.monotonic() < patience:
                break
            pending.popleft()
            verdict = (
                StrikeVerdict(
                    strike_id=request.strike_id,
                    code=Verdict.UNREADABLE,
                    reason="the recording holds no images yet: is the capture running?",
                )
                if observer is None
                else observer.judge(request)
            )
            if not _say(stdout, verdict):
                return
        if ended:
            recording.refuse_missing()
            return
        clock.sleep(_POLL_S)
