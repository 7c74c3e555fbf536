"""Errors that the package `acquire` raises on purpose.

    AcquireError
    ├── ConfigError          a rig file that cannot be used
    ├── CameraError
    │   ├── CameraNotFound   no camera answers at the address
    │   ├── CameraLost       the camera answered before and does not answer now
    │   └── CameraSettingError   a setting reads back differently from what was written
    ├── StrikerError
    │   ├── StrikerNotFound  no port, or no servo on it
    │   ├── StrikerLost      the servo bus no longer answers
    │   ├── StrikerFault     the servo reports a hardware error
    │   └── StrikerRefused   an interlock refused the motion
    │       └── StrikerStopped   the striker was stopped on request
    ├── RecorderError        the file cannot be written, or its path exists already
    │   ├── CaptureGone      the capture process died or was ended
    │   └── RecordingBroken  the data asked for is in a file that was cut short
    ├── DaemonError
    │   ├── DaemonNotRunning no process listens on the socket
    │   ├── DaemonSilent     the daemon runs and does not answer
    │   └── DaemonBusy       another daemon or session holds what was asked for
    └── SessionError         the session cannot go on

Each message is one line: the device or file, what was asked, what came back, what to try.
"""


class AcquireError(Exception):
    """Base of all errors of this package; the CLI prints it as one line and exits with 1."""


class ConfigError(AcquireError):
    """A rig file that cannot be used."""


class CameraError(AcquireError):
    """The camera did not do what was asked."""


class CameraNotFound(CameraError):
    """No camera answers at the address."""


class CameraLost(CameraError):
    """The camera answered before and does not answer now."""


class CameraSettingError(CameraError):
    """A setting reads back differently from what was written."""


class StrikerError(AcquireError):
    """The striker did not do what was asked."""


class StrikerNotFound(StrikerError):
    """No such port, or no servo answers on it."""


class StrikerLost(StrikerError):
    """The servo bus no longer answers."""


class StrikerFault(StrikerError):
    """The servo reports a hardware error."""


class StrikerRefused(StrikerError):
    """An interlock refused the motion."""


class StrikerStopped(StrikerRefused):
    """The striker was stopped on request; nothing moves until a person starts it again."""

    def __init__(self, text: str = "the striker was stopped on request: home it to go on") -> None:
        super().__init__(text)


class RecorderError(AcquireError):
    """The recording cannot be written."""


class CaptureGone(RecorderError):
    """The capture process died, or hung and was ended; the daemon starts it again."""


class RecordingBroken(RecorderError):
    """The data asked for is in a file that was cut short; the recording continues in the next file."""


class DaemonError(AcquireError):
    """The daemon cannot be reached or started."""


class DaemonNotRunning(DaemonError):
    """No process listens on the socket."""


class DaemonSilent(DaemonError):
    """The daemon runs and does not answer."""


class DaemonBusy(DaemonError):
    """Another daemon, or another session, holds what was asked for."""


class SessionError(AcquireError):
    """The session cannot go on."""


def by_name(name: str, otherwise: type[AcquireError] = AcquireError) -> type[AcquireError]:
    """Error class of this module with the given name; `otherwise` for an unknown name.

    Processes send each other errors as the class's name and the message.
    """
    found = globals().get(name)
    return found if isinstance(found, type) and issubclass(found, AcquireError) else otherwise
