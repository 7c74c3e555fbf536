"""`analyze rig-parts`: write the printable parts of a rig, with dimensioned drawings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.options import one_line
from schemas.command_line import NumberRange
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.rig_parts.all_parts import RigPrints
    from schemas.rig import StrikerConfig

ROTOR_KG_M2 = 0.0012
"""Moment of inertia of an XM430's rotor at its horn, as published [kg m^2] (ToddlerBot)."""


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

    They are arm, pad, adapters to the horns of XM430 and XL330, a hub on ball bearings for a pendulum, a
    camera's holder and a clamp for the mat.
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
        echo(json.dumps(_as_json(prints, files), allow_nan=False))
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
        lines.append(f"{each.part.name:14} {size:>13} mm {1000 * each.mass_kg:4.0f} g{copies}")
        lines.append(f"{'':14} {each.part.purpose}: {each.part.fasteners}")
    lines.append(
        "all are watertight, have walls of 1.2 mm or more and fit a bed of 220 mm; print them as they lie, "
        "with 30 % infill, without supports"
    )
    rotor = ROTOR_KG_M2 / prints.arm_length_m**2
    wanted = striker.effective_mass_kg
    alone, with_rotor = (1000 * prints.ballast_kg(mass) for mass in (wanted, wanted - rotor))
    lines.append(
        f"effective mass at the tip of arm, pad and bolt: {1000 * prints.arm_effective_kg:.0f} g, of the rig "
        f"{1000 * wanted:.0f} g: screw {alone:.0f} g of steel to the tip, or {with_rotor:.0f} g on an XM430, "
        f"whose rotor counts as {1000 * rotor:.0f} g"
    )
    lines.append(f"{counted(len(files), 'file')} in {files[0].parent}")
    return lines


def _as_json(prints: RigPrints, files: list[Path]) -> dict[str, Any]:
    """JSON object with the parts, the effective mass of the arm and the files."""
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
        "parts": parts,
        "files": [str(path) for path in files],
    }
