"""Send a recording to a replay: for each strike its images and its motion, at the end the answer."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import rerun as rr

from analyze.errors import AnalyzeError, PlanError, RecordingError
from analyze.replay.layout import ANSWER, StrikePage, TossPage, layout, timeline_of
from analyze.replay.markdown import message
from analyze.replay.palette import Colour, distinct_colour
from analyze.replay.pictures import ImageChoice, send_pictures
from analyze.replay.session_scene import send_state_names
from analyze.replay.timelines import Timelines, strike_path, toss_path
from analyze.replay.words import answer_text, no_answer_text, unread_text, waiting_text

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.cache.results import ResultCache
    from analyze.flight.toss import TossMotion
    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.evidence import StrikeReading, StrikeSource, StruckObject
    from analyze.reading.recording import Recording
    from analyze.replay.body import SceneInputs
    from analyze.types import Array
    from schemas.proto import percuss_pb2 as pb


_AROUND_FLIGHT_NS = 300_000_000
"""time before and after a flight for which images are sent [ns]"""


@dataclass(frozen=True)
class ReplayOptions:
    """Options of a replay, given by the user."""

    object_path: Path | None = None
    """Object file that replaces the recording's; None to use the recording's."""
    exclude: frozenset[str] = frozenset()
    """Ids of strikes and tosses that the answer leaves out."""
    images: ImageChoice = field(default_factory=ImageChoice)
    """Selection and encoding of the images."""
    page: str | None = None
    """Page shown in front; None for the newest strike and, at the end, the answer."""
    cache: ResultCache | None = None
    """Cache of strikes read and estimates made before; None to compute all anew."""


class Sender:
    """Sender of one recording's replay to a viewer or a file.

    A replay has pages (tabs of the viewer): one for the answer (the estimate with its warnings), one per
    strike, one for the session.

    Args:
        timelines: the rerun stream to send to, with its two time axes (since a strike's contact, and since
            the session's start).
        name: name of the recording, for display.
        options: options given by the user.
    """

    def __init__(self, timelines: Timelines, name: str, options: ReplayOptions) -> None:
        self.timelines, self._stream = timelines, timelines.stream
        self._name, self._options = name, options
        self._pages: list[StrikePage] = []
        self._toss_pages: list[TossPage] = []
        self._tosses: list[TossMotion] = []
        self._readings: list[StrikeReading] = []
        self._struck: StruckObject | None = None
        self._body: SceneInputs | None = None
        self._object_requested = False
        self.damage: list[str] = []
        """Parts of the file that could not be read, one line each."""
        self.no_answer: list[str] = []
        """Reasons why there is no answer, one line each; empty if there is one."""

    # --- pages

    def add_pages(self, records: Sequence[pb.StrikeRecord], *, more: bool) -> None:
        """Add a page (tab of the viewer) for each strike, and send the layout with one page in front.

        In front is the page that the user asked for, else the newest strike's, or the first strike's if no
        more follow; without any strike it is the page of the estimate.

        Args:
            records: strikes as recorded.
            more: True if further strikes may follow.
        """
        self._pages += [StrikePage(record.strike_id) for record in records]
        for record in records:
            self._send_text(
                f"{strike_path(record.strike_id)}/text",
                unread_text(record.strike_id, record.verdict_code, "Its motion is being measured."),
            )
        send_state_names(self.timelines, [record.strike_id for record in records])
        self._send_progress(more=more)
        newest = (self._pages[-1] if more else self._pages[0]).strike_id if self._pages else ANSWER
        self.send_layout(newest)

    def send_layout(self, front: str) -> None:
        """Send to the viewer the layout of all pages (tabs of the viewer).

        Args:
            front: name of the page to show first, unless the user asked for another one.
        """
        self._stream.send_blueprint(
            layout(self._pages, self._options.page or front, self._bounds(), self._toss_pages)
        )

    def _bounds(self) -> Array | None:
        return None if self._body is None else self._body.model.bounds

    def _colours(self) -> dict[str, Colour]:
        return {page.strike_id: distinct_colour(number) for number, page in enumerate(self._pages)}

    def _send_progress(self, *, more: bool) -> None:
        self._send_text(
            "/summary", waiting_text(self._name, len(self._readings), None if more else len(self._pages))
        )

    def _send_text(self, path: str, text: str) -> None:
        self._stream.log(path, rr.TextDocument(text, media_type="text/markdown"), static=True)

    def shown_moment_s(self) -> float:
        """Time since contact [s] at which the replay's front page (tab) shows an object near its balance.

        It is the time near balance of the strike whose page the user asked for, else of the first strike with
        verdict good; 0.2 s if there is neither, or if its motion was not measured.
        """
        from analyze.replay.views import balance_moment
        from schemas.strike_result import Verdict

        for toss in self._tosses:
            if toss.toss_id == self._options.page and toss.flight_s is not None:
                return 0.5 * toss.flight_s
        requested = [each for each in self._readings if each.motion.strike_id == self._options.page]
        good = [each for each in self._readings if each.motion.verdict is Verdict.GOOD]
        shown = next(iter([*requested, *good]), None)
        if shown is None:
            return balance_moment(None, None)
        return balance_moment(shown.motion, self.timelines.contact_of(shown.record))

    def shown_timeline(self) -> str:
        """Name of the timeline of the page in front."""
        return timeline_of(self._options.page, struck=bool(self._pages or self._toss_pages))

    # --- strikes

    def send_images(self, source: StrikeSource, record: pb.StrikeRecord) -> None:
        """Send a strike's images, up to the first damaged one; damage is added to `damage`.

        Args:
            source: recording.
            record: the strike as recorded.
        """
        root, contact_ns = strike_path(record.strike_id), self.timelines.contact_of(record)
        frames = source.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns)
        try:
            send_pictures(self.timelines, f"{root}/camera/image", frames, contact_ns, self._options.images)
        except RecordingError as error:
            self.damage.append(str(error))

    def analyse_strike(self, source: StrikeSource, record: pb.StrikeRecord, *, more: bool) -> None:
        """Measure a strike's motion and send it to the viewer, or the reason why it cannot be measured.

        The first call imports the numerical modules and sends the object's shape. The sender's list `damage`
        gets the error text of a damaged file, its list `no_answer` that of an object or plan that cannot be
        used.

        Args:
            source: recording.
            record: the strike as recorded; its page (tab of the viewer) must have been added.
            more: True if further strikes may follow.
        """
        from analyze.pipeline.cached import cached_strike_reader
        from analyze.replay.strike_scene import send_strike
        from analyze.replay.views import contact_from_motion

        struck, body = self._object(source)
        if struck is None or body is None:
            why = f"Its motion cannot be measured: {self.no_answer[0]}"
            self._send_text(
                f"{strike_path(record.strike_id)}/text",
                unread_text(record.strike_id, record.verdict_code, why),
            )
            return
        try:
            read_strike = cached_strike_reader(self._options.cache)
            reading = read_strike(source, struck, list(body.markers), record)
        except (RecordingError, PlanError) as error:
            (self.damage if isinstance(error, RecordingError) else self.no_answer).append(str(error))
            self._send_text(
                f"{strike_path(record.strike_id)}/text",
                unread_text(record.strike_id, record.verdict_code, str(error)),
            )
            return
        self._readings.append(reading)
        self._pages = [
            StrikePage(page.strike_id, reading.motion.verdict.value.replace("_", " "))
            if page.strike_id == record.strike_id
            else page
            for page in self._pages
        ]
        if not record.contact_time_ns and (contact_ns := contact_from_motion(reading.motion)) is not None:
            self.timelines.state_contact(record.strike_id, contact_ns)
        colour = self._colours()[record.strike_id]
        send_strike(self.timelines, record, reading.motion, reading.report, body, colour)
        self._send_progress(more=more)

    # --- tosses

    def send_tosses(self, recording: Recording) -> None:
        """Read the tosses of a complete recording, and send a page for each: flight and images.

        Damage of the recording is added to `damage`; a toss that cannot be read has no page.
        """
        from analyze.pipeline.cached import cached_toss_reader
        from analyze.pipeline.evidence import usable_rest_views
        from analyze.pipeline.toss_marks import toss_marks
        from analyze.replay.toss_scene import flight_span, send_toss

        struck, body = self._object(recording) if recording.tosses else (None, None)
        if struck is None or body is None:
            return
        read_toss = cached_toss_reader(self._options.cache)
        marks = toss_marks(list(body.markers), usable_rest_views(self._readings), body.model)
        for record in recording.tosses:
            try:
                toss = read_toss(recording, struck, marks, record)
            except RecordingError as error:
                self.damage.append(str(error))
                continue
            self._tosses.append(toss)
            self._toss_pages.append(send_toss(self.timelines, toss, body, struck, recording.manifest))
            self._send_toss_images(recording, record, flight_span(toss))
            recording.release_memory()

    def _send_toss_images(
        self, recording: Recording, record: pb.TossRecord, flight: tuple[int, int] | None
    ) -> None:
        """Send the images of a toss's flight, all of them, and some before and after.

        In flight the object turns by ten degrees from frame to frame: beside an older image the outlines
        would not lie on it.
        """
        path, choice = f"{toss_path(record.toss_id)}/camera/image", self._options.images
        first_ns, last_ns = record.window_start_ns, record.window_end_ns
        spans = [(first_ns, last_ns, choice)]
        start_ns = first_ns
        if flight is not None:
            start_ns, end_ns = flight
            spans = [
                (max(start_ns - _AROUND_FLIGHT_NS, first_ns), start_ns - 1, choice),
                (start_ns, end_ns, replace(choice, every_frame=True)),
                (end_ns + 1, min(end_ns + _AROUND_FLIGHT_NS, last_ns), choice),
            ]
        try:
            for start, end, chosen in spans:
                frames = recording.images(start_ns=start, end_ns=end)
                send_pictures(self.timelines, path, frames, start_ns, chosen)
        except RecordingError as error:
            self.damage.append(str(error))

    def _object(self, source: StrikeSource) -> tuple[StruckObject | None, SceneInputs | None]:
        if not self._object_requested:
            self._object_requested = True
            from analyze.pipeline.object_markers import placed_markers
            from analyze.pipeline.read_evidence import struck_object
            from analyze.replay.body import SceneInputs, log_shape
            from analyze.tracking.camera_model import camera_from_spec

            try:
                self._struck = struck_object(source, self._options.object_path)
                camera = camera_from_spec(source.manifest.cameras[0].calibration)
                self._body = SceneInputs(
                    self._struck.model, self._struck.plan, camera, tuple(placed_markers(self._struck.spec))
                )
                self._stream.log("/result", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
                log_shape(self._stream, "/result", self._struck.model)
            except AnalyzeError as error:
                self.no_answer.append(str(error))
        return self._struck, self._body

    # --- the answer

    def send_answer(self, recording: Recording) -> None:
        """Send the viewer the estimate from strikes and tosses, or why there is none; show its page.

        The reason becomes the only entry of the list `no_answer`. If the user chose another page of the
        viewer, that stays in front.

        Args:
            recording: the complete recording.
        """
        from analyze.pipeline.cached import estimate_with_cache
        from analyze.pipeline.estimate import EstimateOptions
        from analyze.pipeline.merge import resolve_exclusions
        from analyze.pipeline.read_evidence import evidence_from_readings, read_open_head

        head = read_open_head(recording)
        try:
            struck, body = self._object(recording)
            if struck is None or body is None or self.no_answer:
                raise PlanError(*self.no_answer[:1])
            if not recording.strikes and not recording.tosses:
                raise PlanError("the recording has no strike")
            options = EstimateOptions(
                self._options.object_path, resolve_exclusions([head], self._options.exclude)
            )
            evidence = evidence_from_readings(head, struck, self._readings)
            evidence = replace(evidence, tosses=tuple(self._tosses))
            self._send_estimate(estimate_with_cache(self._options.cache, evidence, options))
        except AnalyzeError as error:
            text = str(error) if str(error).startswith(str(head.path)) else f"{head.path}: {error}"
            self.no_answer = [text]
            self._send_text("/summary", no_answer_text(self._name, [*self.damage[:1], text]))
        self.send_layout(ANSWER)

    def _send_estimate(self, estimate: Estimate) -> None:
        from analyze.replay.body import log_inside, log_voxels
        from analyze.replay.layout import VOXELS
        from analyze.replay.strike_scene import send_strike_inside
        from analyze.replay.views import drawn_answer

        if self._body is None:
            return
        answer = drawn_answer(estimate)
        colours = self._colours()
        log_inside(self._stream, "/result", self._body.model, answer, colours)
        log_voxels(self._stream, VOXELS, answer)
        for reading in self._readings:
            send_strike_inside(self.timelines, reading.motion, self._body, answer, colours)
        text = answer_text(estimate.evidence.spec.name, answer.result)
        if self.damage:
            text += (
                "\n- **The recording is damaged; the answer uses the readable part: "
                f"{message(self.damage[0])}**"
            )
        self._send_text("/summary", text)
