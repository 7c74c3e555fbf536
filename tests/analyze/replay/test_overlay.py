"""Overlay on the image: positions in pixels agree with the detected tags."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.read_evidence import read_strike, struck_object
from analyze.reading.recording import open_recording
from analyze.replay import overlay, views
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.pose import marker_corners
from analyze.types import CameraModel
from tests.places import FIRST_SAMPLE


@pytest.fixture(scope="module")
def read():
    with open_recording(FIRST_SAMPLE) as recording:
        struck = struck_object(recording)
        markers = placed_markers(struck.spec)
        reading = read_strike(recording, struck, markers, recording.strikes[0])
        planned = next(
            strike for strike in recording.plan.strikes if strike.id == reading.motion.plan_strike_id
        )
        return struck, markers, reading, planned, camera_from_spec(recording.manifest.cameras[0].calibration)


def test_projected_tag_of_the_fitted_pose_lies_on_the_detected_tag(read):
    _, markers, reading, planned, camera = read
    tracks, motion = reading.report.tracks, reading.motion
    rest = overlay.pose_at_rest(planned, tracks, markers, camera, reading.record.contact_time_ns)
    at = views.fitted_angle(motion.angle, motion.fit, views.fitted_curves(motion.angle, motion.fit))
    R, p = views.object_poses(planned, at, None, rest)
    (track,) = tracks
    marker = next(each for each in markers if each.id == track.marker_id)
    corners = marker_corners(marker.size) @ marker.T_object_marker[:3, :3].T + marker.T_object_marker[:3, 3]
    drawn = overlay.project_to_pixels(camera, corners @ np.swapaxes(R, 1, 2) + p[:, None])
    seen = track.corners_px[np.searchsorted(track.time_ns, at.time_ns)]
    assert np.abs(drawn - seen).max() < 1.0  # px, of 80


def test_wireframe_is_sharp_edges_or_the_outline_of_a_round_body(read):
    struck, *_, planned, camera = read
    R, p = np.array([planned.R_world_object]), np.array([planned.p_world_object])
    (lines,) = overlay.wireframe(struck.model, camera, R, p)
    assert len(lines) == 12
    many = overlay.sharp_edges(*_prism(80))
    assert len(many) == 160
    (round_body,) = overlay.wireframe(_like(struck.model, *_prism(80)), camera, R, p)
    assert len(round_body) == 1
    np.testing.assert_allclose(round_body[0][0], round_body[0][-1])


def test_every_border_edge_of_an_open_mesh_is_sharp():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    edges = overlay.sharp_edges(square, np.array([[0, 1, 2], [0, 2, 3]]))
    middles = {tuple(edge.mean(axis=0)) for edge in edges}
    assert middles == {(0.5, 0, 0), (1, 0.5, 0), (0.5, 1, 0), (0, 0.5, 0)}


def test_points_behind_the_camera_are_not_drawn():
    camera = CameraModel(
        640, 480, np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), np.zeros(5), np.eye(4)
    )
    drawn = overlay.project_to_pixels(camera, np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(drawn[0], [320, 240])
    assert np.all(np.isnan(drawn[1]))
    assert len(overlay.axis_line(camera, np.array([0.0, 0.0, -1.0]), 0.1)) == 0
    assert len(overlay.axis_line(camera, np.array([0.0, 0.0, 1.0]), 0.1)) == 24


def _prism(sides):
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = 0.03 * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.vstack(
        [np.column_stack([ring, np.full(sides, z)]) for z in (-0.05, 0.05)] + [[[0, 0, -0.05], [0, 0, 0.05]]]
    )
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.vstack(
        [
            np.column_stack([i, j, sides + j]),
            np.column_stack([i, sides + j, sides + i]),
            np.column_stack([j, i, np.full(sides, 2 * sides)]),
            np.column_stack([sides + i, sides + j, np.full(sides, 2 * sides + 1)]),
        ]
    )
    return vertices, faces


def _like(model, vertices, faces):
    import dataclasses

    return dataclasses.replace(model, vertices=vertices, faces=faces, hull_vertices=vertices)
