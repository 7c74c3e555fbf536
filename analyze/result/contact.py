"""Contact between object and table in the Result document, and as lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.estimation.contact_properties import LEAST_SLIDE_M
from analyze.result.digits import number, open_interval, with_interval
from analyze.result.quantities import quantity
from schemas.contact_result import (
    ContactPropertiesResult,
    FrictionResult,
    LandingResult,
    RestitutionResult,
    StrikeFrictionResult,
)
from schemas.quantity import Quantity
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.estimation.contact_properties import (
        ContactProperties,
        Friction,
        LandingRestitution,
        Restitution,
    )
    from schemas.result import Result

UNITLESS = "1"
"""unit of coefficients"""


def contact_document(name: str, contact: ContactProperties | None) -> ContactPropertiesResult | None:
    """Entry `contact_properties` of the Result document; None if the strikes show nothing of the contact.

    Args:
        name: name of the object.
        contact: estimated properties.
    """
    if contact is None:
        return None
    rolling = contact.rolling
    return ContactPropertiesResult(
        object=name,
        table=contact.table,
        friction=None if contact.friction is None else _friction(contact.friction),
        restitution=None if contact.restitution is None else _restitution(contact.restitution),
        rolling_arm=None if rolling is None else quantity(rolling.arm, rolling.sd, "m"),
    )


def _friction(friction: Friction) -> FrictionResult:
    if friction.value is None or friction.sd is None:
        coefficient = Quantity(value=None, unit=UNITLESS, observed=False)
    else:
        coefficient = quantity(friction.value, friction.sd, UNITLESS, interval=friction.interval)
    return FrictionResult(
        coefficient=coefficient,
        at_least=friction.bound,
        scatter=friction.scatter,
        strikes=[
            StrikeFrictionResult(strike_id=each.strike_id, slid_m=each.slid, held_ratio=each.held_ratio)
            for each in friction.strikes
        ],
    )


def _restitution(restitution: Restitution) -> RestitutionResult:
    landings = restitution.landings
    return RestitutionResult(
        mean=quantity(restitution.mean, restitution.sd, UNITLESS, 0.0, restitution.interval),
        scatter=restitution.scatter,
        speed_m_s=sum(each.speed for each in landings) / len(landings),
        landings=[
            LandingResult(
                strike_id=each.strike_id,
                restitution=_landing(each),
                speed_m_s=each.speed,
                angular_speed_before_rad_s=each.omega_before,
                angular_speed_after_rad_s=each.omega_after,
            )
            for each in landings
        ],
    )


def _landing(landing: LandingRestitution) -> Quantity:
    if landing.upper is None:
        return quantity(landing.value, landing.sd, UNITLESS, 0.0)
    found = quantity(landing.value, landing.sd, UNITLESS, interval=(0.0, landing.upper))
    return found.model_copy(update={"observed": False})


def contact_lines(result: Result) -> list[str]:
    """Lines of text on the contact between object and table; empty if the result has none."""
    contact = result.contact_properties
    if contact is None:
        return []
    lines: list[str] = []
    if (friction := contact.friction) is not None:
        slid = sum(each.slid_m > LEAST_SLIDE_M for each in friction.strikes)
        if friction.coefficient.observed:
            lines.append(
                f"Friction of {contact.object} on {contact.table}:"
                f" {with_interval(friction.coefficient, 1.0)}, 95 %"
                f" ({slid} of {counted(len(friction.strikes), 'strike')} slid by more than 0.5 mm)."
            )
        else:
            lines.append(
                f"Friction of {contact.object} on {contact.table}:"
                f" at least {number(friction.at_least, 2)}, 95 %; no edge slid enough for a value."
            )
    if (restitution := contact.restitution) is not None:
        scatter = (
            ""
            if restitution.scatter is None
            else f", scatter {number(restitution.scatter, 3)} from landing to landing"
        )
        lines.append(
            f"Restitution where it lands at {number(restitution.speed_m_s, 1)} m/s:"
            f" {with_interval(restitution.mean, 1.0)}, 95 %"
            f" ({counted(len(restitution.landings), 'landing')}{scatter})."
        )
    if contact.rolling_arm is not None:
        shown = open_interval(contact.rolling_arm, 1e3)
        lines.append(f"Rolling resistance: the load acts {shown} mm ahead of the contact, 95 %.")
    return lines


def contact_rows(result: Result) -> list[tuple[str, str, str, str]]:
    """Rows on each strike's contact: id, sliding [mm], friction needed while the edge held, restitution."""
    contact = result.contact_properties
    if contact is None:
        return []
    friction = {each.strike_id: each for each in contact.friction.strikes} if contact.friction else {}
    landings = {each.strike_id: each for each in contact.restitution.landings} if contact.restitution else {}
    rows: list[tuple[str, str, str, str]] = []
    for strike_id in dict.fromkeys([*friction, *landings]):
        slide, landing = friction.get(strike_id), landings.get(strike_id)
        rows.append(
            (
                strike_id,
                "–" if slide is None else number(1e3 * slide.slid_m, 2),
                "–" if slide is None or slide.held_ratio is None else number(slide.held_ratio, 2),
                "–" if landing is None else _landing_text(landing.restitution),
            )
        )
    return rows


def _landing_text(restitution: Quantity) -> str:
    if restitution.observed:
        return with_interval(restitution, 1.0)
    return f"below {number(restitution.interval_ends()[1], 3)}"
