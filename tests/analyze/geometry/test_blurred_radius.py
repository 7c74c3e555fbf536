"""Radii of the edges of scanned meshes: any from 0 to the one seen, as meshing rounds every edge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analyze.geometry.edge_radius import ASSUMED, MAX_ASSUMED_RADIUS, edge_radius, scanned_radius
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.examine import Bench
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.information import RADIUS
from analyze.planning.pivots import pivot_axes
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.stable_planes import resting_planes
from analyze.planning.view import default_camera
from analyze.reading.object_file import read_object_files
from analyze.types import RadiusSource
from schemas.object_spec import ObjectSpec
from tests.world.catalogue import make
from tests.world.object_files import write_object

TRUE_RADIUS = {"gelatin_box": 0.6e-3, "wallet": 1.9e-3}


def scanned(name: str, folder: Path) -> tuple[ObjectSpec, ObjectModel]:
    """Object file and model of a world shape whose meshing rounds edges by 1 to 5 mm."""
    files = read_object_files(write_object(make(name, 1), "scan", folder))
    return files.spec, load_object_model(files.spec, files.shape_bytes, files.shape_name)


@pytest.mark.parametrize("name", sorted(TRUE_RADIUS))
def test_true_radius_lies_within_the_prior_of_every_edge(name: str, tmp_path: Path) -> None:
    spec, model = scanned(name, tmp_path)
    axes = pivot_axes(model, spec, resting_planes(model), hypothesis(model))
    priors = [edge_radius(spec, model, axis.id, axis.edge[0], axis.direction) for axis in axes]
    assert {prior.source for prior in priors} == {RadiusSource.BLURRED}
    off = np.array([(prior.mean - TRUE_RADIUS[name]) / prior.sd for prior in priors])
    assert np.abs(off).max() < 2.0
    for axis, prior in zip(axes, priors, strict=True):
        assert prior.mean >= ASSUMED.mean
        assert prior.sd >= ASSUMED.sd
        if not axis.moulded:
            assert (axis.radius, axis.radius_sd) == (prior.mean, prior.sd)


def test_the_larger_the_radius_seen_the_less_is_known(tmp_path: Path) -> None:
    spec, model = scanned("gelatin_box", tmp_path)
    assert model.cloud is not None
    edge = model.cloud.roundings[0]

    def seen_as(radius: float) -> ObjectModel:
        assert model.cloud is not None
        return replace(model, cloud=replace(model.cloud, roundings=(replace(edge, radius=radius),)))

    small, large = (
        edge_radius(spec, seen_as(radius), "p0e0", edge.start, edge.direction) for radius in (1e-3, 5e-3)
    )
    assert (small.mean, small.sd) == pytest.approx((MAX_ASSUMED_RADIUS / 2, ASSUMED.sd))
    assert large.mean == pytest.approx(2.5e-3)
    assert np.hypot(large.common_sd, large.own_sd) == pytest.approx(5e-3 / np.sqrt(12))
    # The meshing rounded this edge too, though no second face shows it.
    other = scanned_radius(seen_as(5e-3), edge.start + 0.03 * np.ones(3), edge.direction)
    assert other == large


def test_statement_stands_against_a_blurred_edge(tmp_path: Path) -> None:
    spec, model = scanned("gelatin_box", tmp_path)
    assert model.cloud is not None
    edge = model.cloud.roundings[0]
    stated = spec.model_copy(update={"edge_radius_m": 6e-4, "edge_radius_sd_m": 2e-4})
    found = edge_radius(stated, model, "p0e0", edge.start, edge.direction)
    assert (found.mean, found.source) == (6e-4, RadiusSource.STATED)


def test_forecast_counts_with_what_the_scan_leaves_open(tmp_path: Path) -> None:
    """The plan counted with the 0.75 mm of edges that nobody measured, whatever the scan showed."""
    spec, model = scanned("gelatin_box", tmp_path)
    bench = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION)
    information = prepare_object(model, spec, bench).information
    assert information.candidates
    for each in information.candidates:
        known = replace(each, axis=replace(each.axis, radius_sd=None))
        by_scan, by_rule = (
            information.measurements(candidate, 1)[0][0, RADIUS] for candidate in (each, known)
        )
        assert each.axis.radius_sd is not None
        assert by_scan == pytest.approx(by_rule * each.axis.radius_sd / information.errors.edge_radius)
