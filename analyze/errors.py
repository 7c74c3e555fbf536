"""Everything that analyze raises on purpose.

    AnalyzeError
    ├── RecordingError          a file that cannot be read as a recording
    │   ├── RecordingCut        it ends early; `acquire recover` can save the rest
    │   ├── RecordingForeign    it is no recording of ours
    │   └── RecordingVersion    written by another major schema version
    ├── ShapeError              a shape that is no closed body, has no unit, or cannot be read
    ├── PlanError               no set of strikes determines the centre of mass, or the plan is of another object
    ├── TrackingError           the marker is unknown, seen twice, or not seen
    ├── JoinError               recordings that are not of one object, or would count a strike twice
    ├── EstimationError         too few good strikes
    ├── ArchiveError            an archive that cannot be listed, or a folder of results that cannot be used
    ├── CalibrationError        images that show no board, or views that do not determine the camera
    ├── ImportRefused           a video, folder of images or file of others that cannot become a recording
    └── ExportError             a body that cannot be written for a simulator, or is not read back as it was written

`schemas.output_file.OutputError` (a file that cannot be written) is shared by both packages.
Each message is one line: the file or thing, what is wrong, what to try.
"""


class AnalyzeError(Exception):
    """Base of all errors of this package; the CLI prints it as one line and exits with 1."""


class RecordingError(AnalyzeError):
    """A file that cannot be read as a recording."""


class RecordingCut(RecordingError):
    """The recording ends early."""


class RecordingForeign(RecordingError):
    """The file is no recording of ours."""


class RecordingVersion(RecordingError):
    """The recording was written by another major schema version."""


class ShapeError(AnalyzeError):
    """A shape that cannot be used."""


class PlanError(AnalyzeError):
    """No plan can be made, or the plan does not fit."""


class TrackingError(AnalyzeError):
    """The marker cannot be followed."""


class JoinError(AnalyzeError):
    """Recordings that cannot be evidence of one object."""


class EstimationError(AnalyzeError):
    """The data do not determine an answer."""


class ExportError(AnalyzeError):
    """A body cannot be written for a simulator as asked, or is not read back as it was written."""


class ImportRefused(AnalyzeError):
    """What another camera recorded cannot become a recording as asked."""


class CalibrationError(AnalyzeError):
    """The camera cannot be calibrated with these images."""


class ArchiveError(AnalyzeError):
    """An archive or its results cannot be used."""


class TagError(AnalyzeError):
    """Tags that cannot be printed as asked."""
