"""Sends a recording to a stream, strike after strike: images first, then what they show, at last the answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import rerun as rr

from analyze.errors import AnalyzeError, PlanError, RecordingError
from analyze.replay.layout import ANSWER, StrikePage, layout
from analyze.replay.palette import CYCLE, Colour
from analyze.replay.pictures import ImageChoice, send_pictures
from analyze.replay.session_scene import send_lanes
from analyze.replay.timelines import Timelines, contact_of, strike_path
from analyze.replay.words import answer_text, no_answer_text, unread_text, waiting_text

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.evidence import RecordingHead, StrikeReading, StrikeSource, StruckObject
    from analyze.replay.body import Body
    from analyze.types import Array
    from schemas.proto import percuss_pb2 as pb


@dataclass(frozen=True)
class ReplayOptions:
    """What the user may change."""

    object_path: Path | None = None
    exclude: frozenset[str] = frozenset()
    images: ImageChoice = field(default_factory=ImageChoice)
    page: str | None = None
    """that stands in front; None: the newest strike, at last the answer"""


class Sender:
    """What has been sent of one recording.

    Args:
        timelines: of the stream.
        name: of the recording, for people.
        options: the user's.
    """

    def __init__(self, timelines: Timelines, name: str, options: ReplayOptions) -> None:
        self._timelines, self._stream = timelines, timelines.stream
        self._name, self._options = name, options
        self._pages: list[StrikePage] = []
        self._readings: list[StrikeReading] = []
        self._struck: StruckObject | None = None
        self._body: Body | None = None
        self._asked = False
        self.damage: list[str] = []
        """what of the file could not be read, a line each"""
        self.no_answer: list[str] = []
        """why there is none"""

    # --- pages ----------------------------------------------------------------------------------------------------

    def announce(self, records: Sequence[pb.StrikeRecord], *, more: bool) -> None:
        """Pages for these strikes; more of them may come."""
        self._pages += [StrikePage(record.strike_id) for record in records]
        send_lanes(self._timelines, [record.strike_id for record in records])
        self._wait(more=more)
        newest = (self._pages[-1] if more else self._pages[0]).strike_id if self._pages else ANSWER
        self.lay_out(newest)

    def lay_out(self, front: str) -> None:
        """Send the pages; `front` is in front unless the user asked for another."""
        self._stream.send_blueprint(layout(self._pages, self._options.page or front, self._bounds()))

    def _bounds(self) -> Array | None:
        return None if self._body is None else self._body.model.bounds

    def _colours(self) -> dict[str, Colour]:
        return {page.strike_id: CYCLE[number % len(CYCLE)] for number, page in enumerate(self._pages)}

    def _wait(self, *, more: bool) -> None:
        self._text("/summary", waiting_text(self._name, len(self._readings), None if more else len(self._pages)))

    def _text(self, path: str, text: str) -> None:
        self._stream.log(path, rr.TextDocument(text, media_type="text/markdown"), static=True)

    def moment(self) -> float:
        """A moment [s since contact] that shows something of the page in front."""
        from analyze.replay.views import moment_of
        from schemas.result import Verdict

        motions = [reading.motion for reading in self._readings]
        asked = [motion for motion in motions if motion.strike_id == self._options.page]
        good = [motion for motion in motions if motion.verdict is Verdict.GOOD]
        return moment_of(next(iter([*asked, *good]), None))

    # --- strikes --------------------------------------------------------------------------------------------------

    def pictures(self, source: StrikeSource, record: pb.StrikeRecord) -> None:
        """A strike's images; those before a damage where there is one."""
        root = strike_path(record.strike_id)
        self._text(f"{root}/text", unread_text(record.strike_id, record.verdict_code, "Its motion is being read."))
        frames = source.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns)
        try:
            send_pictures(self._timelines, f"{root}/camera/image", frames, contact_of(record), self._options.images)
        except RecordingError as error:
            self.damage.append(str(error))

    def read(self, source: StrikeSource, record: pb.StrikeRecord, *, more: bool) -> None:
        """What a strike's images show. Loads what computes when it is called first."""
        from analyze.pipeline.evidence import read_strike
        from analyze.replay.strike_scene import send_strike

        struck, body = self._object(source)
        if struck is None or body is None:
            why = f"Its motion cannot be read: {self.no_answer[0]}"
            self._text(f"{strike_path(record.strike_id)}/text", unread_text(record.strike_id, record.verdict_code, why))
            return
        try:
            reading = read_strike(source, struck, list(body.markers), record)
        except (RecordingError, PlanError) as error:
            (self.damage if isinstance(error, RecordingError) else self.no_answer).append(str(error))
            self._text(f"{strike_path(record.strike_id)}/text", unread_text(record.strike_id, record.verdict_code, str(error)))
            return
        self._readings.append(reading)
        self._pages = [
            StrikePage(page.strike_id, reading.motion.verdict.value.replace("_", " ")) if page.strike_id == record.strike_id else page
            for page in self._pages
        ]
        tracks = () if reading.report is None else reading.report.tracks
        send_strike(self._timelines, record, reading.motion, tracks, body, self._colours()[record.strike_id])
        self._wait(more=more)

    def _object(self, source: StrikeSource) -> tuple[StruckObject | None, Body | None]:
        if not self._asked:
            self._asked = True
            from analyze.pipeline.evidence import placed_markers, struck_object
            from analyze.replay.body import Body, log_shape
            from analyze.tracking.camera_model import camera_from_spec

            try:
                self._struck = struck_object(source, self._options.object_path)
                camera = camera_from_spec(source.manifest.cameras[0].calibration)
                self._body = Body(self._struck.model, self._struck.plan, camera, tuple(placed_markers(self._struck.spec)))
                self._stream.log("/result", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
                log_shape(self._stream, "/result", self._struck.model)
            except AnalyzeError as error:
                self.no_answer.append(str(error))
        return self._struck, self._body

    # --- the answer -----------------------------------------------------------------------------------------------

    def answer(self, head: RecordingHead) -> None:
        """The joint estimate, or why there is none; at last the pages once more, with the answer in front."""
        from analyze.pipeline.estimate import EstimateOptions, estimate_evidence
        from analyze.pipeline.evidence import evidence_of
        from analyze.pipeline.merge import strikes_to_leave_out

        try:
            if self._struck is None or self._body is None or self.no_answer:
                raise PlanError(*self.no_answer[:1] or ["there is no strike in it"])
            options = EstimateOptions(self._options.object_path, strikes_to_leave_out([head], self._options.exclude))
            evidence = evidence_of(head, self._struck, self._readings)
            self._send_answer(estimate_evidence(evidence, options))
        except AnalyzeError as error:
            text = str(error) if str(error).startswith(str(head.path)) else f"{head.path}: {error}"
            self.no_answer = [text]
            self._text("/summary", no_answer_text(self._name, [*self.damage[:1], text]))
        self.lay_out(ANSWER)

    def _send_answer(self, estimate: Estimate) -> None:
        from analyze.replay.body import log_inside, log_voxels
        from analyze.replay.layout import VOXELS
        from analyze.replay.strike_scene import send_strike_inside
        from analyze.replay.views import answer_of

        if self._body is None:
            return
        answer = answer_of(estimate)
        colours = self._colours()
        log_inside(self._stream, "/result", self._body.model, answer, colours)
        log_voxels(self._stream, VOXELS, answer)
        for reading in self._readings:
            send_strike_inside(self._timelines, reading.motion, self._body, answer, colours)
        text = answer_text(estimate.evidence.spec.name, answer.result)
        if self.damage:
            text += f"\n- **the recording is damaged, and this is what could be read: {self.damage[0]}**"
        self._text("/summary", text)
