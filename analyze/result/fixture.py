"""Fixture of the object in the Result document, and as lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.digits import with_interval
from analyze.result.quantities import com_quantity, inertia_quantity, quantity
from schemas.fixture_result import ErrorByCause, FixturePart, FixtureResult

if TYPE_CHECKING:
    from analyze.pipeline.fixture import FixtureEstimate
    from schemas.result import Result

SHOWN_SHARE = 0.02
"""share of the variance of the centre of mass up to which a cause is not listed"""


def fixture_document(fixture: FixtureEstimate | None) -> FixtureResult | None:
    """Entry `fixture` of the Result document: fixture, struck body, errors by cause; None without fixture."""
    if fixture is None:
        return None
    struck = fixture.struck
    return FixtureResult(
        parts=[
            FixturePart(
                name=body.name,
                mass=quantity(body.mass, body.mass_sd, "kg").model_copy(update={"source": "given"}),
                centre_of_mass_m=body.com.tolist(),
            )
            for body in fixture.held.fixture
        ],
        struck_mass=quantity(struck.mass, struck.mass_sd, "kg").model_copy(update={"source": "given"}),
        struck_centre_of_mass=com_quantity(struck.com),
        struck_inertia=inertia_quantity(struck),
        errors=[
            ErrorByCause(
                cause=share.cause,
                com_sd_m=np.sqrt(np.diag(share.com_covariance)).tolist(),
                inertia_sd_kg_m2=share.tensor_sd.tolist(),
            )
            for share in fixture.shares
        ],
    )


def fixture_lines(result: Result) -> list[str]:
    """Two lines of text on a result's fixture: the masses subtracted, and the errors by cause.

    Half widths are those of the 95 % interval of the centre of mass (root mean square of x, y, z). Empty if
    the object has no fixture.
    """
    fixture = result.fixture
    if fixture is None:
        return []
    parts = ", ".join(f"{part.name} {with_interval(part.mass, 1e3, 'g')}" for part in fixture.parts)
    variances = [(float(np.square(each.com_sd_m).mean()), each.cause) for each in fixture.errors]
    total = sum(variance for variance, _ in variances)
    listed = ", ".join(
        f"{1e3 * SIGMAS_95 * variance**0.5:.2g} mm from the {cause}"
        for variance, cause in sorted(variances, reverse=True)
        if variance > SHOWN_SHARE * total
    )
    together = with_interval(fixture.struck_mass, 1e3, "g")
    half = f"{1e3 * SIGMAS_95 * total**0.5:.2g}"
    return [
        f"Values are of the object alone: its fixture ({parts}) is subtracted from the struck {together}.",
        f"Its centre of mass is known to ± {half} mm along an axis, 95 %: {listed}.",
    ]
