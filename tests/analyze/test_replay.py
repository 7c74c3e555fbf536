from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.writer import CompressionType, Writer

from acquire.virtual.lens import Lens
from acquire.virtual.objects import load_object
from acquire.virtual.render import Renderer
from acquire.virtual.station import station
from analyze import replay_views as views
from analyze.geometry.rotations import wxyz_from_matrix
from analyze.pipeline import estimate_evidence
from analyze.replay import ReplayError, moment_of, screenshot, write_replay
from analyze.types import MarkerTrack
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME, TimeSource
from tests.analyze.simulated_session import carton, manifest, session

STATION = station(1)
SHOWN = 3


@pytest.fixture(scope="module")
def estimate():
    evidence = session(carton(), np.random.default_rng(5), repeats=1)
    apart = [_later(motion, 3_000_000_000 * i) for i, motion in enumerate(evidence.motions)]
    return estimate_evidence(dataclasses.replace(evidence, motions=tuple(apart)))


@pytest.fixture(scope="module")
def content(estimate):
    found = views.content_of(estimate)
    return dataclasses.replace(
        found, motions=found.motions[:SHOWN], tracks={m.strike_id: (_track(found, m),) for m in found.motions[:SHOWN]}
    )


@pytest.fixture(scope="module")
def recording(content, tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "carton.mcap"
    write_recording(path, content)
    return path


@pytest.fixture(scope="module")
def rrd(recording, content):
    output = recording.with_suffix(".rrd")
    write_replay(recording, content, output)
    return output


def _later(motion, shift_ns):
    angle = dataclasses.replace(motion.angle, time_ns=motion.angle.time_ns + shift_ns)
    # the simulated tip begins with frame 29: frame 30 is its first step
    return dataclasses.replace(motion, angle=angle, fit=dataclasses.replace(motion.fit, time0_ns=int(angle.time_ns[29])))


def _track(content, motion):
    """The marker that faces the camera, where the lens sees it."""
    R, p = views.object_poses(content.planned(motion), motion.angle)
    square = 0.015 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    poses = [(m.id, np.array(m.T_object_marker)) for m in load_object("carton", 1).spec.marker]
    marker_id, T = min(poses, key=lambda pair: (R[0] @ pair[1][:3, 2])[1])
    corners = Lens(STATION).pixels((square @ T[:3, :3].T + T[:3, 3]) @ np.swapaxes(R, 1, 2) + p[:, None])
    n = len(R)
    return MarkerTrack(marker_id, motion.angle.time_ns, corners, np.full(n, 0.05), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), n)


def write_recording(path, content):
    """A recording with rendered images of every second frame, written with the reference library."""
    renderer = Renderer(load_object("carton", 1), STATION, 1)
    known = manifest(content_spec())
    known = known.model_copy(update={"time_source": TimeSource.HOST_ARRIVAL})
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(library="test")
        writer.add_metadata(MANIFEST_NAME, {"json": known.model_dump_json()})
        channels = {}
        for topic in (topics.raw_image("main"), topics.SESSION_STRIKE, topics.STRIKER_EVENT):
            schema = writer.register_schema(topic.schema_name, "protobuf", topic.schema_data())
            channels[topic.name] = writer.register_channel(topic.name, "protobuf", schema)

        def put(topic, time_ns, message, sequence=0):
            writer.add_message(channels[topic.name], time_ns, message.SerializeToString(), time_ns, sequence)

        for motion in content.motions:
            R, p = views.object_poses(content.planned(motion), motion.angle)
            time_ns = motion.angle.time_ns
            contact = int(time_ns[30])
            for i in range(0, len(time_ns), 2):
                swing = np.array([np.clip(0.35 - 1.4 * abs((time_ns[i] - contact) * 1e-9), -0.3, 0.0)])
                image = renderer.render(p[[i]], wxyz_from_matrix(R[[i]]), swing, np.array([[-0.095, 0.0, 0.23]]), 1500.0, 0.0)
                message = RawImage(width=656, height=492, step=656, encoding="mono8", data=image.tobytes())
                put(topics.raw_image("main"), int(time_ns[i]), message, i)
            event = pb.StrikerEvent(kind=pb.StrikerEvent.CONTACT, strike_id=motion.strike_id, tip_speed_m_s=0.71)
            put(topics.STRIKER_EVENT, contact, event)
            record = pb.StrikeRecord(
                strike_id=motion.strike_id,
                plan_strike_id=motion.plan_strike_id,
                window_start_ns=int(time_ns[0]),
                window_end_ns=int(time_ns[-1]),
                contact_time_ns=contact,
            )
            put(topics.SESSION_STRIKE, int(time_ns[-1]), record)
        writer.finish()


