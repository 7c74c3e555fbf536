"""Round bodies put down at a heading a few degrees off: the centre of mass stays inside its interval."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from analyze.estimation.equiplane import equiplane_normal
from analyze.estimation.joint import solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.pipeline.rim_heading import CHECKED_HEADING_SD, HAND_HEADING_SD, with_heading_errors
from analyze.types import EquiPlane

pytestmark = pytest.mark.usefixtures("coarse_regions")

RADIUS, HEIGHT = 0.035, 0.12
COM_TRUE = np.array([0.009, -0.004, 0.01])
PRIOR = ComPrior.from_bounds(
    np.array([-RADIUS, -RADIUS, -HEIGHT / 2]), -np.array([-RADIUS, -RADIUS, -HEIGHT / 2])
)
ERRORS = SystematicErrors(gravity_tilt_sd=1e-4, edge_radius_sd=1e-5)
NOISE = math.radians(0.02)


def plane(number, end, azimuth, turned, rng):
    """Equi-plane of a strike that was planned over the rim at an azimuth, and done at another by `turned`."""
    up = np.array([0.0, 0.0, float(end)])

    def line(angle):
        forward = np.array([math.cos(angle), math.sin(angle), 0.0])
        return np.cross(up, forward), RADIUS * forward - up * HEIGHT / 2, forward

    _, point, forward = line(azimuth + turned)
    arm = COM_TRUE - point
    phi = math.atan2(-float(arm @ forward), float(arm @ up)) + rng.normal(0, NOISE)
    direction, point, _ = line(azimuth)
    return EquiPlane(
        strike_id=f"s{number}",
        axis_id=f"{end}{azimuth:.1f}",
        point=point,
        direction=direction,
        up=up,
        normal=equiplane_normal(direction, up, phi),
        phi=phi,
        sd_phi=NOISE,
        k=None,
        sd_k=None,
        cov_phi_k=0.0,
        edge_radius=0.0,
        edge_sd=2e-5,
        face=str(end),
    )


def session(rng, heading_sd, placed=False, rolls=True, turn_sd=None):
    """Equi-planes of eight strikes over both rims, before and after the error of the heading is added.

    The markers are turned on the object, about its axis, by an error of `turn_sd`.
    """
    turn = 0.0 if turn_sd is None else rng.normal(0, turn_sd)
    spots = [(end, azimuth) for end in (1, -1) for azimuth in (0.0, 1.6, 3.1, 4.7)]
    planes = [plane(i, *spot, turn + rng.normal(0, heading_sd), rng) for i, spot in enumerate(spots)]
    marker = SimpleNamespace(T_object_marker=np.eye(4) if placed else None, turn_sd_rad=turn_sd)
    evidence = SimpleNamespace(
        motions=[SimpleNamespace(strike_id=each.strike_id) for each in planes],
        planned=lambda _: SimpleNamespace(rolls=rolls),
        spec=SimpleNamespace(marker=[marker]),
    )
    return planes, with_heading_errors(planes, cast("Any", evidence), ERRORS, PRIOR)


def standardised(planes):
    """Error of c along x and y, over its sd."""
    solution = solve_joint(planes, ERRORS, PRIOR)
    return ((solution.x[COM] - COM_TRUE) / np.sqrt(np.diag(solution.covariance[COM, COM])))[:2]


def test_headings_by_hand_are_inside_the_interval():
    """Without the error of the heading c was off by 1.7 sd, rms, and its intervals were wider."""
    rng = np.random.default_rng(0)
    for heading_sd, placed in ((HAND_HEADING_SD, False), (CHECKED_HEADING_SD, True)):
        pairs = [session(rng, heading_sd, placed) for _ in range(16)]
        before, after = (np.array([standardised(pair[i]) for pair in pairs]) for i in (0, 1))
        assert np.sqrt(np.mean(after**2)) < 1.2
        assert np.sqrt(np.mean(after**2)) > 0.5
        assert np.sqrt(np.mean(before**2)) > (1.1 if placed else 1.5)


def test_a_turn_of_all_markers_is_an_error_that_strikes_share():
    """Taken for an error of each strike alone, of the same size, it left c off by 2.0 sd, rms."""
    rng = np.random.default_rng(1)
    turn_sd = math.radians(5.0)
    found = [standardised(session(rng, CHECKED_HEADING_SD, True, True, turn_sd)[1]) for _ in range(14)]
    assert 0.6 < np.sqrt(np.mean(np.square(found))) < 1.25


def test_straight_edges_have_no_error_of_the_heading():
    planes, after = session(np.random.default_rng(0), 0.0, rolls=False)
    assert after == tuple(planes)
