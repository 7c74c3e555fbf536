"""Turns of the object at rest by its markers, against drawn ones with known errors."""

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.rest_turns import UNKNOWN_SLOPE_SD, rest_turns
from analyze.types import RestTurn

MARKERS = (0, 1, 2, 2, 3, 3, 4, 4, 5)
"""marker that each of nine strikes over the edges of a box shows"""
STATED = np.radians(0.05)
OWN = np.radians(0.02)


def drawn(rng, crumb_sd, marker_sd=STATED, moved=None):
    """Turns that the markers show, and the true ones [rad]."""
    off, roll = rng.normal(0, np.radians(0.05), 6), rng.normal(0, np.radians(0.3))
    if moved is not None:
        off[moved] += np.radians(2.0)
    crumbs = rng.normal(0, crumb_sd, len(MARKERS))
    shown = crumbs + off[list(MARKERS)] + roll + rng.normal(0, OWN, len(MARKERS))
    turns = [
        (RestTurn(angle, OWN, str(name), marker_sd, "camera"),)
        for angle, name in zip(shown.tolist(), MARKERS, strict=True)
    ]
    return turns, crumbs


def test_crumbs_are_seen_by_measured_markers_to_their_own_error():
    off, sd = [], []
    for seed in range(150):
        turns, crumbs = drawn(np.random.default_rng(seed), np.radians(0.3))
        found = rest_turns(turns)
        sd.append(np.sqrt(np.diag(found.root @ found.root.T)))
        off.append((found.mean - crumbs) / sd[-1])
    assert np.mean(np.abs(off) < 1.96) > 0.9
    assert np.median(sd) < np.radians(0.15)


def test_unmeasured_markers_show_differences_between_strikes_alone():
    off = []
    for seed in range(150):
        turns, crumbs = drawn(np.random.default_rng(seed), np.radians(0.3), marker_sd=0.1)
        found = rest_turns(turns)
        apart = np.zeros(9)
        apart[2], apart[3] = 1.0, -1.0
        sd = np.linalg.norm(found.root.T @ apart)
        assert sd < np.radians(0.05)
        off.append(apart @ (found.mean - crumbs) / sd)
        single = np.sqrt(np.diag(found.root @ found.root.T))[[0, 1, 8]]
        assert np.all(single > 0.9 * found.sd)
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.3


def test_a_clean_table_is_not_corrected():
    found = [rest_turns(drawn(np.random.default_rng(seed), 0.0)[0]) for seed in range(40)]
    assert all(each.moved == () for each in found)
    assert np.median([each.sd for each in found]) < np.radians(0.02)
    assert np.median([np.abs(each.mean).max() for each in found]) < np.radians(0.01)
    assert max(np.abs(each.mean).max() for each in found) < np.radians(0.1)


@pytest.mark.parametrize("marker", [0, 2])
def test_a_marker_that_was_moved_is_named_and_corrects_nothing(marker):
    named = 0
    for seed in range(40):
        turns, _ = drawn(np.random.default_rng(seed), np.radians(0.02), moved=marker)
        found = rest_turns(turns)
        named += found.moved == (str(marker),)
        assert np.abs(found.mean).max() < np.radians(0.12)
    assert named == 40


def test_without_known_places_nothing_is_said():
    assert rest_turns([(), (), ()]) is None


SLOPES_SD = np.radians(1.5)
FACES = (0, 0, 0, 0, 0, 1, 1, 1, 1)
"""resting face of each of the nine strikes"""


def by_faces():
    """Covariance of the turns [rad^2]: the strikes on one face share its slope's error."""
    return SLOPES_SD**2 * np.equal.outer(FACES, FACES).astype(float)


