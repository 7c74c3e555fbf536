"""Impacts of a dropped ellipse: restitution and friction from a file of the published layout.

The impacts are simulated here by impulses of a rigid body with Coulomb friction; no published data are used.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat

from analyze.cli import main
from analyze.errors import EstimationError, RecordingError
from analyze.reproduce.planar_impacts import GYRATION_M, MIN_IMPACTS, PlanarAnswer, analyse_impacts
from analyze.reproduce.planar_impacts_document import answer_json
from analyze.reproduce.planar_impacts_file import MAX_BYTES, PlanarImpacts, read_impacts
from analyze.reproduce.planar_impacts_table import render_impacts
from schemas.terminal import Terminal

A, B = 0.035, 0.025
MU, RESTITUTION, SCATTER = 0.2, 0.6, 0.05


def after_impacts(before, arm, height, restitution, mu):
    """Velocities (n, 3) after impacts: impulses in small parts, the friction of each against the sliding."""
    nil, one = np.zeros(len(arm)), np.ones(len(arm))
    normal, tangent = np.column_stack([nil, one, arm]), np.column_stack([one, nil, height])
    inverse = np.array([1.0, 1.0, 1.0 / GYRATION_M**2])
    approach = -np.sum(normal * before, axis=1)
    part = 2e-3 * approach
    stick = -np.sum(tangent * inverse * normal, axis=1) / np.sum(tangent * inverse * tangent, axis=1)
    held = np.clip(stick, -mu, mu)
    v, gathered, whole = before.copy(), nil, np.full(len(arm), np.inf)
    while np.any(gathered < whole):
        slide = np.sum(tangent * v, axis=1)
        ratio = np.where(np.abs(slide) > 5 * part, -mu * np.sign(slide), held)
        given = np.where(gathered < whole, part, 0.0)
        v = v + given[:, None] * inverse * (normal + ratio[:, None] * tangent)
        gathered = gathered + given
        rises = np.sum(normal * v, axis=1) >= restitution * approach  # Newton's law
        whole = np.where(rises, np.minimum(whole, gathered), whole)
    return v


def impacts(number=400, seed=1, mu=MU, noise=(0.01, 2.0), mirrored=False):
    """Fields of the file's struct for simulated drops, with errors of the velocities."""
    rng = np.random.default_rng(seed)
    theta = rng.uniform(0, np.pi, number)
    height = np.hypot(A * np.sin(theta), B * np.cos(theta))
    arm = -(A**2 - B**2) * np.sin(theta) * np.cos(theta) / height
    before = np.column_stack(
        [rng.uniform(0.2, 1.2, number), rng.uniform(-2.9, -2.3, number), rng.normal(0, 6, number)]
    )
    after = after_impacts(before, arm, height, rng.normal(RESTITUTION, SCATTER, number), mu)
    error = np.array([noise[0], noise[0], noise[1]])
    before, after = (each + error * rng.standard_normal(each.shape) for each in (before, after))
    if mirrored:
        before[:, 0], after[:, 0] = -before[:, 0], -after[:, 0]
    place = np.column_stack([np.zeros(number), height, theta])
    one, nil = np.ones(number), np.zeros(number)
    return {
        "states_i": np.hstack([place, before]),
        "states_f": np.hstack([place, after]),
        "n": np.column_stack([nil, one, arm]),
        "d": np.column_stack([one, nil, height]),
    }


def write(path, fields):
    savemat(path, {"data": fields}, do_compression=True)
    return path


def analysed(**settings) -> PlanarAnswer:
    """Answer of simulated impacts that never were in a file."""
    fields = impacts(**settings)
    columns = (fields["states_i"][:, 3:], fields["states_f"][:, 3:], fields["n"][:, 2], fields["d"][:, 2])
    return analyse_impacts(PlanarImpacts(*columns))


def answer(tmp_path, **settings) -> PlanarAnswer:
    return analyse_impacts(read_impacts(write(tmp_path / "impacts.mat", impacts(**settings))))


def shown(found: PlanarAnswer) -> str:
    with (console := Terminal(width=200)).capture() as capture:
        render_impacts(found, console)
    return " ".join(capture.get().split())


