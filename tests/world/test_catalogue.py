"""World shapes are closed solids of one piece with plausible mass, whose seeds keep their kind."""

import numpy as np
import pytest

from tests.world.catalogue import make, names
from tests.world.shapes import MassPart
from tests.world.solids import box, cylinder


def _check(name: str, seed: int) -> None:
    shape = make(name, seed)
    mass, com, inertia = shape.mass_properties()
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    assert shape.solid.status().name == "NoError"
    pieces = [piece for piece in shape.solid.decompose() if piece.volume() > 0]
    assert len(pieces) == 1, f"{name}: {len(pieces)} loose pieces"
    assert sum(part.share for part in shape.parts) == pytest.approx(1)
    assert np.all(1e3 * com > low)
    assert np.all(1e3 * com < high)
    moments = np.linalg.eigvalsh(inertia)
    assert 0 < moments[0] <= moments[2] <= moments[0] + moments[1]
    assert 20 < mass / (1e-9 * shape.solid.hull().volume()) < 8000, name
    assert 10 < shape.size_mm.max() < 500
    assert len(shape.tag_places()) >= 2


@pytest.mark.parametrize("name", names()[::12])
def test_shapes_are_closed_solids_of_plausible_mass(name):
    _check(name, 0)
    _check(name, 4)


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_every_shape(name):
    for seed in range(3):
        _check(name, seed)


def test_the_catalogue_is_large_and_mostly_household():
    """The benchmark needs at least 60 shapes; balls count as none of the household's."""
    assert len(names()) >= 150
    assert not make("tennis_ball").is_household
    assert make("mug").is_household


def test_moments_of_solids_and_surfaces():
    """Volume and surface moments against the closed forms of a box and a thin tube's end faces."""
    centroid, mean = MassPart("box", 1, box(30, 20, 10)).moments()
    np.testing.assert_allclose(centroid, [0, 0, 5], atol=1e-9)
    np.testing.assert_allclose(np.diag(mean), [75, 100 / 3, 100 / 3], rtol=1e-6)
    _, mean = MassPart("wall", 1, box(20, 20, 20, (0, 0, -10)), on_surface=True).moments()
    np.testing.assert_allclose(np.diag(mean), 20**2 * (1 / 3 * 1 / 4 + 2 / 3 * 1 / 12), rtol=1e-6)
    centroid, _ = MassPart("wall", 1, cylinder(10, 40), on_surface=True).moments()
    np.testing.assert_allclose(centroid, [0, 0, 20], atol=1e-6)