def test_slopes_of_faces_are_no_moved_markers():
    """A scanned face 3 degrees off made its strikes' marker pass for moved, and phi was not corrected."""
    off, moved = [], 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        slopes = rng.normal(0, SLOPES_SD, 2)[list(FACES)]
        turns, crumbs = drawn(rng, np.radians(0.02))
        turns = [(replace(turn, angle=turn.angle + by),) for (turn,), by in zip(turns, slopes, strict=True)]
        found = rest_turns(turns, by_faces())
        moved += len(found.moved)
        sd = np.sqrt(np.sum(found.root**2, axis=1))
        off.append((found.mean - slopes - crumbs) / sd)
        assert np.all(sd < 0.8 * SLOPES_SD)
    assert moved == 0
    assert np.mean(np.abs(off) < 1.96) > 0.9


def test_slopes_remain_in_the_errors_where_no_marker_shows_them():
    found = rest_turns([()] * len(FACES), by_faces())
    assert np.all(found.mean == 0)
    assert found.root @ found.root.T == pytest.approx(by_faces(), abs=1e-9)
    assert found.moved == ()
    assert rest_turns([()] * 3, np.zeros((3, 3))) is None


def test_exact_slopes_change_nothing():
    turns, _ = drawn(np.random.default_rng(3), np.radians(0.3))
    plain, exact = rest_turns(turns), rest_turns(turns, np.zeros((9, 9)))
    assert np.array_equal(plain.mean, exact.mean)
    assert np.array_equal(plain.root, exact.root)


FACE_STRIKES = {"p0": (0, 1, 2, 3), "p1": (4, 5, 6, 7, 8)}
SLOPE_SD = np.radians(0.3)


def on_faces(turned, moved=None, seed=0):
    """Turns shown of strikes on two faces of a scan, p0 lying turned by `turned` [rad], with truth."""
    turns, crumbs = drawn(np.random.default_rng(seed), 0.0, moved=moved)
    mine = np.isin(np.arange(len(MARKERS)), FACE_STRIKES["p0"])
    turns = [
        tuple(replace(turn, angle=turn.angle + turned * on) for turn in each)
        for each, on in zip(turns, mine, strict=True)
    ]
    rows = {name: np.isin(np.arange(len(MARKERS)), at).astype(float) for name, at in FACE_STRIKES.items()}
    slopes = sum(SLOPE_SD**2 * np.outer(row, row) for row in rows.values())
    doubtful = {name: UNKNOWN_SLOPE_SD**2 * np.outer(row, row) for name, row in rows.items()}
    return turns, crumbs + turned * mine, slopes, doubtful


def test_markers_that_agree_show_how_the_object_lies_on_a_face():
    for seed in range(20):
        turns, truth, slopes, doubtful = on_faces(np.radians(3), seed=seed)
        found = rest_turns(turns, slopes, doubtful)
        assert found.lying_askew == ("p0",)
        assert found.moved == ()
        assert found.either == ()
        sd = np.linalg.norm(found.root, axis=1)
        assert np.all(np.abs(found.mean - truth) < 4 * sd)
        assert np.all(np.abs(found.mean[:4] - np.radians(3)) < np.radians(0.5))


def test_a_face_seen_by_one_marker_alone_leaves_open_which_of_them_is_wrong():
    turns, _, slopes, doubtful = on_faces(np.radians(3))
    turns = [tuple(replace(turn, marker="0") for turn in each) for each in turns[:4]] + turns[4:]
    found = rest_turns(turns, slopes, doubtful)
    assert found.lying_askew == ("p0",)
    assert found.moved == ("0",)
    assert found.either == ((("p0",), ("0",)),)
    assert np.all(np.linalg.norm(found.root, axis=1)[:4] > np.radians(1))


def test_slopes_within_their_errors_doubt_no_face():
    named = 0
    for seed in range(40):
        turned = np.random.default_rng(seed).normal(0, SLOPE_SD)
        found = rest_turns(*[each for i, each in enumerate(on_faces(turned, seed=seed)) if i != 1])
        named += found.lying_askew != () or found.moved != ()
    assert named == 0