@pytest.mark.parametrize("mirrored", [False, True])
def test_restitution_and_friction_are_recovered_from_either_handedness(tmp_path, mirrored):
    found = answer(tmp_path, mirrored=mirrored)
    assert found.rigid.mirrored is mirrored
    assert found.rigid.explained > 0.98
    assert found.rigid.pulls == 0
    assert found.rigid.gains == 0
    assert found.restitution.value == pytest.approx(RESTITUTION, abs=0.015)
    assert found.restitution_scatter == pytest.approx(SCATTER, abs=0.01)
    assert found.friction.value is not None
    assert found.friction.slid > 40
    assert found.friction.value.value == pytest.approx(MU, abs=0.005)
    assert found.friction.opposing > 0.95
    assert found.friction.beyond < 0.03
    assert found.friction.held_percentiles[-1] < MU + 0.02
    low, high = (each.value for each in found.rigid.gyration)
    assert low - 2e-4 < GYRATION_M < high + 2e-4
    assert ("opposite handedness" in shown(found)) is mirrored


def test_a_rough_table_gives_a_bound_only():
    found = analysed(mu=1.0, number=MIN_IMPACTS)
    assert found.friction.value is None
    assert "friction is at least" in shown(found)
    document = answer_json(found)
    assert document["friction"]["mu"] is None
    json.dumps(document, allow_nan=False)


def test_impulses_outside_the_cone_and_gains_of_energy_are_counted(tmp_path):
    fields = impacts()
    fields["states_f"][:40, 3] += 3.0
    found = analyse_impacts(read_impacts(write(tmp_path / "impacts.mat", fields)))
    assert found.friction.beyond > 0.08
    assert found.rigid.gains > 10


def test_impacts_that_do_not_approach_are_left_out(tmp_path):
    fields = impacts()
    fields["states_i"][:30, 4] = 0.5
    found = analyse_impacts(read_impacts(write(tmp_path / "impacts.mat", fields)))
    assert (found.impacts, found.left_out) == (370, 30)
    assert "Left out: 30 impacts" in shown(found)


def test_few_impacts_are_refused():
    with pytest.raises(EstimationError, match=r"150 impacts .* 200 are needed: give the whole file"):
        analysed(number=150)


def test_the_command(tmp_path):
    path = write(tmp_path / "impacts.mat", impacts())
    done = CliRunner().invoke(main, ["reproduce", "planar-impacts", str(path)])
    assert done.exit_code == 0, done.output
    assert "400 impacts" in done.stdout
    done = CliRunner().invoke(main, ["reproduce", "planar-impacts", str(path), "--json"])
    document = json.loads(done.stdout)
    low, high = document["friction"]["mu"]["interval95"]
    assert low < MU < high
    assert document["restitution"]["interval95"][0] < document["restitution"]["percentiles"]["95"]


def bad(**changes):
    fields = impacts(number=8)
    for name, value in changes.items():
        if value is None:
            del fields[name]
        else:
            fields[name] = value
    return fields


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (bad(d=None), "'data' has no field 'd'"),
        (bad(n=np.zeros((8, 2))), r"'n' is \(8, 2\), not \(impacts, 3\)"),
        (bad(n=np.full((8, 3), "x")), "'n' does not hold real numbers|'n' is"),
        (bad(n=np.zeros((7, 3))), "differ in their number"),
        (bad(states_f=np.full((8, 6), np.nan)), "not finite"),
        (bad(n=np.tile([1.0, 0.0, 0.0], (8, 1))), "normal is not along y"),
        (bad(d=np.tile([1.0, 0.0, -0.03], (8, 1))), "above the middle"),
    ],
)
def test_bad_fields_end_with_one_line_and_a_remedy(tmp_path, fields, message):
    path = write(tmp_path / "impacts.mat", fields)
    with pytest.raises(RecordingError, match=message) as caught:
        read_impacts(path)
    assert "give data_ellipse.mat" in str(caught.value)


def test_other_files_end_with_one_line_and_a_remedy(tmp_path):
    whole = write(tmp_path / "impacts.mat", impacts(number=8)).read_bytes()
    contents = {
        "text.mat": b"not MATLAB's",
        "empty.mat": b"",
        "cut.mat": whole[: len(whole) // 2],
        "damaged.mat": whole[:200] + bytes(64) + whole[264:],
        "hdf.mat": b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + whole[128:],
        "large.mat": bytes(MAX_BYTES + 1),
    }
    for name, content in contents.items():
        path: Path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=name) as caught:
            read_impacts(path)
        assert "\n" not in str(caught.value)
        assert "give data_ellipse.mat" in str(caught.value)
    savemat(tmp_path / "other.mat", {"x": np.ones(3)})
    done = CliRunner().invoke(main, ["reproduce", "planar-impacts", str(tmp_path / "other.mat")])
    assert done.exit_code != 0
    assert "no struct 'data'" in done.output
    done = CliRunner().invoke(main, ["reproduce", "planar-impacts", str(tmp_path / "none.mat")])
    assert "not found: give data_ellipse.mat" in done.output
