"""Surfaces of a mesh's convex parts, and of the hulls over several of them, prepared for drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.virtual.part_hulls import hull_over

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from acquire.virtual.convex_parts import ConvexParts


class PartGroups:
    """Surfaces of a mesh's convex parts, and of the hulls over the parts on both sides of a dividing plane.

    Surface i is that of part i, for i below the number of parts n; surface n + j is the hull over all parts
    that plane j of the tree divides.

    Args:
        parts: the convex parts and the tree of planes that separates them.
    """

    def __init__(self, parts: ConvexParts) -> None:
        self._parts = parts
        self.count = len(parts.corners)
        """number n of parts"""
        self.members = (
            *((i,) for i in range(self.count)),
            *(tuple(parts.below(j)) for j in range(len(parts.tree))),
        )
        """numbers of the parts of each surface"""
        self._hulls = [hull_over(parts.corners, members) for members in self.members]
        self.groups = tuple(hull.group for hull in self._hulls)
        """faces of each surface"""

    def front_to_back(self, camera_object: NDArray[np.float64]) -> list[int]:
        """Numbers of as few surfaces as show the whole object, none of which hides one before it.

        Args:
            camera_object: (3,) position of the camera in O, the object's frame [m].
        """
        return self._parts.front_to_back(
            camera_object, lambda plane: self._hulls[self.count + plane].is_like_parts(camera_object)
        )
