"""Report of an estimate: one self-contained HTML file with result, reasons and plots, ready to print."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from markupsafe import Markup

from analyze.cards.drawn_shape import drawn_shape
from analyze.cards.edge_picture import edge_picture
from analyze.least_squares.intervals import SIGMAS_95
from analyze.reading.recording import open_recording
from analyze.report.page import figure_element, manifest_time, page_environment
from analyze.report.plots import moments_figure, projection_figures, regions_figure, strike_figure
from analyze.report.prediction_plot import prediction_figures
from analyze.report.sensitivity_plot import influence_figure, largest_source_text, source_rows, sources_figure
from analyze.report.summary import DEGREES, filling_rows, robustness_rows
from analyze.report.toss_rows import TOSS_COLUMNS, toss_lines, toss_rows
from analyze.report.truth import ShownTruth, shown_truth
from analyze.report.voxel_map import voxel_figures, voxel_map_text
from analyze.result.contact import contact_lines, contact_rows
from analyze.result.contents import contents_lines, pose_rows
from analyze.result.digits import decimals, number, signed
from analyze.result.fixture import fixture_lines
from analyze.result.flight import tosses_used
from analyze.result.frame_times import frame_time_lines
from analyze.result.headline import com_entries, edge_labels, further_warnings, headline
from analyze.result.radius import radius_lines
from analyze.result.tilt import tilt_lines
from schemas.output_file import write_text
from schemas.strike_result import StrikeResult, Verdict
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.estimation.mass_properties import MassDistribution
    from analyze.pipeline.estimate import Estimate
    from analyze.result.answer import Answer
    from analyze.types import MarkerTrack
    from schemas.result import Result

JPEG_QUALITY = 88


@dataclass(frozen=True)
class Still:
    """Camera image of a strike with outlined markers, in the form in which the report embeds it."""

    axis_id: str
    """id of the strike's pivot axis"""
    caption: str
    """strike and tipping angle shown"""
    data_url: str
    """JPEG as a data URL"""


@dataclass(frozen=True)
class StruckEdge:
    """Edge over which the object was tipped, as the report names and draws it."""

    axis_id: str
    """id of the pivot axis"""
    name: str
    """name of the edge that a person can point at"""
    drawing: Markup
    """small drawing of the object with the edge marked, an <svg> element"""
    strikes: list[str]
    """ids of the strikes over the edge"""


def write_report(answer: Answer, output: Path, score: Mapping[str, Any] | None = None) -> None:
    """Write the report of an estimate as one HTML file, which appears when it is complete.

    Args:
        answer: estimate and its result; its recordings are read again, for camera images.
        output: the HTML file; its folder must exist.
        score: errors against ground truth (`score_answer`); None if the recordings are not virtual.

    Raises:
        RecordingError: a recording cannot be read.
        OutputError: the file cannot be written.
    """
    write_text(output, render_report(answer, camera_stills(answer.estimate), score))


