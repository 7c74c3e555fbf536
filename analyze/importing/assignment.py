"""Assigns the tips found in an import's clips to the planned strikes, as stated or as the images show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.cameras.camera_file import CameraFile
from analyze.errors import ImportRefused
from analyze.geometry.object_model import load_object_model
from analyze.importing.matching import (
    TipInView,
    match_strikes,
    matched_ids,
    refuse_contradiction,
    refuse_undetermined,
)
from analyze.importing.options import ImportOptions
from analyze.importing.prepared_import import Assignment
from analyze.importing.tag_place import TaggedBody
from analyze.importing.tip_view import TagView, view_by_placed_tag
from analyze.importing.unplaced_matches import match_unplaced
from analyze.importing.windows import SKIPPED, Clip, FoundTip, ids_in_order, stated_ids
from analyze.pipeline.object_markers import placed_markers
from analyze.reading.object_file import ObjectFiles
from schemas.strike_plan import StrikePlan


def assigned_ids(
    options: ImportOptions,
    plan: StrikePlan,
    files: ObjectFiles,
    camera: CameraFile,
    clips: Sequence[Clip],
    tips: Sequence[FoundTip],
    tags: Sequence[Sequence[TagView]],
    split: bool,
) -> tuple[list[str], Assignment]:
    """Planned id of each tip: as stated, else as the images show it, else in the plan's order.

    Args:
        options: options of the import.
        plan: strike plan.
        files: object file and shape.
        camera: lens of the camera and, if known, its pose.
        clips: the sources.
        tips: tips that become strikes.
        tags: for each tip the views of its tags, the best first.
        split: True if the only clip shows several strikes.

    Raises:
        ImportRefused: a tip shows another strike than stated, or one that the plan does not have, or its
            strike is not determined.
    """
    planned, spec = [strike.id for strike in plan.strikes], files.spec
    stated = stated_ids(clips, tips, planned, options.strikes)
    stated_by = "--strike" if options.strikes else "its name"
    markers = placed_markers(spec)
    seen = [
        TipInView(
            tip.name,
            view_by_placed_tag(views, markers),
            clips[tip.clip].why_no_strike if tip.onset is None else "",
        )
        for tip, views in zip(tips, tags, strict=True)
    ]
    up = np.array(camera.calibration.T_world_camera)[2, :3] if camera.placed else None
    matches = match_strikes(seen, plan, spec, up)
    if camera.placed and any(views and tip.view is None for tip, views in zip(seen, tags, strict=True)):
        body = TaggedBody(
            load_object_model(spec, files.shape_bytes, files.shape_name),
            {marker.name: marker for marker in spec.marker},
            np.array(camera.calibration.T_world_camera),
        )
        matches, spec = match_unplaced(seen, tags, matches, stated, plan, spec, body)
    refuse_contradiction(seen, stated, matches, plan, spec, stated_by)
    for match, name in zip(matches, stated, strict=True):
        if match.misfit and name is None:
            raise ImportRefused(
                f"{match.misfit}: name it with --strike ID, or leave it out (--strike {SKIPPED})"
            )
    ids = matched_ids(matches, stated)
    if ids is not None:
        if None in stated:
            return ids, Assignment.IMAGES
        return ids, Assignment.OPTION if options.strikes else Assignment.NAMES
    try:
        ids = ids_in_order(clips, tips, planned, split)
        refuse_contradiction(seen, ids, matches, plan, spec, "the plan's order")
    except ImportRefused:
        refuse_undetermined(seen, matches, stated)
        raise
    return ids, Assignment.ORDER
