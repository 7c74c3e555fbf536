"""The command `analyze frame-rate`: a camera's true frame rate from a tag in free fall."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import click

from analyze.verbs.options import one_line, pass_options, path_option
from schemas.command_line import NumberRange
from schemas.plain_text import echo


@dataclass(frozen=True)
class _FrameRateArguments:
    """Values of the arguments and options of `analyze frame-rate`."""

    source: Path
    """video, folder of images or recording"""
    marker_size_mm: float
    """edge of the tag's black square [mm]"""
    marker_size_sd_mm: float
    """standard deviation of that edge [mm]"""
    marker: str | None
    """name of the tag; None for the first that is seen"""
    camera: Path | None
    """file with the lens; None for the recording's own camera"""
    capture_fps: float | None
    """frame rate that the camera states [Hz]; None if not given"""
    mass_g: float
    """mass of the falling body [g]"""
    gravity: float | None
    """local gravity [m/s^2]; None if not given"""
    global_shutter: bool
    """True if the camera reads all rows at once"""
    as_json: bool
    """True to print JSON"""


@click.command("frame-rate")
@click.argument("source", metavar="VIDEO", type=click.Path(path_type=Path))
@click.option(
    "--marker-size-mm",
    type=NumberRange(0, 1000, min_open=True),
    required=True,
    help="Edge of the tag's black square, as measured on the print; it sets the scale of all lengths.",
)
@click.option(
    "--marker-size-sd-mm",
    type=NumberRange(0, 100),
    default=0.1,
    show_default=True,
    help="Standard deviation of that edge.",
)
@click.option("--marker", metavar="ID", help="The tag, as 3 or 25h9-0.  [default: the first that is seen]")
@path_option(
    "--camera",
    help="The lens: a file of `analyze calibrate -o`, a rig file, or a file of OpenCV, Kalibr or ROS.  "
    "[default: the recording's camera]",
)
@click.option(
    "--capture-fps",
    type=NumberRange(1, 1_000_000),
    help="The frame rate that the camera states, to check it.",
)
@click.option(
    "--mass-g",
    type=NumberRange(0, 100_000, min_open=True),
    default=100.0,
    show_default=True,
    help="Mass of the falling body, for the drag of the air.",
)
@click.option(
    "--g", "gravity", type=NumberRange(9.7, 9.9), help="Local gravity [m/s²].  [default: 9.81 ± 0.04]"
)
@click.option("--global-shutter", is_flag=True, help="The camera reads all rows at once.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
@pass_options(_FrameRateArguments)
def frame_rate(arguments: _FrameRateArguments) -> None:
    """Measure a camera's true frame rate from a video of a tag in free fall.

    Glue a printed tag on something small and heavy, let it fall 0.4 m or more before the camera, and name the
    VIDEO, folder of images or recording. The answer is what to give `analyze import` as --capture-fps.
    """
    from analyze.progress import ProgressBar
    from analyze.verbs.frame_rate.drop import DropOptions, measure_drop
    from analyze.verbs.frame_rate.text import drop_json, drop_text

    options = DropOptions(
        source=arguments.source,
        size=1e-3 * arguments.marker_size_mm,
        size_sd=1e-3 * arguments.marker_size_sd_mm,
        mass=1e-3 * arguments.mass_g,
        camera=arguments.camera,
        marker=arguments.marker,
        capture_hz=arguments.capture_fps,
        gravity=arguments.gravity,
        global_shutter=arguments.global_shutter,
    )
    with ProgressBar() as progress:
        answer = measure_drop(options, progress)
    echo(
        json.dumps(drop_json(answer), allow_nan=False) if arguments.as_json else "\n".join(drop_text(answer))
    )
