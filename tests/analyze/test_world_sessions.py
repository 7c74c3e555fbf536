"""The sessions of world shapes (`make bench-world-sessions`): true rest poses, and one whole session."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import Rotation

from tests.benchmarks.honesty.struck import Bank, settled_pose
from tests.benchmarks.honesty.world import run_world_session, world_specimen
from tests.benchmarks.world_sessions import Row, print_rows, row_of


@pytest.mark.parametrize(("degrees", "stands"), [(0.0, True), (3.0, True), (20.0, False)])
def test_a_body_settles_on_the_face_next_to_the_planned_one(degrees, stands):
    made = world_specimen("tissue_box", 0)
    planned = Rotation.from_euler("xz", [degrees, 2.0], degrees=True).as_matrix()
    rest = settled_pose(made, planned)
    assert (rest is not None) == stands
    if rest is not None:
        np.testing.assert_allclose(rest[2], [0, 0, 1], atol=1e-6)
        # Its long edge is put square to the tip.
        assert np.abs(rest[1]).max() == pytest.approx(1, abs=1e-6)


@pytest.mark.slow
def test_one_session_of_a_world_shape(tmp_path):
    found = run_world_session("charger", "cad", 1, Bank(tmp_path))
    row = row_of(found, Row("charger", "cad", 1))
    assert row.planned == row.struck == 9
    assert row.good >= 7
    assert row.c_error < 1
    assert not row.trusted_wrong
    out = io.StringIO()
    print_rows(Console(file=out, width=190), [row])
    assert "1 sessions, 1 answered" in out.getvalue()
