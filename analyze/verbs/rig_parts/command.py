"""`analyze rig-parts`: write the printable parts of a rig, with dimensioned drawings."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.options import one_line
from schemas.command_line import NumberRange
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.rig_parts.all_parts import RigPrints
    from analyze.rig_parts.ballast import Ballast
    from schemas.rig import StrikerConfig

ROTOR_KG_M2 = 0.0012
"""Moment of inertia of an XM430's rotor at its horn, as published [kg m^2] (ToddlerBot)."""


@dataclass(frozen=True)
class _RigBallast:
    """Ballast for one kind of hinge."""

    where: str
    """Kind of hinge, as a place."""
    ballast: Ballast
    """Washers and bolt."""
    rotor_kg: float
    """Effective mass at the tip of the servo's rotor [kg]."""


@click.command("rig-parts")
@click.argument("rig", required=False, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("rig-parts"),
    show_default=True,
    help="Folder to write to; it is created if it is missing.",
)
@click.option(
    "--arm-length-mm",
    type=NumberRange(1, 2000),
    help="Length of the arm from the hinge's axis to the tip.  [default: that of RIG, else 120]",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def rig_parts(rig: Path | None, output: Path, arm_length_mm: float | None, as_json: bool) -> None:
    """Write the printable parts of RIG (a rig file, TOML): STL, 3MF and a dimensioned drawing of each.

    They are the arm; adapters and holders for XM430 and XL330; hub, spacers and axle plate of a pendulum on
    ball bearings, and a solenoid's holder for it; holders of camera and lamps; a clamp for the mat.
    """
    from analyze.rig_parts.all_parts import rig_prints
    from analyze.verbs.plan.rig import planned_rig
    from schemas.rig import StrikerConfig

    config = planned_rig(rig).config if rig is not None else None
    striker = config.striker if config is not None else StrikerConfig()
    length_m = striker.arm_length_m if arm_length_mm is None else arm_length_mm / 1000
    prints = rig_prints(length_m)
    files = _write(prints, output)
    if as_json:
        echo(json.dumps(_as_json(prints, striker, files), allow_nan=False))
        return
    for line in _lines(prints, striker, files):
        echo(line)


def _write(prints: RigPrints, folder: Path) -> list[Path]:
    """Write STL, 3MF and drawing of each part into a folder, and return the files; older ones are replaced.

    Raises:
        OutputError: the folder cannot be made, or a file cannot be written.
    """
    from analyze.fixture.print_files import stl_bytes, three_mf_bytes
    from analyze.rig_parts.drawing import drawing_svg
    from schemas.output_file import OutputError, write_bytes

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}: choose another place") from None
    written: list[Path] = []
    for each in prints.parts:
        mesh, name = each.part.mesh, each.part.name
        for suffix, data in (
            (".stl", stl_bytes(mesh)),
            (".3mf", three_mf_bytes(mesh, name)),
            (".svg", drawing_svg(each.part).encode("utf-8")),
        ):
            written.append(folder / f"{name}{suffix}")
            write_bytes(written[-1], data)
    return written


def _lines(prints: RigPrints, striker: StrikerConfig, files: list[Path]) -> list[str]:
    """Lines for the terminal: the parts with size, mass and screws, then the ballast and the files."""
    lines = []
    for each in prints.parts:
        size = " x ".join(f"{length:.0f}" for length in each.checks.size)
        copies = f", print {each.part.count}" if each.part.count > 1 else ""
        lines.append(f"{each.part.name:16} {size:>13} mm {1000 * each.mass_kg:4.0f} g{copies}")
        lines.append(f"{'':16} {each.part.purpose}: {each.part.fasteners}")
    lines.append(
        "all are watertight, have walls of 1.2 mm or more and fit a bed of 220 mm; print them as they lie, "
        "with 30 % infill, without supports"
    )
    wanted, alone = striker.effective_mass_kg, 1000 * prints.arm_effective_kg
    lines.append(
        f"effective mass at the tip: of the rig {1000 * wanted:.0f} g, of the arm {alone:.0f} g. Ballast:"
    )
    lines += [_ballast_line(prints, each) for each in _ballasts(prints, wanted)]
    pendulum = prints.ballast(wanted)
    speeds = [f"{angle} deg {speed:.2f} m/s" for angle, speed in prints.pin_speeds(pendulum).items()]
    lines.append(f"tip speeds of the pendulum, let go from the pin: {', '.join(speeds)}")
    lines.append(f"{counted(len(files), 'file')} in {files[0].parent}")
    return lines


def _ballasts(prints: RigPrints, wanted_kg: float) -> list[_RigBallast]:
    """Ballast of a pendulum, and of an arm on an XM430, for an effective mass at the tip [kg]."""
    rotor = ROTOR_KG_M2 / prints.arm_length_m**2
    return [
        _RigBallast("on ball bearings", prints.ballast(wanted_kg), 0.0),
        _RigBallast("on an XM430", prints.ballast(wanted_kg - rotor), rotor),
    ]


def _ballast_line(prints: RigPrints, each: _RigBallast) -> str:
    """Line for the terminal: washers and bolt, and the effective mass that they give."""
    total = prints.effective_kg(each.ballast) + each.rotor_kg
    rotor = f", with its rotor's {1000 * each.rotor_kg:.0f} g" if each.rotor_kg else ""
    stack = "none"
    if each.ballast.washers:
        stack = (
            f"{each.ballast.washers} M8 washers of 24 mm, half of them on each side, on an M8 x "
            f"{each.ballast.bolt_mm:.0f} bolt with a self-locking nut ({1000 * each.ballast.mass_kg:.0f} g)"
        )
    return f"  {each.where}: {stack}: {1000 * total:.0f} g{rotor}"


def _as_json(prints: RigPrints, striker: StrikerConfig, files: list[Path]) -> dict[str, Any]:
    """JSON object with the parts, the arm's effective mass, its ballast and the files."""
    ballasts = [
        {
            "where": each.where,
            "washers": each.ballast.washers,
            "bolt_mm": each.ballast.bolt_mm,
            "mass_kg": each.ballast.mass_kg,
            "effective_mass_kg": prints.effective_kg(each.ballast) + each.rotor_kg,
        }
        for each in _ballasts(prints, striker.effective_mass_kg)
    ]
    pendulum = prints.ballast(striker.effective_mass_kg)
    parts = [
        {
            "name": each.part.name,
            "purpose": each.part.purpose,
            "count": each.part.count,
            "size_mm": [round(float(length), 3) for length in each.checks.size],
            "thinnest_wall_mm": round(each.checks.wall, 2),
            "mass_kg": each.mass_kg,
            "fasteners": each.part.fasteners,
        }
        for each in prints.parts
    ]
    return {
        "arm_length_m": prints.arm_length_m,
        "arm_effective_mass_kg": prints.arm_effective_kg,
        "ballast": ballasts,
        "pendulum_speed_m_s_by_angle_deg": prints.pin_speeds(pendulum),
        "parts": parts,
        "files": [str(path) for path in files],
    }
