import stat
import threading

import numpy as np
import pytest

from acquire.virtual.pose_ring import PoseRing, PoseRingError

Q0 = (1.0, 0.0, 0.0, 0.0)


def q_about_y(angle):
    return (np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0)


def test_interpolates_between_poses_and_clamps_to_the_ends(tmp_path):
    path = tmp_path / "pose.ring"
    ring = PoseRing.create(path)
    ring.append(1_000_000, (0, 0, 0), q_about_y(0.0), -0.2, (0, 0, 0.3))
    ring.append(2_000_000, (0.001, 0, 0), q_about_y(0.01), 0.2, (0, 0, 0.3))
    p, q, angle, axis = PoseRing.open(path).poses_at(np.array([0, 1_250_000, 9_000_000]))
    assert p[:, 0] == pytest.approx([0.0, 0.00025, 0.001])
    assert 2 * np.arcsin(q[:, 2]) == pytest.approx([0.0, 0.0025, 0.01], abs=1e-8)
    assert angle == pytest.approx([-0.2, -0.1, 0.2])
    assert axis == pytest.approx(np.tile([0, 0, 0.3], (3, 1)))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_one_pose_is_enough_and_none_is_an_error(tmp_path):
    ring = PoseRing.create(tmp_path / "pose.ring")
    with pytest.raises(PoseRingError, match="empty"):
        ring.poses_at([0])
    ring.append(5, (1, 2, 3), Q0, 0.0, (0, 0, 0))
    assert ring.poses_at([0, 5, 10]).p_world_object == pytest.approx(np.tile([1, 2, 3], (3, 1)))


def test_opposite_quaternion_signs_are_one_rotation(tmp_path):
    ring = PoseRing.create(tmp_path / "pose.ring")
    ring.append(0, (0, 0, 0), Q0, 0.0, (0, 0, 0))
    ring.append(10, (0, 0, 0), tuple(-np.array(q_about_y(0.02))), 0.0, (0, 0, 0))
    assert abs(ring.poses_at([5]).q_world_object_wxyz[0]) == pytest.approx(
        abs(np.array(q_about_y(0.01))), abs=1e-8
    )


def test_reader_never_sees_a_torn_pose(tmp_path):
    ring = PoseRing.create(tmp_path / "pose.ring", capacity=512)
    reader = PoseRing.open(tmp_path / "pose.ring")
    ring.append(0, (0, 0, 0), Q0, 0.0, (0, 0, 0))
    stop = threading.Event()

    def write():
        i = 1
        while not stop.is_set():
            ring.append(i * 1000, (i, i, i), Q0, float(i), (i, i, i))
            i += 1

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(300):
            t = reader.latest_time_ns()
            p, _q, angle, axis = reader.poses_at(np.array([t, t - 100_000]))
            row = np.concatenate([p, angle[:, None], axis], axis=1)
            assert np.ptp(row, axis=1) == pytest.approx([0, 0], abs=1e-6)
    finally:
        stop.set()
        writer.join()


def test_file_that_is_not_a_ring_is_refused_by_name(tmp_path):
    path = tmp_path / "pose.ring"
    with pytest.raises(PoseRingError, match=r"pose\.ring"):
        PoseRing.open(path)
    path.write_bytes(b"x" * 100)
    with pytest.raises(PoseRingError, match="not a pose ring"):
        PoseRing.open(path)
