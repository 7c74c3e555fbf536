"""Tosses of a real cube: flight and contact give the same centre of mass independently."""

from __future__ import annotations

import json
import struct
import zipfile

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main
from analyze.errors import EstimationError, RecordingError
from analyze.flight.free_flight import FlightBody, fit_flights
from analyze.flight.free_rotation import fit_rotations
from analyze.least_squares.intervals import pooled_freedom, student_sigmas_95
from analyze.motion.moment_balance import BalancedBody, balance_moments
from analyze.reproduce.cube_tosses import (
    AIR_DRAG,
    GRAVITY_M_S2,
    ROUNDING_M,
    edge_contacts,
    flights,
)
from analyze.reproduce.cube_tosses_file import MAX_UNPACKED_BYTES, read_tosses
from tests.analyze.flight.tossed_cube import EDGE, MASS, Cube, tossed
from tests.places import ROOT

DATA = ROOT.parent / "shared" / "data" / "contactnets_tosses.npz"
CUBE = Cube(np.array([0.0, 0.001, 0.006]), np.array([1.0, 0.95, 0.9]) * 1e-3)


def write(path, motions, **changes):
    from scipy.spatial.transform import Rotation

    columns = {
        "length": np.array([len(motion) for motion in motions]),
        "position_m": np.concatenate([motion.position for motion in motions]),
        "quaternion_wxyz": np.concatenate(
            [Rotation.from_matrix(motion.R_world_object).as_quat()[:, [3, 0, 1, 2]] for motion in motions]
        ),
    }
    np.savez(path, **{**columns, **changes})
    return path


