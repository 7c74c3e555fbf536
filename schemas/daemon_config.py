"""The rig file's table [daemon]: the socket on which the daemon serves `acquire`'s other commands."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import Field, field_validator

from schemas.document import Document


class DaemonConfig(Document):
    """Unix socket on which the daemon, which owns camera and striker, serves `acquire`'s other commands.

    The socket's folder is private to the user.
    """

    socket: str | None = Field(
        default=None, description="absolute path; default: in the user's run-time folder"
    )

    @field_validator("socket")
    @classmethod
    def _is_absolute(cls, value: str | None) -> str | None:
        """The path as given.

        Raises:
            ValueError: it is relative: `acquire stop` in another folder would not find the daemon.
        """
        if value is not None and not value.startswith("/"):
            raise ValueError(
                f"should be an absolute path, by which all commands find the daemon, not {value!r}"
            )
        return value

    def socket_path(self) -> Path:
        """Path of the socket: as configured, otherwise percuss/daemon.sock in the user's run-time folder.

        That folder is XDG_RUNTIME_DIR or, without it, /tmp/percuss-UID.
        """
        if self.socket is not None:
            return Path(self.socket)
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        fallback = f"/tmp/percuss-{os.getuid()}"  # noqa: S108 - created 0700, ownership checked
        base = Path(runtime or fallback)
        return base / "percuss" / "daemon.sock"
