"""Image layer of the striker's arm: bar, tip, hub, and the servo behind it, flat in the swing's plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.layers import Layer, Outline, compose, filled_layer
from acquire.virtual.station import ARM_LENGTH_M, TIP_RADIUS_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.lens import Lens

_STRIPES = ((-0.0045, -0.0015, 70.0), (-0.0015, 0.001, 105.0), (0.001, 0.0045, 55.0))
"""stripes of the bar: from, to [m across the bar], grey level"""
_PIECES = 6
"""pieces along each long side of the bar, so that lens distortion bends it"""
_ROUND = 28
"""corners of the polygon that stands for a disc"""


def _disc(x: float, z: float, radius: float) -> NDArray[np.float64]:
    angle = np.arange(_ROUND) * (2 * np.pi / _ROUND)
    return np.stack([x + radius * np.sin(angle), z + radius * np.cos(angle)], axis=1)


def _strip(left: float, right: float, top: float, bottom: float) -> NDArray[np.float64]:
    z = np.linspace(top, bottom, _PIECES + 1)
    return np.concatenate(
        [np.stack([np.full_like(z, right), z], 1), np.stack([np.full_like(z, left), z[::-1]], 1)]
    )


_SHAPES = (
    ((_disc(0.0, -ARM_LENGTH_M, TIP_RADIUS_M), 48.0),),
    ((_disc(0.0, 0.0, 0.011), 120.0),),
    tuple((_strip(left, right, 0.0, -ARM_LENGTH_M), grey) for left, right, grey in _STRIPES),
)
"""shapes from front to back, each of clockwise polygons (as the camera sees them) with their grey levels;
corners (x, z) [m] from the hinge, arm hanging"""
_SERVO = (_strip(-0.0145, 0.0145, 0.0345, -0.0125), 42.0)


class ArmPainter:
    """Painter of an image layer of the striker's arm.

    Not modelled: its depth along the hinge, its shadow, the stand.

    Args:
        lens: projection to pixels.
        width: image width [px].
        height: image height [px].
    """

    def __init__(self, lens: Lens, width: int, height: int) -> None:
        self._lens, self._width, self._height = lens, width, height

    def layer(self, angle: NDArray[np.float64], axis_world: NDArray[np.float64]) -> Layer | None:
        """Image layer of arm and servo, averaged over k poses of one exposure; None if both are out of view.

        A layer has, for each pixel of a box of the image, the fraction that is covered, and this fraction
        times the grey level. The servo does not turn with the arm.

        Args:
            angle: (k,) angles of the arm [rad], 0 when it hangs, positive towards +x.
            axis_world: (k, 3) points on the hinge in W, the world frame [m].
        """
        found = [self._shape(shape, angle, axis_world) for shape in _SHAPES]
        found.append(self._shape((_SERVO,), np.zeros_like(angle), axis_world))
        layers = [item for item in found if item is not None]
        return compose(layers) if layers else None

    def _shape(
        self,
        loops: tuple[tuple[NDArray[np.float64], float], ...],
        angle: NDArray[np.float64],
        axis_world: NDArray[np.float64],
    ) -> Layer | None:
        start = np.concatenate([corners for corners, _ in loops])
        end = np.concatenate([np.roll(corners, -1, axis=0) for corners, _ in loops])
        value = np.concatenate([np.full(len(corners), grey) for corners, grey in loops])
        start, end = (self._pixels(xz, angle, axis_world) for xz in (start, end))
        return filled_layer(Outline(start, end, value, np.ones(len(value))), self._width, self._height)

    def _pixels(
        self, xz: NDArray[np.float64], angle: NDArray[np.float64], axis_world: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        x, z = xz[:, 0], xz[:, 1]
        # An angle a takes the hanging tip (0, -L) to (L sin a, -L cos a).
        turned = np.stack([c * x - s * z, np.zeros((len(angle), len(x))), s * x + c * z], axis=-1)
        return self._lens.pixels(turned + axis_world[:, None, :])
