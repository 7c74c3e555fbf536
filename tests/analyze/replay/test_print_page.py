"""Page of a strike without tags in a replay: points of the print that were followed, and fitted pose."""

from __future__ import annotations

import numpy as np
import rerun as rr

from analyze.motion.print_motion import analyse_images
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.sections import next_face_angle, rolling_outline, strike_supports
from analyze.replay.body import SceneInputs
from analyze.replay.strike_scene import send_strike
from analyze.replay.timelines import Timelines
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import parse_strike_plan
from tests.analyze.motion.printed_box import FOLDER, box, camera, tip
from tests.analyze.replay.rrd_contents import RrdContents


def test_the_print_that_is_followed_is_drawn_over_the_images(tmp_path):
    _, model = box()
    made = tip(0, seed=0)
    planned = made.planned
    task = StrikeTask(
        f"{planned.id}.1",
        planned,
        made.contact_ns,
        None,
        rolling_outline(model, planned),
        next_face_angle(model, planned),
        supports=strike_supports(model, planned),
    )
    motion, report = analyse_images(made.frames, camera(), [], (model.vertices, model.faces), task)
    points = report.print_points
    assert points is not None
    frames, kept = points.explained.shape
    assert points.pixels.shape == (frames, kept, 2)
    assert 120 < kept <= 250
    assert np.nanmedian(points.explained) > 0.8
    plan = parse_strike_plan((FOLDER / "plan.json").read_text(encoding="utf-8"), "plan")
    record = pb.StrikeRecord(strike_id=f"{planned.id}.1", plan_strike_id=planned.id)
    record.contact_time_ns = made.contact_ns
    stream = rr.RecordingStream("percuss", recording_id="r1")
    stream.save(tmp_path / "strike.rrd")
    inputs = SceneInputs(model, plan, camera(), ())
    send_strike(Timelines(stream, 0), record, motion, report, inputs, (255, 128, 0))
    stream.disconnect()
    shown = RrdContents(tmp_path / "strike.rrd")
    root = f"/strike/{planned.id}.1/camera"
    assert shown.rows(f"{root}/print") == shown.rows(f"{root}/misfit") == frames
    assert shown.rows(f"{root}/ghost") > 20