def content_spec():
    return load_object("carton", 1).spec


# --- what is drawn ------------------------------------------------------------------------------------------------


def test_the_object_turns_about_its_pivot(content):
    motion = content.motions[0]
    planned = content.planned(motion)
    R, p = views.object_poses(planned, motion.angle)
    pivot = np.array(planned.pivot.point)
    np.testing.assert_allclose(R @ pivot + p, np.tile(R[0] @ pivot + p[0], (len(R), 1)), atol=1e-12)
    np.testing.assert_allclose(R[0], np.array(planned.R_world_object), atol=5e-3)
    assert np.all(np.linalg.det(R) > 0.999999)


def test_at_phi_the_centre_of_mass_is_drawn_above_the_pivot(content, estimate):
    for motion in content.motions:
        planned = content.planned(motion)
        R, p = views.object_poses(planned, motion.angle)
        path = R @ estimate.com.position + p
        pivot = R[0] @ np.array(planned.pivot.point) + p[0]
        side = np.interp(motion.fit.phi, motion.angle.theta[33:-14], (path - pivot)[33:-14, 0])
        assert abs(side) < 1e-3  # 0.05 degrees of noise per frame at 80 mm, and the estimate's own error


def test_fitted_curves_follow_the_measured_ones(content):
    motion = content.motions[0]
    fitted = views.fitted_curves(motion.angle, motion.fit)
    assert np.degrees(np.std(fitted.residual)) < 0.1
    measured = views.curves(motion.angle)
    middle = slice(5, -5)
    rate = np.interp(fitted.time_ns, measured.time_ns, measured.omega)[middle]
    assert np.degrees(np.sqrt(np.mean((rate - fitted.omega[middle]) ** 2))) < 10.0  # 0.05 deg at 120 fps, differenced


def test_an_equiplane_is_drawn_where_it_cuts_the_object(content, estimate):
    for plane in estimate.planes:
        cut = views.section(content.model, plane.point, plane.normal, margin=1.0)
        assert len(cut) >= 3
        np.testing.assert_allclose((cut - plane.point) @ plane.normal, 0.0, atol=1e-12)
        assert np.all(cut >= content.model.bounds[0] - 1e-9)
        assert np.all(cut <= content.model.bounds[1] + 1e-9)
    outside = views.section(content.model, np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    assert outside.shape == (0, 3)


def test_the_ellipsoid_holds_95_percent():
    rng = np.random.default_rng(2)
    A = rng.normal(size=(3, 3)) * 1e-3
    half, axes = views.ellipsoid(A @ A.T, 0.0)
    drawn = rng.normal(size=(20_000, 3)) @ A.T
    assert np.mean(np.sum((drawn @ axes / half) ** 2, axis=1) < 1) == pytest.approx(0.95, abs=0.01)


# --- what is written ----------------------------------------------------------------------------------------------


def test_a_replay_is_written_whole_and_small(rrd, recording):
    assert 100_000 < rrd.stat().st_size < recording.stat().st_size / 4
    assert not rrd.with_name(rrd.name + ".part").exists()


def test_a_place_that_cannot_be_written_gives_one_line(recording, content, tmp_path):
    with pytest.raises(ReplayError, match="cannot be written") as caught:
        write_replay(recording, content, tmp_path / "no" / "where.rrd")
    assert "\n" not in str(caught.value)


def test_motions_without_a_result_can_be_replayed(recording, content, tmp_path):
    bare = views.ReplayContent(content.model, content.plan, (dataclasses.replace(content.motions[0], fit=None, angle=None, phases=None),))
    write_replay(recording, bare, tmp_path / "bare.rrd")
    assert (tmp_path / "bare.rrd").stat().st_size > 100_000
    assert moment_of(bare) == pytest.approx(0.2)


@pytest.mark.usefixtures("vulkan")
def test_a_view_rendered_without_a_screen_is_not_blank(rrd, content, tmp_path):
    picture = tmp_path / "replay.png"
    screenshot(rrd, picture, moment_of(content))
    image = cv2.imread(str(picture))
    assert image.shape[0] > 800
    height, width = image.shape[:2]
    camera = image[height // 12 : height // 2, : width // 2]
    scene = image[height * 6 // 10 :, : width // 2]
    curves = image[height // 12 : height // 2, width // 2 :]
    assert camera.std() > 15  # grey picture of object and tag
    assert (cv2.cvtColor(scene, cv2.COLOR_BGR2HSV)[..., 1] > 90).mean() > 0.002  # coloured plane, pivot, centre of mass
    assert (cv2.cvtColor(curves, cv2.COLOR_BGR2HSV)[..., 1] > 90).mean() > 0.002  # measured and fitted
