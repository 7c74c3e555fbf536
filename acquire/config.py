"""Reader of the rig file; its schema is in schemas/rig.py, because `analyze plan` reads the same file."""

from __future__ import annotations

import tomllib
from pathlib import Path

from acquire.errors import ConfigError
from schemas.document import DocumentError, validate
from schemas.rig import CameraConfig, DaemonConfig, RecorderConfig, RigConfig, StrikerConfig

__all__ = ["CameraConfig", "DaemonConfig", "RecorderConfig", "RigConfig", "StrikerConfig", "read_rig"]


def read_rig(path: Path) -> RigConfig:
    """Read and validate a rig file.

    Raises:
        ConfigError: the file is missing, is not TOML, or holds an entry that cannot be used.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # not UTF-8, not TOML, nested too deep
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    try:
        return validate(RigConfig, data, str(path))
    except DocumentError as error:
        raise ConfigError(str(error)) from None