@pytest.fixture(scope="module")
def real():
    if not DATA.is_file():
        pytest.skip(f"{DATA.name} is not beside this repository")
    done = CliRunner().invoke(main, ["reproduce", "cube-tosses", "--data", str(DATA), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_edge_contact_and_flight_agree_on_the_real_cube(real):
    assert real["edge_minus_flight"]["distance"] < 1e-3
    for low, value, high in zip(*real["edge_minus_flight"]["interval95"], [0, 0, 0], strict=False):
        assert value is not None
        assert low < high
    com = np.array(real["edge_contact"]["centre_of_mass"]["value"])
    assert 5e-3 < np.linalg.norm(com) < 6.5e-3
    assert max(real["edge_contact"]["centre_of_mass"]["sd"]) < 2e-4


def test_real_cubes_inertia_is_that_of_a_hollow_cube_with_a_load(real):
    moments = np.diag(real["edge_contact"]["inertia_per_mass"]["value"])
    assert np.all((moments > EDGE**2 / 6) & (moments < EDGE**2 * 5 / 18))
    assert moments == pytest.approx(np.diag(real["corner_contact"]["inertia_per_mass"]["value"]), rel=0.06)


def test_g_determines_the_length_of_the_files_metre(real):
    gravity = real["flight"]["gravity"]
    assert gravity["value"] == pytest.approx(9.62, abs=0.03)
    assert real["metre_of_the_file"] == pytest.approx(GRAVITY_M_S2 / gravity["value"])


@pytest.mark.parametrize("way", ["edge_contact", "corner_contact"])
def test_ratios_of_the_inertia_by_flight_and_by_contact_agree(real, way):
    flight, contact = real["flight"]["inertia_ratios"], real[way]["inertia_ratios"]
    off = np.diag(flight["value"]) - np.diag(contact["value"])
    assert np.all(np.abs(off) < 2 * np.hypot(np.diag(flight["sd"]), np.diag(contact["sd"])))
    assert np.diag(flight["sd"]).max() < 0.006


@pytest.mark.slow
def test_ratios_from_halves_of_the_throws_differ_as_stated():
    """The documentation's share, 93 %, is of 40 halves."""
    if not DATA.is_file():
        pytest.skip(f"{DATA.name} is not beside this repository")
    found = flights(read_tosses(DATA))
    throws = np.array([each.group for each in found])
    rng = np.random.default_rng(1)
    held: list[np.ndarray] = []
    for _ in range(10):
        half = np.isin(throws, rng.permutation(np.unique(throws))[: len(np.unique(throws)) // 2])
        one, other = (
            fit_rotations([each for each, chosen in zip(found, mask, strict=True) if chosen])
            for mask in (half, ~half)
        )
        variances = np.array([np.diag(body.covariance) for body in (one, other)])
        freedom = pooled_freedom(variances, np.array([one.freedom, other.freedom]))
        width = student_sigmas_95(freedom) * np.sqrt(variances.sum(axis=0))
        held.append(np.abs(one.ratios - other.ratios) < width)
    assert np.mean(held) >= 0.85


@pytest.mark.parametrize("way", ["flight", "edge"])
def test_estimates_from_an_eighth_of_the_tosses_differ_as_stated(way):
    """Of 95 % intervals 89 % (flight) and 80 % (edges) held with large-sample errors."""
    if not DATA.is_file():
        pytest.skip(f"{DATA.name} is not beside this repository")
    tosses = read_tosses(DATA)
    found = flights(tosses) if way == "flight" else edge_contacts(tosses)
    groups = np.array([each.group for each in found])
    rng = np.random.default_rng(4)
    held: list[np.ndarray] = []
    for _ in range(3):
        eighth = rng.permutation(len(groups)) % 8
        bodies: list[FlightBody | BalancedBody] = []
        for part in range(8):
            some = [each for each, number in zip(found, eighth, strict=True) if number == part]
            try:
                bodies.append(fit_flights(some, AIR_DRAG) if way == "flight" else balanced(some))
            except EstimationError:
                continue
        for one, other in zip(bodies[::2], bodies[1::2], strict=False):
            variances = np.array([np.diag(body.covariance)[:3] for body in (one, other)])
            freedom = pooled_freedom(variances, np.array([body.freedom[:3] for body in (one, other)]))
            half = student_sigmas_95(freedom) * np.sqrt(variances.sum(axis=0))
            held.append(np.abs(one.com - other.com) < half)
    assert len(held) >= 6
    assert np.mean(held) >= 0.9


def balanced(contacts):
    return balance_moments(contacts, GRAVITY_M_S2, ROUNDING_M)


def test_simulated_file_with_a_short_metre_gives_its_ground_truth(tmp_path):
    """Run the whole command on simulated motions of known c, I and scale."""
    motions = [*tossed(CUBE, 12, 1, "air"), *tossed(CUBE, 20, 1, "edge"), *tossed(CUBE, 50, 1, "corner")]
    short = [type(motion)(motion.time, motion.position / 1.02, motion.R_world_object) for motion in motions]
    plot = tmp_path / "cube.png"
    done = CliRunner().invoke(
        main,
        [
            "reproduce",
            "cube-tosses",
            "--data",
            str(write(tmp_path / "t.npz", short)),
            "--json",
            "--plot",
            str(plot),
        ],
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    # The simulation has no air; the drag that the estimate assumes is within the stated sd.
    assert found["metre_of_the_file"] == pytest.approx(1.02, abs=0.004)
    assert found["edge_contact"]["centre_of_mass"]["value"] == pytest.approx(CUBE.com.tolist(), abs=1.5e-4)
    assert MASS * np.diag(found["edge_contact"]["inertia_per_mass"]["value"]) == pytest.approx(
        CUBE.moments, rel=0.02
    )
    assert plot.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"length": np.array([5, 5])}, "lengths do not match"),
        ({"position_m": np.full((236, 3), np.nan)}, "lengths do not match|invalid poses"),
        ({"quaternion_wxyz": np.zeros((3, 3))}, "lengths do not match"),
    ],
)
def test_file_of_another_kind_is_refused(tmp_path, changes, words):
    with pytest.raises(RecordingError, match=words):
        read_tosses(write(tmp_path / "t.npz", tossed(CUBE, 2, 1), **changes))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("{'descr': '<i8', 'fortran_order': False, 'shape': (3,", "not a file of packed tosses"),
        ("{'descr': '<i8', 'fortran_order': False, 'shape': (10000000000000,), }", "packed tosses"),
        ("{'descr': '<i8', 'fortran_order': False, 'shape': (3L,), }", "not a file of packed tosses"),
    ],
)
def test_damaged_and_false_headers_are_refused_without_a_word_beside(tmp_path, header, words):
    npy = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) + 1) + header.encode() + b"\n"
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as archive:
        archive.writestr("length.npy", npy)
    with pytest.raises(RecordingError, match=words):
        read_tosses(tmp_path / "t.npz")


def test_bomb_is_refused_unread(tmp_path):
    with zipfile.ZipFile(tmp_path / "t.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("length.npy", bytes(MAX_UNPACKED_BYTES + 1))
    with pytest.raises(RecordingError, match="unpacks to 200 MB, more than 200 MB"):
        read_tosses(tmp_path / "t.npz")


def test_missing_file_and_non_archive_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="give --data FILE"):
        read_tosses(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(RecordingError, match="not a file of packed tosses"):
        read_tosses(tmp_path / "text.npz")
    np.savez(tmp_path / "pickled.npz", length=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordingError, match="not a file of packed tosses"):
        read_tosses(tmp_path / "pickled.npz")
