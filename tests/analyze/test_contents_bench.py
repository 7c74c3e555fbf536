"""The trial of the tests of rigidity (`make bench-contents`): its simulations, and that it runs."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from rich.console import Console

from tests.benchmarks.contents.__main__ import RIGID, cells, print_tables, run_chunk
from tests.benchmarks.contents.bodies import chosen_edges, draw_box, needed_energy
from tests.benchmarks.contents.contained import INSIDES, contained_evidence
from tests.benchmarks.contents.moving import floor_path, level_path, pendulum_path
from tests.benchmarks.contents.planar import Curves, G, Lanes, simulate
from tests.benchmarks.contents.scores import Score, score_tests

WIDTH, HEIGHT = 0.06, 0.14


def lanes(energies: list[float], moving: float = 0.0, friction: float = 0.0) -> tuple[Lanes, Curves]:
    """Boxes of 0.2 kg and 80 x 150 mm at several energies, with a lump that slides on the floor."""
    n, mass, size, up, rho = len(energies), 0.2, (0.08, 0.15), 0.075, 1e-3
    back, inertia = 0.5 * size[0] - rho, mass * (size[0] ** 2 + size[1] ** 2) / 12
    distance, phi = math.hypot(back, up - rho), math.atan2(back, up - rho)
    about = inertia + mass * (back**2 + up**2)
    impulse = np.sqrt(2 * mass * G * distance * (1 - math.cos(phi)) * about * np.array(energies)) / 0.12
    values = [mass * (1 - moving), inertia, back, up, size[0] - 2 * rho, rho, 0.7, 2000.0, 0.2]
    values += [mass * moving, friction, 0.0, 0.0]
    rows = [*(np.full(n, value) for value in values), impulse, np.full(n, 0.12), np.full(n, 0.003)]
    made = Lanes(*rows)
    path = floor_path(WIDTH, 0.02, 0.5)
    places = path.places - [0.0, up]
    curves = Curves.through(np.tile(path.parameter, (n, 1)), np.tile(places, (n, 1, 1)), np.zeros(n))
    return made, curves


def test_a_rigid_box_tips_over_from_an_energy_ratio_of_one_and_a_lump_goes_along():
    found = simulate(*lanes([0.97, 1.03]), seconds=0.5)
    assert found.theta[-1, 0] < found.theta[:, 0].max() - 0.1
    assert found.theta[-1, 1] == found.theta[:, 1].max() > 0.5
    assert np.abs(found.slip[:200]).max() < 5e-4
    # A lump of a tenth of the mass slides ahead as the box tips, up to the wall at the most.
    lump = simulate(*lanes([1.03], moving=0.1, friction=0.1), seconds=0.25)
    assert lump.inside[0, 0] == 0
    assert 4e-3 < lump.inside[-1, 0] < 0.021


def test_centroid_of_a_liquid_moves_as_theory_has_it_for_small_slopes():
    filled = 0.4
    path, depth = level_path(WIDTH, HEIGHT, filled), filled * HEIGHT
    middle = int(np.argmin(np.abs(path.parameter)))
    assert path.places[middle] == pytest.approx([0, depth / 2], abs=1e-6)
    slope = math.tan(path.parameter[middle + 2])
    assert path.places[middle + 2, 0] == pytest.approx(WIDTH**2 / (12 * depth) * slope, rel=1e-3)
    pendulum = pendulum_path(WIDTH, depth)
    shift = pendulum.share * pendulum.places[middle + 2, 0]
    assert shift == pytest.approx(WIDTH**2 / (12 * depth) * math.sin(path.parameter[middle + 2]), rel=0.02)


def test_boxes_hold_their_contents_and_have_edges_to_test():
    for name, contents in cells().items():
        box = draw_box(contents, np.random.default_rng(len(name)))
        edges = chosen_edges(box, np.random.default_rng(1))
        assert edges is not None
        assert len({edge.pose for edge in edges}) == 2
        assert box.mass - box.fixed == pytest.approx(contents.share * box.mass)
        inertia, energy = needed_energy(box, edges[0])
        assert 0 < energy < box.mass * G * 0.1
        assert inertia < box.mass * 0.2**2


def test_tables_count_false_alarms_and_what_was_found():
    found = [Score(RIGID, 1, "nothing_moves", share=0.05, trusted=True, trusted_before=True)]
    found += [Score("powder 20 %", i, "not_rigid", by_poses=True, wrong=True) for i in range(3)]
    found += [Score("powder 20 %", 4, "nothing_moves", trusted=True, trusted_before=True, wrong=True)]
    out = io.StringIO()
    print_tables(Console(file=out, width=170), found)
    text = out.getvalue()
    assert "75 %" in text
    assert "rigid: 0 false alarms of 1" in text


@pytest.mark.slow
def test_a_liquid_is_found_and_a_rigid_box_passes():
    (rigid,) = run_chunk(RIGID, [1])
    (liquid,) = run_chunk("liquid, level 10 %", [2])
    assert rigid.answer == "nothing_moves"
    assert liquid.answer == "not_rigid"
    assert not liquid.trusted


@pytest.mark.slow
def test_a_lump_in_a_box_in_mujoco_is_found():
    answers = [score_tests(each.name, 1, contained_evidence(each, 1)).answer for each in INSIDES[:2]]
    assert answers == ["nothing_moves", "not_rigid"]
