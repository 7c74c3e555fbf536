"""`Plan`: the planned strikes of an object, the result of `analyze.plan`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.api.tables import data_frame, html_table, text_table
from analyze.verbs.plan.plan_object import write_plan
from schemas.wording import counted

if TYPE_CHECKING:
    import pandas as pd

    from analyze.verbs.plan.plan_object import PlannedObject
    from schemas.strike_plan import StrikePlan


class Plan:
    """Planned strikes of one object, with the accuracy expected from them.

    Returned by `analyze.plan`; in a notebook it shows as a table.
    """

    def __init__(self, planned: PlannedObject) -> None:
        self._planned = planned

    @property
    def document(self) -> StrikePlan:
        """Plan as a document: the entries that `analyze plan --json` prints."""
        return self._planned.plan

    def write(self, output: str | Path) -> Path:
        """Write the plan as JSON, the input of `acquire session`.

        Args:
            output: the JSON file; its folder must exist.

        Returns:
            Path of the file.

        Raises:
            OutputError: the file cannot be written.
        """
        output = Path(output)
        write_plan(self.document, output)
        return output

    def to_dict(self) -> dict[str, Any]:
        """Plan as a dict of JSON values; the entries that `analyze plan --json` prints."""
        return self.document.model_dump(mode="json")

    def to_dataframe(self) -> pd.DataFrame:
        """Planned strikes as a pandas table, one strike per row.

        Columns: strike, axis (pivot edge), plane (resting face), heading [°] (turn of object and striker
        about the vertical), impulse [N s] and phi predicted [°] (balance angle).

        Raises:
            ImportError: pandas is not installed.
        """
        return data_frame(self._rows())

    def __repr__(self) -> str:
        """Text of the plan: object, number of strikes, and a table with one strike per line."""
        return (
            f"{self.document.object_name}, "
            f"{counted(len(self.document.strikes), 'strike')}\n{text_table(self._rows())}"
        )

    def _repr_html_(self) -> str:
        return html_table(f"{self.document.object_name}: planned strikes", self._rows())

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {
                "strike": strike.id,
                "axis": strike.axis_id,
                "plane": strike.plane_id,
                "heading [°]": round(float(np.degrees(strike.heading_rad)), 1),
                "impulse [N s]": None if strike.impulse_n_s is None else round(strike.impulse_n_s.target, 4),
                "phi predicted [°]": round(float(np.degrees(strike.phi_predicted_rad)), 2),
            }
            for strike in self.document.strikes
        ]
