"""Pivot lines that the motion places better than the shape."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_normal
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.geometry.edge_radius import blurred_radius
from analyze.pipeline.measured_place import with_measured_places
from analyze.pipeline.sections import SCANNED_EDGE_SD
from analyze.types import EquiPlane, PivotPlace

PLACE_SD = 5e-4
COM = np.array([0.002, -0.001, 0.07])
PRIOR = blurred_radius(6e-3)


def strikes(off, ahead_sd=PLACE_SD, prior=PRIOR):
    """Planes, plan and motions of strikes over four edges whose lines are `off` [m] ahead of the planned."""
    planes, plan, motions = [], [], []
    for number, tip in enumerate(np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])):
        up = np.array([0.0, 0.0, 1.0])
        line = 0.02 * tip + prior.mean * up
        arm = COM - (line + off[number] * tip)
        phi = math.atan2(-arm @ tip, arm[2])
        along = np.cross(up, tip)
        planes.append(
            EquiPlane(
                f"s{number}.1",
                f"p0e{number}",
                line,
                along,
                up,
                equiplane_normal(along, up, phi),
                phi,
                2e-4,
                None,
                None,
                0.0,
                prior.mean,
                3e-4,
                heading=0.0,
                face="p0",
                radius_prior=prior,
            )
        )
        plan.append(SimpleNamespace(pivot=SimpleNamespace(point=tuple(line), radius_m=prior.mean)))
        seen = None if ahead_sd is None else PivotPlace(math.cos(phi) * off[number], ahead_sd)
        motions.append(SimpleNamespace(pivot_place=seen))
    return planes, plan, motions


def height(planes):
    """Estimated height of c [m] and its sd, by the balance angles."""
    errors, prior = SystematicErrors(2e-3), ComPrior(np.array([0, 0, 0.05]), np.full(3, 0.05))
    found = centre_of_mass(planes, errors, prior)
    return found.position[2], math.sqrt(found.covariance[2, 2])


def test_lines_that_a_chamfer_moves_inwards_are_taken_where_the_motion_shows_them():
    planes, plan, motions = strikes([-2e-3, -2.5e-3, -2e-3, -2.5e-3])
    placed = with_measured_places(planes, plan, motions, SCANNED_EDGE_SD)
    for plane, motion in zip(placed, motions, strict=True):
        assert abs(plane.normal @ (COM - plane.point)) < PLACE_SD
        assert plane.edge_sd < motion.pivot_place.sd
        assert not plane.rounded
        assert plane.radius_sd == pytest.approx(PRIOR.sd, rel=1e-3)
    before, after = height(planes), height(placed)
    assert abs(before[0] - COM[2]) > 5e-3
    assert abs(after[0] - COM[2]) < 2 * after[1] < 4e-3


@pytest.mark.parametrize("case", ["unknown", "vague", "next line", "of the shape", "known edge"])
def test_other_planes_stay(case):
    planes, plan, motions = strikes([1e-3] * 4)
    if case == "unknown":
        planes, plan, motions = strikes([1e-3] * 4, None)
    elif case == "vague":
        planes, plan, motions = strikes([1e-3] * 4, 4e-3)
    elif case == "next line":
        planes = [replace(plane, facet_rad=0.2) for plane in planes]
    elif case == "of the shape":
        planes = [replace(plane, rounded=False) for plane in planes]
    else:
        planes, plan, motions = strikes(
            [1e-3] * 4, prior=replace(PRIOR, common_sd=1e-4, own_sd=1e-4, face_sd=0)
        )
        planes = [replace(plane, edge_sd=1e-4) for plane in planes]
    placed = with_measured_places(planes, plan, motions)
    assert all(one is other for one, other in zip(placed, planes, strict=True))


@pytest.mark.parametrize("ahead_sd", [None, 4e-3])
def test_edges_of_a_scan_have_their_own_error_where_no_motion_places_them(ahead_sd):
    planes, plan, motions = strikes([1e-3] * 4, ahead_sd)
    for placed in with_measured_places(planes, plan, motions, SCANNED_EDGE_SD):
        assert placed.edge_sd == pytest.approx(math.hypot(2e-4, SCANNED_EDGE_SD), rel=0.3)
        assert placed.rounded


def test_the_strikes_of_one_axis_share_their_place():
    planes, plan, motions = strikes([-2e-3] * 4)
    again = replace(planes[0], strike_id="s9.1")
    further = SimpleNamespace(pivot_place=PivotPlace(motions[0].pivot_place.ahead + 4e-4, PLACE_SD))
    placed = with_measured_places([*planes, again], [*plan, plan[0]], [*motions, further], SCANNED_EDGE_SD)
    assert placed[0].point == pytest.approx(placed[4].point)
    alone = with_measured_places(planes, plan, motions, SCANNED_EDGE_SD)[0]
    assert (placed[0].point - alone.point) @ placed[0].normal != 0
    assert placed[0].edge_sd == alone.edge_sd
