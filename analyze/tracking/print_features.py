"""Features of an object's print (SIFT; Lowe 2004), and the pose by those that an image shows again."""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnnecessaryComparison=false

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.tracking.turns import rotation_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array

MAX_FEATURES, MIN_FEATURE_CONTRAST = 1500, 0.015
"""largest number of features of an image, and their least contrast: print in flight is blurred"""
DESCRIPTOR_LENGTH = 128
"""length of a descriptor"""
MIN_MATCHES, MAX_DISTANCE_RATIO = 6, 0.85
"""number of features that must agree on a pose, and largest ratio of a match's distance to the next best's"""
RANSAC_DRAWS = 200
"""largest number of draws of features for a pose"""
MAX_REPROJECTION_PX = 4.0
"""largest distance of a feature from where a pose predicts it [px]"""


def detect_features(
    image: NDArray[np.uint8], mask: NDArray[np.uint8] | None = None
) -> tuple[Array, NDArray[np.float32]]:
    """Places (f, 2) [px] and descriptors (f, 128) of the features of an image.

    Args:
        image: (h, w) grey image.
        mask: (h, w) nonzero where features are wanted; None for everywhere.
    """
    sift = cv2.SIFT.create(nfeatures=MAX_FEATURES, contrastThreshold=MIN_FEATURE_CONTRAST)
    found, descriptors = sift.detectAndCompute(image, mask)
    if descriptors is None or not found:
        return np.zeros((0, 2)), np.zeros((0, DESCRIPTOR_LENGTH), dtype=np.float32)
    return np.array([each.pt for each in found]), np.asarray(descriptors, dtype=np.float32)


def match_features(known: NDArray[np.float32], seen: NDArray[np.float32]) -> tuple[NDArray[np.int64], ...]:
    """Indices (k,) of known features and (k,) of those of an image that look alike, by their descriptors."""
    if len(known) < MIN_MATCHES or len(seen) < MIN_MATCHES:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    pairs = cv2.BFMatcher().knnMatch(known, seen, k=2)
    good = [first for first, second in pairs if first.distance < MAX_DISTANCE_RATIO * second.distance]
    one, other = [each.queryIdx for each in good], [each.trainIdx for each in good]
    return np.array(one, dtype=np.int64), np.array(other, dtype=np.int64)


def pose_by_matches(points: Array, pixels: Array, K: Array) -> tuple[Array, Array] | None:
    """Rotation (3, 3) and translation (3,) [m] to the camera frame on which most matches agree.

    None if too few agree.

    Args:
        points: (k, 3) places of the features in the object frame [m].
        pixels: (k, 2) ideal pixels.
        K: (3, 3) camera matrix [px].
    """
    if len(points) < MIN_MATCHES:
        return None
    done, turn, shift, kept = cv2.solvePnPRansac(
        points,
        pixels,
        K,
        None,
        iterationsCount=RANSAC_DRAWS,
        reprojectionError=MAX_REPROJECTION_PX,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not done or kept is None or len(kept) < MIN_MATCHES:
        return None
    place = np.asarray(shift, dtype=np.float64).ravel()
    return (
        (rotation_matrix(np.asarray(turn, dtype=np.float64)), place)
        if np.all(np.isfinite(place)) and place[2] > 0
        else None
    )
