"""Table of `analyze reproduce planar-impacts`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from analyze.reproduce.planar_impacts import GYRATION_M, MIN_SLID
from schemas.terminal import Terminal
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.reproduce.planar_impacts import Clustered, PlanarAnswer, RigidTest
    from analyze.types import Array


def render_impacts(answer: PlanarAnswer, console: Terminal | None = None) -> None:
    """Print restitution, friction and the comparison with a rigid body. Intervals are 95 %.

    Args:
        answer: estimates from the impacts.
        console: where to print; None for standard output.
    """
    console = console or Terminal()
    low, high = answer.approach
    table = Table(title=f"{answer.impacts} impacts of a real object at {low:.1f} to {high:.1f} m/s")
    for heading in ("", "value", "95 % interval", "single impacts, 5 to 95 %"):
        table.add_column(heading, justify="right" if heading else "left")
    table.add_row("restitution", *_value(answer.restitution), _range(answer.restitution_percentiles))
    table.add_row("its change per m/s", *_value(answer.restitution_by_speed), "", end_section=True)
    friction = answer.friction
    table.add_row(
        f"friction, {counted(friction.slid, 'impact')} that slid",
        *(("", "") if friction.value is None else _value(friction.value)),
        _range(friction.percentiles) if friction.slid else "",
    )
    others = answer.impacts - friction.slid
    table.add_row(
        f"|T|/N of the {others} others", "", "", _range(friction.held_percentiles) if others else ""
    )
    console.print(table)
    if friction.value is None:
        console.print(
            f"Fewer than {MIN_SLID} impacts slid throughout: friction is at least the |T|/N of the others."
        )
    else:
        console.print(
            f"Coulomb's law: {100 * friction.opposing:.0f} % of the impulses that slid act against the "
            f"sliding; {100 * friction.beyond:.1f} % of all lie outside the friction cone by more than "
            f"2 sd (sd of one T/N: {friction.ratio_sd:.3f})."
        )
    console.print(_rigid(answer.rigid))
    if answer.rigid.mirrored:
        console.print(
            "x and the rotation have opposite handedness in this file: with the signs as stated a rigid "
            f"body's spin would be {answer.rigid.times_off_as_stated:.1f} times as far off as none. x is "
            "mirrored here."
        )
    if answer.left_out:
        console.print(f"Left out: {counted(answer.left_out, 'impact')} that hardly approached the table.")


def _rigid(rigid: RigidTest) -> str:
    least, most = rigid.gyration
    return (
        f"Rigid body: the impulse's moment explains {100 * rigid.explained:.0f} % of the spin's change, but "
        f"for {rigid.residual_rad_s:.1f} rad/s (1 sd); the radius of gyration lies between "
        f"{1e3 * least.value:.1f} and {1e3 * most.value:.1f} mm (stated: {1e3 * GYRATION_M:.1f}). "
        f"{counted(rigid.pulls, 'impulse')} pulled at the object, energy grew in "
        f"{counted(rigid.gains, 'impact')}."
    )


def _value(found: Clustered) -> tuple[str, str]:
    return f"{found.value:.3f}", f"{found.interval[0]:.3f} to {found.interval[1]:.3f}"


def _range(percentiles: Array) -> str:
    return f"{percentiles[0]:.2f} to {percentiles[-1]:.2f}"
