"""The voxel map has the given moments, stays within its bounds, and reports what is not determined."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.estimation.part_masses import MeasuredMoments, measured_moments
from analyze.estimation.voxel_map import voxel_map
from analyze.geometry.plausible_size import DENSITIES
from analyze.pipeline.estimate import estimate_evidence
from analyze.report.voxel_map import voxel_figures, voxel_map_text, write_voxels
from tests.analyze.simulated_session import carton, session


@pytest.fixture(scope="module")
def estimate():
    return estimate_evidence(session(carton(), np.random.default_rng(3)))


def test_map_has_the_moments_within_its_bounds(estimate):
    voxels, com = estimate.voxels, estimate.com
    masses = voxels.density * voxels.volumes
    assert masses.sum() == pytest.approx(estimate.inertial.mass, rel=1e-3)
    assert np.linalg.norm(masses @ voxels.points / masses.sum() - com.position) < 5e-4
    assert voxels.misfit <= 1.0
    assert voxels.density.min() > 0
    assert voxels.density.max() < DENSITIES[1]


def test_heavier_half_has_the_larger_mass(estimate):
    body = carton()
    below = body.points[:, 2] < 0
    lower = estimate.voxels.points[:, 2] < 0
    masses = estimate.voxels.density * estimate.voxels.volumes
    assert (masses[lower].sum() < masses[~lower].sum()) == (
        body.masses[below].sum() < body.masses[~below].sum()
    )


def test_determined_shares_are_reported(estimate):
    voxels = estimate.voxels
    assert voxels.directions <= 10
    assert np.all((voxels.determined > 0) & (voxels.determined < 1))
    words = voxel_map_text(voxels)
    assert f"{voxels.directions} of its {len(voxels.points)} numbers were measured" in words
    assert "prior" in words


def test_impossible_moments_give_a_large_misfit(estimate):
    moments = measured_moments(estimate.inertial)
    outside = MeasuredMoments(
        moments.mass,
        moments.com + np.array([0.2, 0, 0]),
        moments.directions,
        moments.moments,
        moments.covariance,
    )
    voxels = voxel_map(outside, estimate.cells)
    assert voxels.misfit > 3
    assert "misses the moments" in voxel_map_text(voxels)


def test_uniform_body_gives_a_uniform_map(estimate):
    cells = estimate.cells
    masses = 0.05 * cells.volumes / cells.volumes.sum()
    centre = masses @ cells.points / masses.sum()
    arm = cells.points - centre
    directions = np.eye(3)
    about = np.array(
        [masses @ (np.sum(arm**2, axis=1) + cells.own_inertia - (arm @ line) ** 2) for line in directions]
    )
    sd = np.concatenate([[1e-5], np.full(3, 1e-4), 0.01 * about])
    voxels = voxel_map(MeasuredMoments(0.05, centre, directions, about, np.diag(sd**2)), cells)
    assert voxels.density == pytest.approx(np.full(len(cells.points), voxels.prior), rel=1e-3)


def test_figure_and_table(estimate, tmp_path):
    figures = voxel_figures(estimate.voxels)
    assert [len(figure.axes) for figure in figures] == [1, 1, 1, 1]
    write_voxels(estimate.voxels, tmp_path / "map.csv")
    lines = (tmp_path / "map.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# The most uniform distribution")
    assert lines[2] == "x,y,z,volume,density"
    table = np.loadtxt(lines[3:], delimiter=",")
    assert table.shape == (len(estimate.voxels.points), 5)
    assert table[:, 3] @ table[:, 4] == pytest.approx(estimate.inertial.mass, rel=1e-3)