def render_report(answer: Answer, images: list[Still], score: Mapping[str, Any] | None = None) -> str:
    """Report of an estimate as the text of one HTML page, with plots and camera images in it.

    Args:
        answer: estimate and its result.
        images: camera images to embed, such as those of `camera_stills`.
        score: errors against ground truth (`score_answer`); None if the recordings are not virtual.
    """
    estimate, result = answer.estimate, answer.result
    shown = headline(result)
    truth = None if score is None else shown_truth(score, answer)
    rows = source_rows(estimate.sensitivity, estimate.com.covariance)
    half = SIGMAS_95 * float(np.sqrt(np.linalg.eigvalsh(estimate.com.covariance)[-1]))
    return (
        page_environment()
        .get_template("report.html")
        .render(
            name=estimate.evidence.spec.name,
            result=result,
            recordings=estimate.evidence.recordings,
            verdict=answer_summary(answer),
            shown=shown,
            com_truth=[] if truth is None else _truth_rows(result, truth),
            reasons=[
                strike for strike in result.strikes if strike.reason and strike.verdict is not Verdict.GOOD
            ],
            choices=[strike for strike in result.strikes if strike.choice],
            stills=images,
            created=list(
                dict.fromkeys(manifest_time(each.manifest.created) for each in estimate.evidence.recordings)
            ),
            truth=truth,
            projections=[
                figure_element(figure)
                for figure in projection_figures(estimate, None if truth is None else truth.com)
            ],
            regions=figure_element(
                regions_figure(estimate, truth.regions if truth is not None and truth.regions else None)
            ),
            voxels=[figure_element(figure) for figure in voxel_figures(estimate.voxels)],
            voxel_text=voxel_map_text(estimate.voxels),
            moments=figure_element(
                moments_figure(estimate, None if truth is None else truth.i_com, shown.unit)
            )
            if result.moments
            else None,
            predictions=[figure_element(figure) for figure in prediction_figures(estimate.predictions)],
            warnings=further_warnings(result),
            fixture=fixture_lines(result),
            contact=contact_lines(result),
            contact_rows=contact_rows(result),
            missed=[each for each in estimate.predictions if not each.consistent],
            filling=[] if result.filling is None else filling_rows(result.filling),
            robustness=robustness_rows(result.robustness or []),
            strikes=_strike_plots(answer),
            edges=_edges(answer),
            edge_labels=edge_labels(result),
            tilts=[
                *tilt_lines(result),
                *radius_lines(result),
                *frame_time_lines(result.frame_times, len(estimate.evidence.recordings) > 1),
            ],
            contents_lines=contents_lines(result),
            poses=pose_rows(result),
            tosses=toss_rows(result),
            toss_columns=TOSS_COLUMNS,
            toss_lines=toss_lines(result),
            scattered=[] if result.contents is None else result.contents.edges,
            sources=figure_element(sources_figure(rows, half)),
            sources_text=largest_source_text(rows),
            influences=figure_element(influence_figure(estimate.sensitivity)),
            naive=sorted(result.regions.baselines) if result.regions is not None else [],
            score=score,
            best_naive=(
                min(score["region_mass_error_relative_baselines"].items(), key=lambda item: item[1])
                if score is not None and truth is not None and truth.regions
                else None
            ),
        )
    )


def answer_summary(answer: Answer) -> str:
    """Summary of an estimate in two or three sentences: centre of mass, heaviest region, strikes used.

    If one direction of the centre of mass is not observed, only that and the strikes are stated.
    """
    estimate, result = answer.estimate, answer.result
    com = estimate.com
    axes = len({plane.axis_id for plane in estimate.planes})
    count = (
        f"{len(estimate.planes)} of {counted(len(result.strikes), 'strike')} on {counted(axes, 'axis')} "
        "were used."
    )
    tosses = tosses_used(estimate)
    if tosses:
        count = (
            f"{count[:-1]}, and {counted(len(tosses), 'toss')}."
            if estimate.planes
            else (f"{counted(len(tosses), 'toss', 'was')} used, and no strike.")
        )
    if not com.observed:
        return (
            f"{count} They do not determine the centre of mass along one direction; the number given along it"
            " comes from the shape."
        )
    shift = com.position - estimate.evidence.model.own.centroid
    text = f"The centre of mass lies {1e3 * np.linalg.norm(shift):.1f}\u00a0mm from the middle of the volume."
    return f"{text} {_heaviest_in_words(estimate.distribution)} {count}"


def _heaviest_in_words(distribution: MassDistribution) -> str:
    """Sentence on the heaviest of shell and interior parts, or that the strikes do not determine it.

    They determine it under two conditions: a body whose parts each have uniform density explains the measured
    moments, and the lower end of the part's 95 % interval is not below the upper end of any other's.
    """
    mass = distribution.masses.sum()
    heaviest = int(np.argmax(distribution.masses))
    least, others = distribution.intervals[heaviest, 0], np.delete(distribution.intervals[:, 1], heaviest)
    if not distribution.explained or least < np.max(others, initial=0.0):
        return "The strikes do not determine which part of it is the heaviest."
    where = {
        "shell": "in the shell",
        "upper": "inside, above the dividing plane",
        "lower": "inside, below the dividing plane",
    }
    place = where.get(distribution.names[heaviest], distribution.names[heaviest])
    part = "Most" if least > mass / 2 else "The largest part"
    return f"{part} of the mass ({100 * distribution.masses[heaviest] / mass:.0f}\u00a0%) is {place}."


