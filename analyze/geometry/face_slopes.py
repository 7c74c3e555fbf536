"""Turns of a scanned body at rest by the errors of its resting face's slopes.

The planned pose rests on a face of the scan, the object on its own. Where the two differ in slope, the object
lies turned, and balance angles are measured from there.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import area_vectors
from analyze.types import Array

SAME_PLANE_COSINE = float(np.cos(np.radians(0.1)))
"""Cosine of the angle up to which a resting face and a fitted plane are the same."""
LIKE_FACET_COSINE = float(np.cos(np.radians(10.0)))
"""Cosine of the angle up to which facets of a scan's hull may be parts of one face of the object."""


def turn_covariance(model: ObjectModel, up: Array) -> Array:
    """Covariance (3, 3) [rad^2] of an object's turn at rest about the axes of the object frame O.

    A face with a fitted plane has the covariance of the plane's slopes. A facet of a scanned hull to which no
    plane was fitted may be any of those that point nearly as it does: the covariance is that of their
    normals, weighted with their areas. It is 0 for a shape that is no scan.

    Args:
        model: exterior of the object.
        up: (3,) unit normal of the resting face, into the object, in O.
    """
    if model.cloud is None:
        return np.zeros((3, 3))
    for plane in model.cloud.planes:
        if -float(plane.normal @ up) > SAME_PLANE_COSINE:
            tilt = plane.basis.T @ plane.covariance[1:, 1:] @ plane.basis
            break
    else:
        hull = ConvexHull(model.hull_vertices)
        normals = np.asarray(hull.equations[:, :3], dtype=np.float64)
        area = np.linalg.norm(area_vectors(np.asarray(hull.points)[hull.simplices]), axis=1)
        weight = area * (-(normals @ up) > LIKE_FACET_COSINE)
        apart = normals + up
        tilt = (apart * weight[:, None]).T @ apart / max(float(weight.sum()), 1e-12)
    # Turned by w, a face's normal n becomes n + w x n.
    across = np.cross(np.eye(3), up)
    return np.asarray(across @ tilt @ across.T, dtype=np.float64)
