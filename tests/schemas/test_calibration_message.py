"""Camera calibration message for viewers."""

import numpy as np
import pytest

from schemas.calibration_message import calibration_message
from schemas.session_manifest import CameraCalibrationSpec, LensModel


@pytest.mark.parametrize(
    ("model", "distortion", "name"),
    [
        (LensModel.PINHOLE, [-0.1, 0.05, 0.0, 0.0, 0.01], "plumb_bob"),
        (LensModel.FISHEYE, [0.05, -0.02, 0.003, -0.001], "kannala_brandt"),
    ],
)
def test_the_lens_model_has_foxgloves_name(model, distortion, name):
    K = [[700.0, 0, 320], [0, 700.0, 240], [0, 0, 1]]
    spec = CameraCalibrationSpec(
        model=model, width=640, height=480, K=K, distortion=distortion, T_world_camera=np.eye(4).tolist()
    )
    message = calibration_message(spec, "camera")
    assert message.distortion_model == name
    assert list(message.D) == distortion
