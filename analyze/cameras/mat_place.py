"""Measures the camera's pose in the world frame from one image of the mat on the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from analyze.calibration.lens import Lens
from analyze.calibration.mat_pose import MatPose, mat_pose, pose_difference, read_mat
from analyze.calibration.mat_view import MatView
from analyze.calibration.place import CameraPlace
from analyze.cameras.board_images import read_image
from analyze.cameras.rig_file import read_rig
from analyze.errors import CalibrationError
from analyze.tracking.camera_model import camera_from_spec, distort, undistort
from analyze.types import Array, CameraModel


def place_by_mat(
    path: Path, lens: Lens, lens_covariance: Array, ruler_mm: float | None = None
) -> CameraPlace:
    """Camera's pose in the world frame W by an image of the mat; errors of the lens are in its deviations.

    Args:
        path: the image.
        lens: lens of the camera, with p numbers.
        lens_covariance: (p, p) covariance of the lens's numbers.
        ruler_mm: length of the mat's ruler as measured on the print [mm]; None for the nominal one.

    Raises:
        CalibrationError: the image cannot be read, has another size than the lens, or shows too little of a
            mat.
        ImportRefused: it is a video that cannot be read.
    """
    camera = lens.camera()
    view, pose = _read(path, camera, ruler_mm)
    covariance = pose.covariance.copy()
    variances, directions = np.linalg.eigh(lens_covariance)
    raw = distort(camera, view.corners)
    for variance, direction in zip(variances, directions.T, strict=True):
        other = lens.moved(np.sqrt(max(float(variance), 0.0)) * direction).camera()
        moved = mat_pose(replace(view, corners=undistort(other, raw)), other, ruler_mm)
        change = pose_difference(pose.T_world_camera, moved.T_world_camera)
        covariance += np.outer(change, change)
    return _place(replace(pose, covariance=covariance))


def place_of_rig_by_mat(path: Path, rig: Path, ruler_mm: float | None = None) -> CameraPlace:
    """Camera's pose in the world frame W by an image of the mat, with the lens of a rig file.

    Errors of the lens are not in the standard deviations.

    Args:
        path: the image.
        rig: the rig file, or a camera file.
        ruler_mm: length of the mat's ruler as measured on the print [mm]; None for the nominal one.

    Raises:
        CalibrationError: a file cannot be read, the image has another size than the lens, or shows too little
            of a mat.
        DocumentError: an entry of the rig file has a value that is not allowed.
        ImportRefused: the image is a video that cannot be read.
    """
    camera = camera_from_spec(read_rig(rig)[0].camera.calibration)
    return _place(_read(path, camera, ruler_mm)[1])


def _read(path: Path, camera: CameraModel, ruler_mm: float | None) -> tuple[MatView, MatPose]:
    """The mat's tags in an image, and the camera's pose by them.

    Raises:
        CalibrationError: the image has another size than the lens, or shows too little of a mat.
    """
    image = read_image(path)
    if image.shape != (camera.height, camera.width):
        raise CalibrationError(
            f"{path} has {image.shape[1]} x {image.shape[0]} px, the lens is of {camera.width} x "
            f"{camera.height}: take it with the same camera and region"
        )
    view = read_mat(image, camera)
    if view is None:
        raise CalibrationError(
            f"{path}: no mat is seen: print one (`analyze print-tags --mat`), lay it printed side up before "
            "the camera, and light it evenly"
        )
    try:
        pose = mat_pose(view, camera, ruler_mm)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None
    return pose.view, pose


def _place(pose: MatPose) -> CameraPlace:
    """Pose by a mat as that by a board."""
    corners = 4 * len(pose.view.tags)
    return CameraPlace(pose.T_world_camera, pose.turn_sd, pose.position_sd, corners, pose.rms_px)
