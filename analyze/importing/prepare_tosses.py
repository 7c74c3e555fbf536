"""Prepares an import of videos of tosses alone."""

from __future__ import annotations

from contextlib import ExitStack

from analyze.cameras.camera_file import camera_of, read_camera
from analyze.errors import ImportRefused
from analyze.importing.inputs import open_tosses, read_plan, refuse_full, refuse_other_camera
from analyze.importing.mat_cameras import mat_cameras_of
from analyze.importing.options import ImportOptions
from analyze.importing.prepared_import import Assignment, PreparedImport, storable_videos
from analyze.reading.object_file import read_object_files
from schemas.document import read_text


def prepare_tosses(options: ImportOptions) -> PreparedImport:
    """Check the sources of tosses, of which there is at least one; they are taken whole.

    Args:
        options: files; the plan and the camera's pose are needed, as no strike shows either.

    Raises:
        ImportRefused: a source cannot be read or is of another camera, there is no plan, or the camera file
            states no pose and no mat is seen.
        OutputError: the disk has no room for the videos that will be stored.
        ShapeError, DocumentError, CalibrationError: a file cannot be used.
    """
    if options.plan_path is None:
        raise ImportRefused(
            "tosses without strikes need the plan that was tossed: make one (`analyze plan OBJECT --strikes 0"
            " --tosses 3 -o plan.json`) and give it (--plan)"
        )
    files = read_object_files(options.object_path)
    struck = read_plan(options.plan_path, files)
    tosses = open_tosses(options)
    camera = camera_of(tosses) if options.camera_path is None else read_camera(options.camera_path)
    for source in tosses:
        refuse_other_camera(source, camera)
    mat = mat_cameras_of(tosses, camera, options.mat_ruler_mm)
    if mat is not None:
        camera = mat.placed(camera)
    if not camera.placed:
        raise ImportRefused(
            f"{camera.path}: states no pose of the camera (T_world_camera), and without strikes nothing shows"
            " where down is: lay a mat before the camera (`analyze print-tags --mat`), or calibrate with the"
            " board on the table (`analyze calibrate ... --table`)"
        )
    refuse_full(options.aside, storable_videos(tosses) or ())
    return PreparedImport(
        options,
        files,
        read_text(options.object_path),
        struck.plan,
        struck.text,
        camera,
        (),
        tosses,
        (),
        (),
        False,
        Assignment.ORDER,
        () if mat is None else mat.remarks,
        tosses[0].rate_hz,
        camera.calibration,
        None,
        tosses,
        None,
        mat,
        ExitStack(),
    )
