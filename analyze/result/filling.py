"""Level, mass and density of a filling in the Result document, and warnings about them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from schemas.quantity import Quantity
from schemas.result import Filling, ResultWarning, WarningCode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from analyze.estimation.fill_level import FillLevel, Marginal

MAX_MISFIT = 2.5
"""rms of the moments' residuals over their sd, above which a filling does not explain the moments"""


def filling_document(name: str, found: FillLevel) -> Filling:
    """Entry of a filling in the Result document: level, share, masses and density with 95 % intervals.

    The level [m] is measured from the origin of the object frame O along the direction that pointed upwards
    when the object was filled. The share is the filled part of the interior's volume. Masses [kg] are those
    of filling and shell (outer wall), the density [kg/m³] is the filling's. The shell's thickness [m] is None
    where the object file gives it.

    Args:
        name: name of the filling in the object file.
        found: estimated level, mass and density.
    """
    return Filling(
        name=name,
        along=found.along.tolist(),
        level=_quantity(found.level, "m", frame="O"),
        filled_share=_quantity(found.filled, "1"),
        mass=_quantity(found.mass, "kg"),
        density=_quantity(found.density, "kg/m^3"),
        shell=_quantity(found.shell_mass, "kg"),
        shell_thickness=None if found.thickness is None else _quantity(found.thickness, "m"),
        misfit=found.misfit,
    )


def filling_warnings(filling: Filling | None) -> Iterator[ResultWarning]:
    """Yield warnings about a filling: its assumption, a misfit, quantities that the moments leave open.

    The first, always yielded, is that the filling is assumed to move with the object. Nothing is yielded for
    None (the object file names no filling).
    """
    if filling is None:
        return
    text = (
        f"{filling.name} is assumed to move with the object (powder that does not run; frozen, set or"
        " viscous): a free liquid sloshes"
    )
    yield ResultWarning(
        code=WarningCode.FILLING_ASSUMED_RIGID, text=f"{text}, and these results do not hold for it"
    )
    if filling.misfit > MAX_MISFIT:
        text = (
            f"a shell and {filling.name} up to a level do not explain the moments ({filling.misfit:.1f} times"
            " their sd)"
        )
        yield ResultWarning(
            code=WarningCode.FILLING_UNEXPLAINED,
            text=f"{text}: check `along` in the object file; there may also be something else inside",
        )
    numbers = {
        "level": filling.level,
        "mass": filling.mass,
        "density": filling.density,
        "shell's mass": filling.shell,
        "shell's thickness": filling.shell_thickness,
    }
    if open_ones := [name for name, number in numbers.items() if number is not None and not number.observed]:
        text = f"{filling.name}: the moments do not determine {', '.join(open_ones)}"
        yield ResultWarning(
            code=WarningCode.REGIONS_UNCERTAIN,
            text=f"{text}; give its density (density_kg_m3) in the object file if it is known",
        )


def _quantity(found: Marginal, unit: str, frame: str | None = None) -> Quantity:
    """Posterior of one quantity of a filling in the Result's form: value, sd, 95 % interval, unit, frame.

    `frame` is None for a quantity without a frame.
    """
    return Quantity(
        value=found.value,
        sd=found.sd,
        unit=unit,
        interval95=list(found.interval),
        observed=found.observed,
        frame=frame,
    )
