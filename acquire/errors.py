"""Everything that acquire raises on purpose.

    AcquireError
    ├── ConfigError          a rig file that cannot be used
    ├── CameraError
    │   ├── CameraNotFound   nothing answers at the address
    │   ├── CameraLost       it answered before and does not now
    │   └── CameraSettingError   asked for a setting, read back another
    ├── StrikerError
    │   ├── StrikerNotFound  no port, or no servo on it
    │   ├── StrikerLost      the bus fell silent
    │   ├── StrikerFault     the servo reports a hardware error
    │   └── StrikerRefused   an interlock said no
    │       └── StrikerStopped   somebody said stop
    ├── RecorderError        the file cannot be written, or a path is taken
    │   ├── CaptureGone      the process that writes it died or was ended
    │   └── RecordingBroken  what was asked about lies in a file that broke off
    ├── DaemonError
    │   ├── DaemonNotRunning nobody listens on the socket
    │   ├── DaemonSilent     it is there, and does not answer
    │   └── DaemonBusy       somebody already does, or a session is open
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
    """Nothing answers at the address."""


class CameraLost(CameraError):
    """The camera answered before and does not now."""


class CameraSettingError(CameraError):
    """A setting reads back differently from what was written."""


class StrikerError(AcquireError):
    """The striker did not do what was asked."""


class StrikerNotFound(StrikerError):
    """No such port, or no servo answers on it."""


class StrikerLost(StrikerError):
    """The bus fell silent."""


class StrikerFault(StrikerError):
    """The servo reports a hardware error."""


class StrikerRefused(StrikerError):
    """An interlock said no."""


class StrikerStopped(StrikerRefused):
    """Somebody said stop: nothing moves until a person starts something anew."""

    def __init__(self, text: str = "the striker was stopped on request: home it to go on") -> None:
        super().__init__(text)


class RecorderError(AcquireError):
    """The recording cannot be written."""


class CaptureGone(RecorderError):
    """The capture process died, or hung and was ended; the daemon starts it again."""


class RecordingBroken(RecorderError):
    """What was asked about lies in a file that broke off; the recording goes on in the next."""


class DaemonError(AcquireError):
    """The daemon cannot be reached or started."""


class DaemonNotRunning(DaemonError):
    """Nobody listens on the socket."""


class DaemonSilent(DaemonError):
    """The daemon is there and does not answer."""


class DaemonBusy(DaemonError):
    """Another daemon, or another session, holds what was asked for."""


class SessionError(AcquireError):
    """The session cannot go on."""


def by_name(name: str, otherwise: type[AcquireError] = AcquireError) -> type[AcquireError]:
    """The error class called `name`, as it travels between processes; `otherwise` for any other name."""
    found = globals().get(name)
    return found if isinstance(found, type) and issubclass(found, AcquireError) else otherwise
