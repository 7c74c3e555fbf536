"""Picture of the plumb lines that `analyze gravity` found, drawn over the image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from analyze.calibration.plumb import PlumbLine
from analyze.tracking.camera_model import distort
from analyze.types import CameraModel
from schemas.output_file import write_bytes

COLOUR = (0, 159, 230)
"""Colour of the strokes: blue, green, red (0 to 255)."""
STROKE_OFFSET_PX = 4
"""Distance of the two strokes from the string, which stays visible between them [px]."""


def write_plumb_picture(
    image: NDArray[np.uint8], lines: Sequence[PlumbLine], camera: CameraModel, output: Path
) -> None:
    """Write the image with the plumb lines found as a PNG; it appears complete or not at all.

    A stroke on either side marks each string, which stays visible between them.

    Args:
        image: (height, width) grey values.
        lines: plumb lines, in undistorted pixels.
        camera: camera whose distortion is applied to the lines.
        output: path of the PNG.

    Raises:
        OutputError: the file cannot be written.
    """
    picture = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_GRAY2BGR)
    for line in lines:
        fraction = np.linspace(0.0, 1.0, 40)[:, None]
        raw = distort(camera, line.bottom * (1 - fraction) + line.top * fraction)
        for side in (-STROKE_OFFSET_PX, STROKE_OFFSET_PX):
            stroke = np.round((raw + np.array([side, 0])) * 8).astype(np.int32)
            cv2.polylines(
                picture, [stroke], isClosed=False, color=COLOUR, thickness=1, lineType=cv2.LINE_AA, shift=3
            )
    write_bytes(output, cv2.imencode(".png", picture)[1].tobytes())
