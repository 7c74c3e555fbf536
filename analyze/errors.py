"""Exceptions that the package analyze raises on purpose, as a tree.

::

    AnalyzeError
    ├── RecordingError          a file cannot be read as a recording
    │   ├── RecordingCut        the file ends early; `acquire recover` can save the rest
    │   ├── RecordingForeign    the file is not in this project's recording format
    │   └── RecordingVersion    the file was written by another major schema version
    ├── ShapeError              a shape or object file cannot be used
    ├── PlanError               strikes cannot be planned, or a plan cannot be used
    ├── TrackingError           a marker cannot be tracked
    ├── MergeError              recordings cannot be merged
    ├── EstimationError         data do not determine the requested quantity
    ├── ExportError             a body cannot be written for a simulator
    ├── ImportRefused           a video, image folder or foreign file cannot become a recording
    ├── CalibrationError        images do not determine the camera
    ├── FixtureError            no fixture can be designed for an object
    ├── ArchiveError            an archive or a folder of results cannot be used
    └── TagError                tags or boards cannot be printed as asked

`schemas.output_file.OutputError` (a file that cannot be written) is shared by both packages.
Each message is one line: the file or thing, the fault, the remedy.
"""


class AnalyzeError(Exception):
    """Base of the errors that this package raises on purpose; commands print one line and exit with 1."""


class RecordingError(AnalyzeError):
    """A file cannot be read as a recording: missing, damaged, foreign, or without a part that is needed."""


class RecordingCut(RecordingError):
    """A recording ends early; `acquire recover` can save what it holds, unless the file is empty."""


class RecordingForeign(RecordingError):
    """A file is not in this project's recording format (MCAP with a Percuss manifest)."""


class RecordingVersion(RecordingError):
    """A recording was written by another major schema version than this program reads."""


class ShapeError(AnalyzeError):
    """An object file or its shape cannot be used: not readable, not closed, or of an implausible size."""


class PlanError(AnalyzeError):
    """Strikes cannot be planned, or a strike plan cannot be used.

    No set of strikes determines the centre of mass, a rig file or earlier result cannot be used, or the plan
    is of another object.
    """


class TrackingError(AnalyzeError):
    """A marker cannot be tracked: unknown, seen twice in one image, not seen, or in unusable images."""


class MergeError(AnalyzeError):
    """Recordings cannot be merged: they are of different objects, or share a strike."""


class EstimationError(AnalyzeError):
    """Data do not determine the requested quantity, or a strike to exclude is unknown."""


class ExportError(AnalyzeError):
    """A body cannot be written for a simulator, or the file is not read back as it was written."""


class ImportRefused(AnalyzeError):
    """A video, image folder or other program's file cannot be converted to a recording."""


class CalibrationError(AnalyzeError):
    """A camera cannot be calibrated: images show no board, or the views do not determine the camera."""


class FixtureError(AnalyzeError):
    """No fixture can be designed for an object, or not with the options given."""


class CompactError(AnalyzeError):
    """A recording cannot be compacted; it stays as it is."""


class ArchiveError(AnalyzeError):
    """An archive cannot be listed or analysed, or its results cannot be written, read or queried.

    An archive is the many recordings that one run of `analyze batch` analyses.
    """


class TagError(AnalyzeError):
    """Tags or calibration boards cannot be printed as requested."""
