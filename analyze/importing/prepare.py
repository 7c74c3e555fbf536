"""Prepares an import of images from other cameras as a recording.

The sources of images are searched for strikes, and these are assigned to the planned strikes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from analyze.cameras.camera_file import CameraFile, camera_of, read_camera
from analyze.errors import ImportRefused
from analyze.importing.assignment import assigned_ids
from analyze.importing.camera_pose import EstimatedCameraPose, camera_pose_from_strike, mean_camera_pose
from analyze.importing.found_strikes import FoundStrikes, find_strikes, refuse_unplanned
from analyze.importing.inputs import (
    StruckPlan,
    open_tosses,
    read_plan,
    refuse_full,
    refuse_other_camera,
)
from analyze.importing.mat_cameras import MatCameras, mat_cameras
from analyze.importing.off_place import off_place
from analyze.importing.onsets import Onset, OnsetFinder
from analyze.importing.options import ImportOptions
from analyze.importing.prepare_tosses import prepare_tosses
from analyze.importing.prepared_import import Assignment, PreparedImport, storable_videos
from analyze.importing.seen_tips import SeenTips, see_tips
from analyze.importing.spool import Spool
from analyze.importing.tip_view import TipView, view_by_placed_tag
from analyze.importing.windows import (
    Clip,
    StrikeWindow,
    found_tips,
    strike_windows,
    window_around,
)
from analyze.pipeline.object_markers import placed_markers
from analyze.progress import Progress, no_progress
from analyze.reading.object_file import ObjectFiles, read_object_files
from analyze.sources.open_source import open_source
from analyze.sources.source import Frames, FrameSource
from analyze.sources.video import VideoSource
from analyze.tracking.camera_model import camera_from_spec
from schemas.document import canonical_json, read_text
from schemas.strike_plan import StrikePlan

PROGRESS_EVERY_FRAMES = 50
"""frames between two updates of the progress bar"""


def prepare(options: ImportOptions, progress: Progress = no_progress) -> PreparedImport:
    """Search the sources for strikes, and assign parts of them to the planned strikes.

    If the camera file has no pose, the camera's pose is estimated from the resting object. Without a plan the
    strikes are those that the images show, and the plan is that of what was struck.

    Args:
        options: files, and the assignment of sources to planned strikes.
        progress: called with a text, the number of finished images or strikes and of all.

    Returns:
        The prepared import, which `write_recording` writes; to be used in a `with` statement.

    Raises:
        ImportRefused: a source cannot be read, is of another camera or shows no tag of the object, the plan
            is of another object, the strikes cannot be assigned, or the camera's pose is not determined.
        OutputError: the disk has no room for the videos that will be stored.
        ShapeError, DocumentError, CalibrationError: the object's, the plan's or the camera's file cannot be
            used.
        TrackingError: the images for the camera's pose show another object, or one of its markers twice.
    """
    if not options.sources:
        return prepare_tosses(options)
    files, object_text = read_object_files(options.object_path), read_text(options.object_path)
    struck = None if options.plan_path is None else read_plan(options.plan_path, files)
    if struck is None:
        refuse_unplanned(options, files.spec)
    # Where an untagged object begins to tip is seen when it is followed.
    options = replace(options, whole=options.whole or not files.spec.marker)
    given = None if options.camera_path is None else read_camera(options.camera_path)
    with ExitStack() as stack:
        sources = tuple(map(open_source, options.sources, options.source_options()))
        camera = given or camera_of(sources)
        tosses = open_tosses(options)
        for source in (*sources, *tosses):
            refuse_other_camera(source, camera)
        refuse_full(options.aside, storable_videos((*sources, *tosses)) or ())
        splits = len(sources) == 1 and not options.whole and len(options.strikes) != 1
        splits = splits and (struck is None or len(struck.plan.strikes) > 1)
        spools = _spools(options, sources, stack)
        images: tuple[Frames, ...] = tuple(
            spool or source for spool, source in zip(spools, sources, strict=True)
        )
        if options.whole:
            clips = tuple(Clip(path) for path in options.sources)
        else:
            directions = _directions(None if struck is None else struck.plan)
            names = [marker.name for marker in files.spec.marker]
            clips = tuple(
                _search(*each, names, splits, directions, progress)
                for each in zip(options.sources, sources, spools, strict=True)
            )
        tips, markers = found_tips(clips, splits), placed_markers(files.spec)
        seen = see_tips(markers, camera, images, clips, tips, progress, options.mat_ruler_mm)
        _refuse_unplaced_camera(options, files, camera, seen)
        mat = mat_cameras(seen.mats, [tip.name for tip in tips], camera, camera_from_spec(camera.calibration))
        camera, seen = _placed_by_mat(mat, camera, seen)
        views = [view_by_placed_tag(each, markers) for each in seen.tags]
        found: FoundStrikes | None = None
        if struck is None:
            found = find_strikes(options, files, camera, clips, tips, seen.tags)
            struck, ids, assignment = (
                StruckPlan(found.plan, canonical_json(found.plan) + "\n"),
                list(found.ids),
                Assignment.IMAGES,
            )
        else:
            ids, assignment = assigned_ids(
                options, struck.plan, files, camera, clips, tips, seen.tags, splits
            )
        windows = strike_windows(clips, tips, ids)
        if not windows:
            raise ImportRefused("every source is left out: nothing remains to import")
        if not camera.placed and not options.whole and all(window.onset is None for window in windows):
            clip = clips[windows[0].clip]
            raise ImportRefused(f"{clip.path}: no strike is found in it: {clip.why_no_strike}")
        place = None if found is None else found.place
        if found is None and not camera.placed:
            place = _estimate_camera_pose(struck.plan, camera, views, windows)
        calibration = camera.calibration
        if place is not None:
            calibration = calibration.model_copy(update={"T_world_camera": place.T_world_camera.tolist()})
        return PreparedImport(
            options,
            files,
            object_text,
            struck.plan,
            struck.text,
            camera,
            sources,
            (*images, *tosses),
            clips,
            windows,
            splits,
            assignment,
            (
                *seen.remarks,
                *(() if mat is None else mat.remarks),
                *_placing_remarks(found, struck.plan, camera if mat is not None else None, views, windows),
            ),
            sources[0].rate_hz,
            calibration,
            None if found is None else found.strikes,
            tosses,
            place,
            mat,
            stack.pop_all(),
        )


def _refuse_unplaced_camera(
    options: ImportOptions, files: ObjectFiles, camera: CameraFile, seen: SeenTips
) -> None:
    """Refuse an untagged object before a camera whose pose neither its file nor a mat shows."""
    if not files.spec.marker and not camera.placed and not any(seen.mats):
        raise ImportRefused(
            f"{options.object_path}: has no tag, so that only a mat on the table (`analyze print-tags "
            "--mat`) or a camera file with a pose (`analyze calibrate --upright`) shows the camera's place"
        )


def _placed_by_mat(mat: MatCameras | None, camera: CameraFile, seen: SeenTips) -> tuple[CameraFile, SeenTips]:
    """Camera with the pose by the mat, and the tips as from one place; both unchanged without a mat."""
    if mat is None:
        return camera, seen
    return mat.placed(camera), replace(seen, tags=mat.as_from_one_place(seen.tags))


def _placing_remarks(
    found: FoundStrikes | None,
    plan: StrikePlan,
    camera: CameraFile | None,
    views: Sequence[TipView | None],
    windows: Sequence[StrikeWindow],
) -> tuple[str, ...]:
    """Remarks on strikes that nobody planned, else on objects that a mat shows to stand off their cards.

    Args:
        found: strikes found without a plan; None if there was one.
        plan: what was struck.
        camera: camera whose pose a mat shows; None without a mat.
        views: the object as it is seen at each tip.
        windows: windows of the strikes.
    """
    if found is not None:
        return found.remarks
    return () if camera is None else tuple(off_place(plan, camera, views, windows))


def _directions(plan: StrikePlan | None) -> frozenset[bool]:
    """Directions in which strikes turn a marker in the image, True for clockwise; both without a plan."""
    if plan is None:
        return frozenset((True, False))
    return frozenset(math.cos(strike.heading_rad) > 0 for strike in plan.strikes)


def _spools(options: ImportOptions, sources: Sequence[FrameSource], stack: ExitStack) -> list[Spool | None]:
    """Create an image store (spool) for each source that would otherwise be decoded twice.

    Args:
        options: options of the import; `aside` is the folder for the stored images, None for no stores.
        sources: all sources.
        stack: exit stack, which closes the stores at its end.

    Returns:
        For each source its store, or None if it needs none.
    """
    kept = storable_videos(sources) is not None or all(source.holds_files for source in sources)
    if options.aside is None or options.whole or kept:
        return [None for _ in sources]
    spools = [Spool(source, options.aside) if source.is_coded else None for source in sources]
    for spool in filter(None, spools):
        stack.callback(spool.close)
    return spools


def _search(
    path: Path,
    source: FrameSource,
    spool: Spool | None,
    markers: Sequence[int | str],
    every_strike: bool,
    directions: frozenset[bool],
    progress: Progress,
) -> Clip:
    """Search a source to its end for onsets of strikes.

    Args:
        path: path of the source.
        source: source of the images at that path.
        spool: store that keeps the images of the strikes; None to keep none.
        markers: names of the object's markers.
        every_strike: True to store the images of all strikes of a source, False for those of its first only.
        directions: directions in which the plan's strikes turn a marker in the image, True for clockwise.
        progress: called with a text, the number of images searched and of all.

    Returns:
        The source with its onsets and the time of its last image.

    Raises:
        ImportRefused: no tag of the object is seen, the source cannot be read, or the rate of a slow-motion
            video is not constant.
    """
    frame_ns = 1e9 / source.rate_hz
    finder = OnsetFinder(markers, frame_ns, directions)
    onsets, times = list[Onset](), list[int]()
    for number, frame in enumerate(source.frames()):
        if number % PROGRESS_EVERY_FRAMES == 0:
            progress(f"searching {source.name}", number, source.frame_count or number)
        times.append(frame.time_ns)
        if spool is not None:
            spool.add(frame)
        if (onset := finder.add(frame)) is not None:
            if spool is not None and (every_strike or not onsets):
                spool.keep(*window_around(onset, frame_ns))
            onsets.append(onset)
    if not finder.ever_seen:
        names = ", ".join(str(name) for name in markers) or "none"
        raise ImportRefused(
            f"{path}: no tag of the object ({names}) is seen in it: record from nearer, sharper or with "
            "more light"
        )
    if isinstance(source, VideoSource):
        source.check_constant_rate(np.array(times, np.int64))
    last_ns = times[-1] if times else None
    return Clip(path, tuple(onsets), last_ns, frame_ns, finder.ever_rested, finder.turned_back)


def _estimate_camera_pose(
    plan: StrikePlan,
    camera: CameraFile,
    views: Sequence[TipView | None],
    windows: Sequence[StrikeWindow],
) -> EstimatedCameraPose:
    """Estimate the camera's pose in the world frame from the object at rest before each strike.

    Args:
        plan: strike plan with the object's resting poses.
        camera: lens of the camera.
        views: the object as it is seen at each tip.
        windows: windows of the strikes (parts of the sources).

    Returns:
        Mean pose over the strikes, with the rms deviation from it of their orientations [rad] and positions
        [m].

    Raises:
        ImportRefused: no strike gives a pose, or the poses differ too much.
    """
    lens = camera_from_spec(camera.calibration)
    by_id = {strike.id: strike for strike in plan.strikes}
    return mean_camera_pose(
        [
            camera_pose_from_strike(view, lens, by_id[window.plan_strike_id], window.strike_id)
            for window in windows
            if (view := views[window.tip]) is not None
        ]
    )
