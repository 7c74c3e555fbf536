"""The answer in numbers: digits by intervals, one unit, measured and prior entries, a URDF block."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest

from analyze.result.digits import ScaledUnit, decimals, inertia_unit, open_interval, value_text
from analyze.result.headline import edge_labels, further_warnings, headline
from analyze.result.urdf_inertial import inertial_block
from schemas.quantity import Quantity
from schemas.result import Result, ResultWarning, WarningCode
from schemas.result_inputs import ResultInputs

INERTIA = np.diag([1.109e-4, 1.231e-4, 4.86e-5])
MEASURED = np.eye(3, dtype=bool)


def result(inertia=INERTIA, measured=MEASURED, **changes) -> Result:
    """Result of a carton whose diagonal moments are known to 1 %, the products to 4e-5 kg m²."""
    sd = np.where(measured, 0.01 * np.abs(inertia) + 1e-9, 2e-5)
    half = 1.96 * sd
    covariance = np.zeros((10, 10))
    covariance[4:, 4:] = np.diag([sd[i, j] ** 2 for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    entries = {
        "inputs": ResultInputs(
            recording_id="r",
            content_id="c",
            object_sha256="o",
            plan_sha256="p",
            configuration_sha256="n",
            software="s",
        ),
        "warnings": [],
        "strikes": [],
        "mass": Quantity(value=0.044, unit="kg", sd=1e-4),
        "centre_of_mass": Quantity(
            value=[9.778e-4, -3.836e-4, 8.8548e-3],
            unit="m",
            interval95=[[8.83e-4, 1.073e-3], [-4.65e-4, -3.02e-4], [8.664e-3, 9.045e-3]],
        ),
        "moments": [],
        "inertia": Quantity(
            value=inertia.tolist(),
            unit="kg m^2",
            sd=sd.ravel().tolist(),
            interval95=np.stack([inertia - half, inertia + half], axis=-1).reshape(9, 2).tolist(),
        ),
        "inertia_measured": np.asarray(measured).tolist(),
        "regions": None,
        "parameters_covariance": covariance.tolist(),
    }
    return Result(**(entries | changes))


def test_centre_and_tensor_have_the_digits_of_their_intervals():
    shown = headline(result())
    assert shown.mass == "44.00 ± 0.20 g"
    assert [entry.text for entry in shown.com] == ["0.978 ± 0.095", "−0.384 ± 0.081", "8.85 ± 0.19"]
    assert shown.unit.label == "10⁻⁴\u00a0kg\u00a0m²"
    assert [entry.marked for entry in shown.tensor[0]] == ["1.109 ± 0.022", "[0.00 ± 0.39]", "[0.00 ± 0.39]"]
    assert shown.tensor_note


def test_principal_moment_is_measured_only_with_all_entries_of_its_axes():
    assert [each.moment.measured for each in headline(result()).principal] == [False] * 3
    all_measured = headline(result(measured=np.ones((3, 3), dtype=bool)))
    assert [each.moment.measured for each in all_measured.principal] == [True] * 3
    assert all_measured.tensor_note == ""
    in_the_plane = MEASURED.copy()
    in_the_plane[0, 1] = in_the_plane[1, 0] = in_the_plane[2, :] = in_the_plane[:, 2] = True
    in_the_plane[2, 2] = False
    shown = headline(result(measured=in_the_plane))
    assert [each.moment.measured for each in shown.principal] == [False, True, True]
    assert shown.principal[0].direction == "(0.00, 0.00, 1.00)"


def test_principal_axes_of_a_turned_tensor_are_its_own():
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    turned = turn @ INERTIA @ turn.T
    shown = headline(result(inertia=(turned + turned.T) / 2, measured=np.ones((3, 3), dtype=bool)))
    assert [each.direction for each in shown.principal] == [
        "(0.00, 0.00, 1.00)",
        "(0.88, 0.48, 0.00)",
        "(−0.48, 0.88, 0.00)",
    ]
    assert [each.moment.text[:5] for each in shown.principal] == ["0.486", "1.109", "1.231"]


def test_urdf_block_is_narrow_xml_with_the_results_numbers():
    block = inertial_block(result())
    assert max(map(len, block.splitlines())) <= 50
    element = ET.fromstring(block)
    com = [float(each) for each in element.find("origin").get("xyz").split()]
    assert np.allclose(com, result().centre_of_mass.value, rtol=1e-5)
    assert float(element.find("inertia").get("izz")) == pytest.approx(4.86e-5)
    assert "from the shape: ixy, ixz, iyz" in block


def test_impossible_tensor_has_no_urdf_block():
    assert inertial_block(result(inertia=np.diag([1e-4, 1e-4, 3e-4]))) is None


def test_rounding_keeps_a_thin_plate_possible():
    plate = np.diag([1.0000004e-4, 1.0000004e-4, 2.0000008e-4])
    assert inertial_block(result(inertia=plate)) is not None


@pytest.mark.parametrize(
    ("value", "ends", "expected"),
    [
        (8.8548, (8.664, 9.045), "8.85 ± 0.19"),
        (-0.3836, (-0.4647, -0.3025), "−0.384 ± 0.081"),
        (12.0, (9.6, 12.9), "12.0 (9.6 to 12.9)"),
        (1234.0, (1100.0, 1368.0), "1234 ± 134"),
        (0.0, (-0.0996, 0.0996), "0.00 ± 0.10"),
        (3.14159, None, "3.14"),
        (3.14159, (3.14159, 3.14159), "3.14159"),
    ],
)
def test_values_have_two_digits_of_their_interval(value, ends, expected):
    assert value_text(value, ends) == expected


def test_open_intervals_show_both_ends_and_what_is_not_observed():
    mass = Quantity(value=0.0254, unit="kg", interval95=[0.0228, 0.0339])
    assert open_interval(mass, 1e3) == "25.4 (22.8 to 33.9)"
    assert open_interval(mass.model_copy(update={"observed": False}), 1e3) == "not observed (22.8 to 33.9)"


def test_units_and_decimals():
    assert inertia_unit([3e-7, 9.99e-5]).label == "10⁻⁵\u00a0kg\u00a0m²"
    assert inertia_unit([0.0]).label == "kg\u00a0m²"
    assert ScaledUnit(-4, "kg m²").factor * 1.5e-4 == pytest.approx(1.5)
    assert [decimals(half) for half in (0.19, 0.0996, 12.0, 0.0, float("inf"))] == [2, 2, 0, 0, 0]


def test_what_the_verdict_states_is_not_warned_of_again():
    warnings = [
        ResultWarning(code=WarningCode.INERTIA_FROM_PRIOR, text="from the shape, not from strikes: Ixy"),
        ResultWarning(code=WarningCode.POOR_FIT, text="strike s1 rocked back"),
        ResultWarning(code=WarningCode.FRAMES_LOST, text="3 frames lost"),
    ]
    stated = ["not determined: Ixy of the tensor: it comes from the shape", "repeat strike s1 rocked back"]
    left = further_warnings(result(warnings=warnings, verdict=stated))
    assert [each.text for each in left] == ["3 frames lost"]
    assert further_warnings(result(warnings=warnings)) == warnings


def test_edges_without_names_keep_their_ids():
    assert edge_labels(result()) == {}
