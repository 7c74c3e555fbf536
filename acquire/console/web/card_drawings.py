"""Placement cards of the session's plan as drawings, made by `analyze cards` when the session starts."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
import threading
from pathlib import Path

from acquire.console.web.programs import Analyses
from acquire.console.web.refusal import Refusal
from acquire.errors import AcquireError


class CardDrawings:
    """Drawings (SVG) of the cards of one plan; drawing takes a few seconds in a process of its own."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="percuss-cards-"))
        self._program = Analyses()
        self._drawn: dict[str, bytes] = {}
        self._thread: threading.Thread | None = None

    def draw(self, object_path: Path, plan_path: Path) -> None:
        """Begin to draw the cards of a plan, in place of those before."""
        if self._thread is not None:
            self._thread.join()
        self._drawn = {}
        self._thread = threading.Thread(
            target=self._draw, args=(object_path, plan_path), name="console-cards"
        )
        self._thread.start()

    def card(self, strike_id: str) -> bytes:
        """Drawing of a strike's card.

        Raises:
            Refusal: it is not drawn (yet).
        """
        drawing = self._drawn.get(strike_id)
        if drawing is None:
            raise Refusal(404, "NoCard", "this strike's card is not drawn yet", "try again in a second")
        return drawing

    def close(self) -> None:
        """End the drawing, and delete the files."""
        self._program.close()
        if self._thread is not None:
            self._thread.join()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _draw(self, object_path: Path, plan_path: Path) -> None:
        with contextlib.suppress(AcquireError, OSError, ValueError):
            names = json.loads(
                self._program.run(
                    "cards", str(object_path), str(plan_path), "-o", str(self._folder), "--json"
                )
            )
            self._drawn = {
                strike_id: (self._folder / Path(name).name).read_bytes() for strike_id, name in names.items()
            }
