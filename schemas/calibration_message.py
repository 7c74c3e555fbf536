"""Message with a camera's intrinsics, as recordings hold it for viewers that draw over images."""

from __future__ import annotations

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from schemas.session_manifest import CameraCalibrationSpec, LensModel


def calibration_message(spec: CameraCalibrationSpec, frame_id: str) -> CameraCalibration:
    """Intrinsics of a camera as a foxglove.CameraCalibration message, for viewers that draw over images.

    In the message, K is the camera matrix [px] (row by row), D the distortion coefficients, P (projection) is
    K with a column of zeros, and R (rectification) is the identity.

    Args:
        spec: lens of the camera; its pose is not used.
        frame_id: name of the camera's frame, as the images state it.
    """
    message = CameraCalibration(frame_id=frame_id, width=spec.width, height=spec.height)
    message.distortion_model = "kannala_brandt" if spec.model is LensModel.FISHEYE else "plumb_bob"
    message.D.extend(spec.distortion)
    message.K.extend(value for row in spec.K for value in row)
    message.P.extend(value for row in spec.K for value in (*row, 0.0))
    message.R.extend([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    return message
