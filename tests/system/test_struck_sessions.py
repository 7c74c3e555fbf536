"""Sessions with makes of cameras and models of servos other than the usual ones, against the truth.

`make bench-devices` runs all of them.
"""

from __future__ import annotations

import pytest

from acquire.virtual.camera_makes import MAKES
from acquire.virtual.device_kinds import DeviceKinds
from tests.system.struck_session import struck_session

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.mark.parametrize(
    "kinds",
    [
        DeviceKinds(make="blackfly-s"),  # stamps the end of the exposure
        DeviceKinds(make="basler-ace"),  # other names, gain in steps, a slower clock
        DeviceKinds(servo="XL330-M288"),  # another supply, another unit of current
    ],
    ids=["blackfly-s", "basler-ace", "XL330-M288"],
)
def test_the_balance_angle_is_that_of_the_truth(kinds: DeviceKinds) -> None:
    found = struck_session(kinds)
    assert found.lost == found.pace.unsent == 0 or found.pace.camera_s > 0.5, found
    assert found.phi_errors_rad, found
    for error, sd, delay in zip(found.phi_errors_rad, found.phi_sds_rad, found.delays_ms, strict=True):
        assert abs(error) < 3 * sd < 0.02
        assert abs(delay) < 0.3  # a stamp taken for the exposure's other end shifts frames by 1.5 ms
    if kinds.make is not None:
        assert found.model == MAKES[kinds.make].model
