"""`analyze calibrate --drop`: how fast a camera's frames come, from a tag that falls before it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from schemas.command_line import NumberRange

_options = [
    click.option(
        "--drop", is_flag=True, help="Instead of the lens: the true frame rate, from a film (video, recording) of a tag that falls."
    ),
    click.option(
        "--marker-size-mm", type=NumberRange(0, 1000, min_open=True), help="With --drop: edge of the tag's black square, as measured."
    ),
    click.option("--marker-size-sd-mm", type=NumberRange(0, 100), help="With --drop: how well that is known, 1 sigma.  [default: 0.1]"),
    click.option("--marker", metavar="ID", help="With --drop: which tag, as 3 or 25h9/0.  [default: the first that is seen]"),
    click.option(
        "--camera",
        "camera_file",
        type=click.Path(path_type=Path),
        help="With --drop: the lens (-o of this command, rig file, OpenCV, Kalibr, ROS).",
    ),
    click.option("--capture-fps", type=NumberRange(1, 1_000_000), help="With --drop: what the rate is taken for, to check it."),
    click.option(
        "--mass-g", type=NumberRange(0, 100_000, min_open=True), help="With --drop: of what falls; the air slows it.  [default: 100]"
    ),
    click.option("--g", "gravity", type=NumberRange(9.7, 9.9), help="With --drop: gravity there [m/s²].  [default: 9.81 ± 0.04]"),
    click.option("--global-shutter", is_flag=True, help="With --drop: the camera reads all rows at once."),
]
DROP_ONLY = ("marker_size_mm", "marker_size_sd_mm", "marker", "camera_file", "capture_fps", "mass_g", "gravity", "global_shutter")
SIZE_SD_MM, MASS_G = 0.1, 100.0


def with_drop_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """--drop and what goes with it."""
    for option in reversed(_options):
        function = option(function)
    return function


def refuse_mixed(drop: bool, dropped: dict[str, Any], others: Sequence[str]) -> None:
    """One line where options of the other kind are given; `others` are those given that are of the lens."""
    if drop and others:
        raise click.UsageError(f"{', '.join(others)}: of the lens, which --drop does not measure: leave it out")
    if not drop and any(dropped[name] for name in DROP_ONLY):
        given = ", ".join(f"--{name.replace('_file', '').replace('_', '-')}".replace("gravity", "g") for name in DROP_ONLY if dropped[name])
        raise click.UsageError(f"{given}: of a filmed fall: add --drop")


def measure(inputs: Sequence[Path], dropped: dict[str, Any], as_json: bool) -> None:
    """Carry it out and print it."""
    from analyze.progress import StrikeProgress
    from analyze.verbs.calibrate.drop import DropOptions, measure_drop
    from analyze.verbs.calibrate.drop_table import drop_json, drop_text

    if len(inputs) != 1:
        raise click.UsageError("--drop measures one film: name one video, folder or recording")
    if dropped["marker_size_mm"] is None:
        raise click.UsageError(
            "--drop needs --marker-size-mm: the edge of the tag's black square, as measured on the print; all lengths are its"
        )
    size_sd = dropped["marker_size_sd_mm"]
    options = DropOptions(
        source=inputs[0],
        size=1e-3 * dropped["marker_size_mm"],
        size_sd=1e-3 * (SIZE_SD_MM if size_sd is None else size_sd),
        mass=1e-3 * (dropped["mass_g"] or MASS_G),
        camera=dropped["camera_file"],
        marker=dropped["marker"],
        capture_hz=dropped["capture_fps"],
        gravity=dropped["gravity"],
        global_shutter=dropped["global_shutter"],
    )
    with StrikeProgress() as progress:
        answer = measure_drop(options, progress)
    click.echo(json.dumps(drop_json(answer), allow_nan=False) if as_json else "\n".join(drop_text(answer)))