def camera_stills(estimate: Estimate) -> list[Still]:
    """Camera images with outlined markers for the report: one per pivot axis, with the axis and a caption.

    The image is the one in which the tipping angle is nearest to the balance angle. The recordings are read
    again. An axis without a strike that was used and tracked gives no image.

    Raises:
        RecordingError: a recording cannot be read.
    """
    found: list[Still] = []
    seen: set[str] = set()
    evidence = estimate.evidence
    with ExitStack() as stack:
        opened = {
            head.content_id: stack.enter_context(open_recording(head.path)) for head in evidence.recordings
        }
        motions = {motion.strike_id: motion for motion in evidence.motions}
        # Strikes that tipped over come first: one that rocked back never reaches phi.
        for plane in sorted(
            estimate.planes, key=lambda plane: motions[plane.strike_id].verdict is not Verdict.GOOD
        ):
            report = evidence.tracking.get(plane.strike_id)
            motion = motions[plane.strike_id]
            if plane.axis_id in seen or report is None or not report.tracks or motion.angle is None:
                continue
            seen.add(plane.axis_id)
            nearest = int(np.argmin(np.abs(motion.angle.theta - plane.phi)))
            moment = int(motion.angle.time_ns[nearest])
            caption = (
                f"strike {plane.strike_id} at θ\u00a0=\u00a0{DEGREES * motion.angle.theta[nearest]:.1f}°"
            )
            shown = _frame_at(report.tracks, moment)
            frames = opened[evidence.recording_of(plane.strike_id).content_id].images(
                start_ns=shown, end_ns=shown
            )
            found.extend(
                Still(plane.axis_id, caption, _outlined(frame.image, report.tracks, moment))
                for frame in frames
            )
    return found


def _frame_at(tracks: tuple[MarkerTrack, ...], time_ns: int) -> int:
    """Log time [ns] of the image in which a track found the marker's corners at the time `time_ns`.

    With a rolling shutter an image's own time (of its middle row) differs from the time at which its rows
    showed the marker.

    Args:
        tracks: tracked markers of the strike.
        time_ns: log time of a track's corners [ns]; returned unchanged if no track has it.
    """
    return next(
        (
            int(track.frame_ns[where[0]])
            for track in tracks
            if len(where := np.flatnonzero(track.time_ns == time_ns))
        ),
        time_ns,
    )


def _outlined(image: Any, tracks: tuple[MarkerTrack, ...], time_ns: int) -> str:
    picture = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_GRAY2BGR)
    for track in tracks:
        where = np.flatnonzero(track.time_ns == time_ns)
        if len(where):
            corners = np.round(track.corners_px[int(where[0])] * 8).astype(np.int32)
            cv2.polylines(
                picture,
                [corners],
                isClosed=True,
                color=(0, 159, 230),
                thickness=2,
                lineType=cv2.LINE_AA,
                shift=3,
            )
    encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(encoded.tobytes()).decode()}"


def _strike_plots(answer: Answer) -> list[tuple[StrikeResult, Markup]]:
    by_id = {strike.id: strike for strike in answer.result.strikes}
    shown = [
        (by_id[each.strike_id], each) for each in answer.estimate.evidence.motions if each.angle is not None
    ]
    return [
        (
            strike,
            figure_element(strike_figure(motion, f"{strike.id}: {strike.verdict.value.replace('_', ' ')}")),
        )
        for strike, motion in shown
    ]


def _edges(answer: Answer) -> list[StruckEdge]:
    """Struck edges with their drawings, in the order of the strikes."""
    evidence = answer.estimate.evidence
    shape, found = drawn_shape(evidence.model), dict[str, StruckEdge]()
    for motion, strike in zip(evidence.motions, answer.result.strikes, strict=True):
        if strike.axis_id in found:
            found[strike.axis_id].strikes.append(strike.id)
        else:
            name = strike.edge_name or strike.axis_id
            drawing = edge_picture(shape, evidence.spec, evidence.planned(motion), name)
            escaped = Markup(drawing)  # noqa: S704 - `edge_picture` escaped its texts
            found[strike.axis_id] = StruckEdge(strike.axis_id, name, escaped, [strike.id])
    return list(found.values())


def _truth_rows(result: Result, truth: ShownTruth) -> list[dict[str, str]]:
    """Rows of the table that compares the centre of mass [mm] with ground truth, one per axis of O."""
    com = result.centre_of_mass
    columns = zip("xyz", com_entries(result), np.array(com.value), np.array(com.sd), truth.com, strict=True)
    rows: list[dict[str, str]] = []
    for axis, entry, value, sd, true in columns:
        digits = decimals(1e3 * SIGMAS_95 * sd)
        row = {"axis": axis, "estimate": entry.text, "true": number(1e3 * true, digits)}
        rows.append({**row, "error": signed(1e3 * (value - true), digits)})
    return rows
