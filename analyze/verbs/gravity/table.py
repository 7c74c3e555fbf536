"""The table's tilt, measured from plumb lines, as text and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.verbs.gravity.level import GravityAnswer, level_entries
from schemas.document import SCHEMA_VERSION
from schemas.wording import counted


def gravity_text(answer: GravityAnswer) -> list[str]:
    """Lines for the terminal: plumb lines found, table's tilt [deg] with 95 % intervals, doubts."""
    table = answer.table
    lines: list[str] = []
    for line, place, many in zip(answer.lines, answer.places_px, answer.seen_in, strict=True):
        length = float(np.linalg.norm(line.top - line.bottom))
        kind = "dark" if line.dark else "bright"
        lines.append(
            f"{kind} string at column {place:.0f}, {length:.0f} px long, in {many} of "
            f"{counted(answer.looked_at, 'image')}"
        )
    for i, towards in enumerate(("+x, where objects tip", "+y, away from the camera")):
        value, sd = np.degrees([table.lean[i], SIGMAS_95 * table.sd[i]])
        text = (
            f"{value:+.3f} ± {sd:.3f}° (95 % interval)"
            if table.determined[i]
            else f"not determined (± {sd:.2f}°)"
        )
        lines.append(f"table tilt towards {towards}: {text}")
    if not table.determined[1]:
        lines.append(
            "note: strings far apart in the image would determine the second; tips, also turned by 180°, do "
            "not depend on it"
        )
    sd = float(np.degrees(answer.options.camera_turn_sd))
    lines.append(
        f"note: the camera's rotation against the table is taken as known to {sd:.2g}° (1 sigma; "
        "--camera-sd-deg), which the intervals include"
    )
    if table.contradicts_prior:
        shown, known = (
            float(np.degrees(np.max(np.abs(table.lean_by_lines)))),
            float(np.degrees(table.prior_sd)),
        )
        lines.append(
            f"doubt: the strings lean by {shown:.2f}°, the table is stated level to ±{known:.2f}° "
            "(gravity_tilt_sd_rad), and the answer is in between: level the table, state a larger "
            "uncertainty, or measure T_world_camera anew"
        )
    if table.scatter > 2:
        lines.append(
            f"doubt: the strings disagree by {table.scatter:.1f} times their noise: one was swinging or is "
            "not a string: look at --picture"
        )
    return lines


def gravity_json(answer: GravityAnswer) -> dict[str, Any]:
    """The table's tilt and the plumb lines that it was measured from, as JSON values.

    `lean_rad` is the tilt [rad] towards x and towards y of the world frame W, `sd_rad` its standard
    deviations; `strings` lists the plumb lines, with their ends in the image [px]. Further keys name their
    unit. `level` is the section [level] for the rig file, as a dict; it is None if the tilt towards +x is not
    determined.
    """
    table = answer.table
    return {
        "schema_version": SCHEMA_VERSION,
        "lean_rad": table.lean.tolist(),
        "sd_rad": table.sd.tolist(),
        "covariance_rad2": table.covariance.tolist(),
        "determined": list(table.determined),
        "prior_sd_rad": table.prior_sd,
        "camera_turn_sd_rad": answer.options.camera_turn_sd,
        "scatter": table.scatter,
        "images": answer.looked_at,
        "strings": [
            {
                "bottom_px": line.bottom.tolist(),
                "top_px": line.top.tolist(),
                "end_sd_px": line.end_sd,
                "dark": line.dark,
                "images": many,
                "residual_rad": residual,
            }
            for line, many, residual in zip(
                answer.lines, answer.seen_in, table.residual.tolist(), strict=True
            )
        ],
        "level": level_entries(answer) if table.determined[0] else None,
    }
