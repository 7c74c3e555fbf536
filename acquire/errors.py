"""Errors that the package `acquire` raises on purpose.

    AcquireError
    ├── ConfigError          a rig file, or a setting, that cannot be used
    ├── CameraError          Aravis or the camera did not do what was asked
    │   ├── CameraNotFound   no camera answers at the address
    │   ├── CameraLost       the camera answered before and does not answer now
    │   └── CameraSettingError   a setting reads back differently from what was written
    ├── StrikerError         the striker did not do what was asked
    │   ├── StrikerNotFound  no port, or no known servo on it
    │   ├── StrikerLost      the servo bus no longer answers
    │   ├── StrikerFault     the servo reports a hardware error, or the arm does not come to rest
    │   └── StrikerRefused   an interlock or a person refused the motion
    │       └── StrikerStopped   the striker was stopped on request
    ├── RecorderError        a recording cannot be written or read, or its path exists already
    │   ├── CaptureGone      the capture process died or was ended
    │   └── RecordingBroken  the data asked for is in a file that was cut short
    ├── DaemonError          the daemon cannot be reached, started or understood
    │   ├── DaemonNotRunning no process listens on the socket
    │   ├── DaemonSilent     the daemon runs and does not answer
    │   └── DaemonBusy       another daemon or session holds what was asked for
    └── SessionError         the session cannot begin or go on

Each message is one line: the device or file, what was asked, what came back, what to try.
"""


class AcquireError(Exception):
    """Base of all errors of the package `acquire`; the CLI prints it as one line and exits with 1."""


class ConfigError(AcquireError):
    """A rig file, or a setting given on the command line, that cannot be used."""


class CameraError(AcquireError):
    """Camera problem: Aravis or the camera did not do what was asked; base of the other camera errors."""


class CameraNotFound(CameraError):
    """No camera answers, at the address given or in a search of the network."""


class CameraLost(CameraError):
    """A camera that answered before does not answer now."""


class CameraSettingError(CameraError):
    """A setting of the camera is refused, or reads back differently from what was written."""


class StrikerError(AcquireError):
    """Striker problem: the striker did not do what was asked; base of the other striker errors."""


class StrikerNotFound(StrikerError):
    """No such port, no servo that answers on it, or a servo of an unknown model."""


class StrikerLost(StrikerError):
    """The servo no longer answers on its bus, or its port failed or is closed."""


class StrikerFault(StrikerError):
    """The servo reports a hardware error, or the arm does not come to rest where it should."""


class StrikerRefused(StrikerError):
    """A motion or order of the striker was refused: by an interlock, or because a person answered no."""


class StrikerStopped(StrikerRefused):
    """The striker was stopped on request; nothing moves until a person homes it or starts a session.

    Args:
        text: message; the default advises to home the striker.
    """

    def __init__(self, text: str = "the striker was stopped on request: home it to go on") -> None:
        super().__init__(text)


class RecorderError(AcquireError):
    """The recording cannot be written or read; base of the other errors of recorder and capture process."""


class CaptureGone(RecorderError):
    """The capture process died, or hung and was ended; the daemon starts it again."""


class RecordingBroken(RecorderError):
    """The data asked for is in a file that was cut short; the recording continues in the next file."""


class DaemonError(AcquireError):
    """The daemon cannot be reached, started or understood; base of the other daemon errors."""


class DaemonNotRunning(DaemonError):
    """No process listens on the socket."""


class DaemonSilent(DaemonError):
    """The daemon runs and takes no connections or does not answer."""


class DaemonBusy(DaemonError):
    """Another daemon or session holds what was asked for, or the daemon did not start in time."""


class SessionError(AcquireError):
    """The session cannot begin or go on."""


def by_name(name: str, otherwise: type[AcquireError] = AcquireError) -> type[AcquireError]:
    """Error class of this module with the given name; `otherwise` if there is no such class.

    Processes send each other errors as the class's name and the message.
    """
    found = globals().get(name)
    return found if isinstance(found, type) and issubclass(found, AcquireError) else otherwise


def drop_traceback(error: BaseException) -> None:
    """Remove the traceback of an exception: its functions' local variables would keep a device open."""
    error.__traceback__ = error.__context__ = None
