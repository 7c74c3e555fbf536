"""Exceptions that analyze raises on purpose, as a tree.

    AnalyzeError
    ├── RecordingError          a file that cannot be read as a recording
    │   ├── RecordingCut        the file ends early; `acquire recover` can save the rest
    │   ├── RecordingForeign    the file is not in this project's recording format
    │   └── RecordingVersion    the file was written by another major schema version
    ├── ShapeError              a shape that is not a closed body, has no unit, or cannot be read
    ├── PlanError               no set of strikes determines the centre of mass, or the plan is of another
    object ├── TrackingError           the marker is unknown, seen twice, or not seen ├── MergeError
    recordings of different objects, or recordings that share a strike ├── EstimationError         too few
    good strikes
    ├── ArchiveError            an archive that cannot be listed, or a folder of results that cannot be used
    ├── CalibrationError        images that show no board, or views that do not determine the camera
    ├── ImportRefused           a video, image folder or other program's file that cannot become a recording
    ├── ExportError             a body that cannot be written for a simulator, or is not read back as it was
    written └── TagError                tags or boards that cannot be printed as asked

`schemas.output_file.OutputError` (a file that cannot be written) is shared by both packages.
Each message is one line: the file or thing, the fault, the remedy.
"""


class AnalyzeError(Exception):
    """Base of all errors of this package; the CLI prints it as one line and exits with 1."""


class RecordingError(AnalyzeError):
    """A file that cannot be read as a recording."""


class RecordingCut(RecordingError):
    """A recording that ends early; `acquire recover` can save what it holds."""


class RecordingForeign(RecordingError):
    """A file that is not in this project's recording format."""


class RecordingVersion(RecordingError):
    """A recording that was written by another major schema version."""


class ShapeError(AnalyzeError):
    """A shape that is not a closed body, has no unit, or cannot be read."""


class PlanError(AnalyzeError):
    """No set of strikes determines the centre of mass, or the plan is of another object."""


class TrackingError(AnalyzeError):
    """A marker that is unknown, seen twice in one image, or not seen."""


class MergeError(AnalyzeError):
    """Recordings that cannot be merged: of different objects, or with a strike in common."""


class EstimationError(AnalyzeError):
    """Data that do not determine the requested quantity."""


class ExportError(AnalyzeError):
    """A body that cannot be written for a simulator, or is not read back as it was written."""


class ImportRefused(AnalyzeError):
    """A video, image folder or other program's file that cannot become a recording."""


class CalibrationError(AnalyzeError):
    """Images that show no board, or views that do not determine the camera."""


class ArchiveError(AnalyzeError):
    """An archive that cannot be listed, or a folder of results that cannot be used."""


class TagError(AnalyzeError):
    """Tags or boards that cannot be printed as asked."""
