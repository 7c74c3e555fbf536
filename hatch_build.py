"""Build hook of hatchling: writes the git commit into wheels and source archives."""

from __future__ import annotations

import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface):
    """Adds `schemas/built_commit.txt`, which `schemas.software` reads where there is no checkout to ask.

    An editable installation gets none: it runs from its checkout.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the file to the archive that is about to be built.

        Args:
            version: kind of archive; "editable" for an editable wheel.
            build_data: hatchling's instructions; `force_include` maps files to places in the archive.
        """
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        # The package is not installed while it is built.
        software = runpy.run_path(str(Path(self.root, "schemas", "software.py")))
        found = software["commit"](Path(self.root))
        # A wheel built from a source archive takes the archive's file: that is no checkout.
        if version == "editable" or not found:
            return
        self._folder = tempfile.TemporaryDirectory()
        file = Path(self._folder.name, software["BUILT_COMMIT"])
        file.write_text(found + "\n", encoding="ascii")
        build_data["force_include"][str(file)] = f"schemas/{file.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary file once the archive is written."""
        if self._folder is not None:
            self._folder.cleanup()
