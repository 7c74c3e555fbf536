"""Sessions with tosses on the virtual rig: recorded whole, after the strikes or alone, and stopped."""

from __future__ import annotations

import contextlib
import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquire.daemon.client import DaemonClient
from acquire.session.earlier import read_earlier
from acquire.virtual.toss import TossKind
from acquire.virtual.truth import merge_truth
from analyze.reading.recording import Recording, open_recording
from analyze.reading.truth import read_truth
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import PLAN_ATTACHMENT
from tests.system.session_rig import SessionRig, session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


def flights(path: Path) -> list[tuple[int, int]]:
    """Log times [ns] of begin and end of each span of 0.15 s or more in which the object falls freely."""
    truth = read_truth(path)
    times, poses = truth.pose_time_ns, truth.poses
    turned = Rotation.from_quat(np.array([np.roll(pose.q_world_object_wxyz, -1) for pose in poses]))
    turning = np.array([pose.angular_velocity for pose in poses])
    of_com = np.array([pose.linear_velocity for pose in poses])
    of_com = of_com + np.cross(turning, turned.apply(np.array(truth.body.com_object)))
    step = np.diff(times) * 1e-9
    falls = np.diff(of_com[:, 2]) / np.maximum(step, 1e-9)
    free = (step < 0.002) & (np.abs(falls + 9.81) < 2.5)
    spans = [
        (int(times[1:][group[0]]), int(times[1:][group[-1]]))
        for value, each in itertools.groupby(range(len(free)), key=free.__getitem__)
        if value and (group := list(each))
    ]
    return [span for span in spans if span[1] - span[0] > 150_000_000]


def run(rig: SessionRig, again: int = 0, **options: object) -> Path:
    report = rig.session(lambda text, _done, _total: rig.said.append(text), **options)
    assert not report.complaint, rig.said
    assert report.tosses == rig.tosses + again, rig.said
    merge_truth(report.path, Path(rig.world().truth()))
    return report.path


def check_windows(recording: Recording, path: Path) -> None:
    """Each toss's window holds a flight from before the release on, and every frame of it."""
    period_ns = 1e9 / recording.manifest.cameras[0].frame_rate_hz
    times = recording.times(topics.raw_image("main").name)
    spans = flights(path)
    for toss in recording.tosses:
        inside = [span for span in spans if toss.window_start_ns < span[0] < toss.window_end_ns]
        assert inside, (toss, spans)
        begin, end = inside[0]
        assert end < toss.window_end_ns
        in_flight = times[(times > begin) & (times < end)]
        assert np.diff(in_flight).max() < 1.5 * period_ns


def test_tosses_follow_the_strikes() -> None:
    with session_rig(tosses=2) as rig:
        path = run(rig)
        with open_recording(path) as recording:
            assert {record.plan_strike_id for record in recording.strikes} == {"s1", "s2", "s3"}
            assert [toss.toss_id for toss in recording.tosses] == ["t1.1", "t2.1"]
            assert recording.tosses[0].window_start_ns > recording.strikes[-1].window_end_ns
            assert [toss.verdict_code for toss in recording.tosses] == ["good", "good"]
            check_windows(recording, path)
            states = [state for _, state in recording.decoded(topics.SESSION_STATE.name, pb.SessionState)]
            tossing = [state.toss_id for state in states if state.state == pb.SessionState.TOSSING]
            assert tossing == ["t1", "t2"]
            assert states[-1].state == pb.SessionState.FINISHED


def test_tosses_alone_with_a_bad_last_one_and_a_stop_during_one() -> None:
    with session_rig(tosses=2) as rig:
        path = run(rig, again=1, only_tosses=True, kinds=(TossKind.GOOD, TossKind.EARLY, TossKind.GOOD))
        with open_recording(path) as recording:
            assert recording.strikes == ()
            check_windows(recording, path)
            assert [toss.toss_id for toss in recording.tosses] == ["t1.1", "t2.1", "t2.2"]
            first, early, last = (toss.verdict_code for toss in recording.tosses)
            assert (first, last) == ("good", "good")
            assert early in {"short", "not_free"}
            text = recording.attachments[PLAN_ATTACHMENT].decode()
        earlier = read_earlier([path], text, Path("plan.json"))
        assert earlier.good_tosses == {"t1", "t2"}
        assert any(line.startswith("t2 placing again: ") for line in rig.said)

        def stop_in_flight(text: str, _done: int, _total: int) -> None:
            rig.said.append(text)
            if "tossing" in text:
                with contextlib.closing(DaemonClient(rig.daemon.socket)) as client:
                    client.call("striker.stop")

        report = rig.session(stop_in_flight, name="stopped.mcap", only_tosses=True)
        assert report.aborted
        assert "stopped" in report.text
        assert report.tosses == 0
