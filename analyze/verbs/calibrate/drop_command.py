"""Options and printing of `analyze calibrate --drop`: a video's frame rate from a tag in free fall."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from analyze.verbs.options import path_option, with_options
from schemas.command_line import NumberRange

with_drop_options = with_options(
    click.option(
        "--drop",
        is_flag=True,
        help="Instead of the lens: measure the true frame rate from a video or recording of a falling tag.",
    ),
    click.option(
        "--marker-size-mm",
        type=NumberRange(0, 1000, min_open=True),
        help="With --drop: edge of the tag's black square, as measured on the print.",
    ),
    click.option(
        "--marker-size-sd-mm",
        type=NumberRange(0, 100),
        help="With --drop: standard deviation of that edge.  [default: 0.1]",
    ),
    click.option(
        "--marker",
        metavar="ID",
        help="With --drop: the tag, as 3 or 25h9-0.  [default: the first that is seen]",
    ),
    path_option(
        "--camera",
        "camera_file",
        help="With --drop: the lens: a file written by -o, a rig file, or a file of OpenCV, Kalibr or ROS.",
    ),
    click.option(
        "--capture-fps",
        type=NumberRange(1, 1_000_000),
        help="With --drop: the frame rate that the camera states, to check it.",
    ),
    click.option(
        "--mass-g",
        type=NumberRange(0, 100_000, min_open=True),
        help="With --drop: mass of the falling body, for the drag of the air.  [default: 100]",
    ),
    click.option(
        "--g",
        "gravity",
        type=NumberRange(9.7, 9.9),
        help="With --drop: local gravity [m/s²].  [default: 9.81 ± 0.04]",
    ),
    click.option("--global-shutter", is_flag=True, help="With --drop: the camera reads all rows at once."),
)
"""decorator that adds --drop and the options that only --drop uses to a click command"""
DEFAULT_SIZE_SD_MM, DEFAULT_MASS_G = 0.1, 100.0


def refuse_mixed(drop: bool, drop_options: Sequence[str], lens_options: Sequence[str]) -> None:
    """Refuse options of the lens together with --drop, and options of --drop without it.

    Args:
        drop: True if --drop was given.
        drop_options: names of the options given that only --drop uses, such as "--mass-g".
        lens_options: names of the options given that only the calibration of a lens uses, such as
            "--squares".

    Raises:
        click.UsageError: options of both kinds are mixed.
    """
    if drop and lens_options:
        raise click.UsageError(
            f"{', '.join(lens_options)}: for the lens, which --drop does not measure: leave them out"
        )
    if not drop and drop_options:
        raise click.UsageError(f"{', '.join(drop_options)}: only for a recorded fall: add --drop")


def measure_frame_rate(inputs: Sequence[Path], drop_values: dict[str, Any], as_json: bool) -> None:
    """Measure the true frame rate of one video from the fall of a tag in it, and print it.

    Args:
        inputs: the video, folder of images or recording; exactly one.
        drop_values: values of the parameters that only --drop uses, by name; None for an option not given.
        as_json: True to print JSON instead of text.

    Raises:
        click.UsageError: not exactly one input is named, or the tag's size is missing.
        AnalyzeError, DocumentError: the frame rate cannot be measured, as in `measure_drop`.
    """
    from analyze.progress import ProgressBar
    from analyze.verbs.calibrate.drop import DropOptions, measure_drop
    from analyze.verbs.calibrate.drop_table import drop_json, drop_text

    if len(inputs) != 1:
        raise click.UsageError(
            f"--drop measures one video, folder or recording, but {len(inputs)} are named: name one"
        )
    if drop_values["marker_size_mm"] is None:
        raise click.UsageError(
            "--drop needs --marker-size-mm, which sets the scale of all lengths: measure the edge of the "
            "tag's black square on the print"
        )
    size_sd = drop_values["marker_size_sd_mm"]
    options = DropOptions(
        source=inputs[0],
        size=1e-3 * drop_values["marker_size_mm"],
        size_sd=1e-3 * (DEFAULT_SIZE_SD_MM if size_sd is None else size_sd),
        mass=1e-3 * (drop_values["mass_g"] or DEFAULT_MASS_G),
        camera=drop_values["camera_file"],
        marker=drop_values["marker"],
        capture_hz=drop_values["capture_fps"],
        gravity=drop_values["gravity"],
        global_shutter=drop_values["global_shutter"],
    )
    with ProgressBar() as progress:
        answer = measure_drop(options, progress)
    click.echo(json.dumps(drop_json(answer), allow_nan=False) if as_json else "\n".join(drop_text(answer)))
