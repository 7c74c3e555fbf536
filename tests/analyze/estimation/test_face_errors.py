"""Error of a shape's faces where it is not stated: estimated from the agreement of strikes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from analyze.estimation.face_errors import estimated_face_sd, with_face_sd
from analyze.estimation.joint import solve_joint
from analyze.geometry.surface_error import ASSUMED_FILE_SD
from tests.analyze.estimation.bodies import SIX_AXES
from tests.analyze.estimation.test_edge_radii import BODY, NINE, PLANNED, PRIOR, session

SESSIONS = 10


def deviations(
    face_sd: float, axes: tuple, *, stated_as_exact: bool, seeds: Sequence[int] = range(SESSIONS)
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (sessions, 3) of the centre of mass over their stated sd, and the sds of faces used [m]."""
    found, sds = [], []
    for seed in seeds:
        planes, errors = with_face_sd(*session(seed, PLANNED, face_sd, axes), 0.0)
        if not stated_as_exact:
            assumed = with_face_sd(planes, errors, ASSUMED_FILE_SD)
            sds.append(estimated_face_sd(*assumed, PRIOR))
            planes, errors = with_face_sd(*assumed, sds[-1])
        solution = solve_joint(planes, errors, PRIOR)
        found.append((solution.x[:3] - BODY.com) / np.sqrt(np.diag(solution.covariance)[:3]))
    return np.array(found), np.array(sds)


@pytest.mark.parametrize(("axes", "inside"), [(SIX_AXES, 0.95), (NINE, 0.9)])
def test_centre_of_mass_is_inside_where_faces_are_off_and_nothing_is_stated(axes, inside):
    z, _ = deviations(3e-4, axes, stated_as_exact=False)
    assert np.mean(np.abs(z) < 1.96) >= inside
    z, _ = deviations(3e-4, axes, stated_as_exact=True)
    assert np.mean(np.abs(z) < 1.96) < 0.5, "as the shape counted before where its error was not stated"


def test_strikes_over_many_edges_show_that_a_shape_is_exact():
    z, sds = deviations(0.0, NINE, stated_as_exact=False)
    assert np.median(sds) < 0.65 * ASSUMED_FILE_SD
    assert np.all(np.abs(z) < 1.96)


def test_strikes_that_agree_by_chance_leave_larger_errors_possible():
    """Two sessions of 60, with faces 0.3 mm off, whose strikes agree by chance.

    They alone had the centre of mass more than 2 half widths off, by 2.2 and 2.1, while the error was taken
    to be as small as such strikes show it.
    """
    z, sds = deviations(3e-4, NINE, stated_as_exact=False, seeds=(24, 53))
    assert np.all(sds < 0.7 * ASSUMED_FILE_SD)
    assert np.abs(z).max() < 2 * 1.96


def test_few_strikes_leave_the_assumed_error():
    planes, errors = with_face_sd(*session(0, PLANNED, 0.0, SIX_AXES[:2]), 0.0)
    assumed = with_face_sd(planes, errors, ASSUMED_FILE_SD)
    assert estimated_face_sd(*assumed, PRIOR) == pytest.approx(1.36 * ASSUMED_FILE_SD, rel=0.1)


def test_error_of_faces_is_exchanged_in_edges_too():
    planes, errors = session(0, PLANNED, 3e-4)
    changed, less = with_face_sd(planes, errors, 1e-4)
    assert less.face_sd == 1e-4
    for before, after in zip(planes, changed, strict=True):
        assert after.edge_sd**2 - before.edge_sd**2 == pytest.approx(1e-8 - 9e-8)
