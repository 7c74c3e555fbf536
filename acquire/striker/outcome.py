"""Outcome of a strike: contact time, tip speed and impulse from the impact that the arm measured."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from acquire.striker.base import StrikeOutcome
from acquire.striker.detector import count_contacts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from acquire.striker.contact import ImpactMeasurement
    from acquire.striker.sample import Sample
    from schemas.rig import StrikerConfig


def strike_outcome(
    config: StrikerConfig,
    impact: ImpactMeasurement | None,
    samples: Sequence[Sample],
    released_ns: int,
    turned_ns: int,
) -> StrikeOutcome:
    """Contact time [ns], tip speed [m/s], impulse [N s] and number of contacts of one strike.

    All but the number have standard deviations. The tip speed is v, that just before the contact. The impulse
    is m_s * (v - v'), with m_s the effective mass of the tip and v' its speed after the contact; None if no
    significant loss of speed was measured. Without an impact, contact time and impulse are None, the other
    measurements 0.

    Args:
        config: section `striker` of the rig file, with arm length and effective mass.
        impact: the impact that the arm measured; None if it met nothing.
        samples: samples of swing and retraction, in order.
        released_ns: host monotonic time at which the swing began [ns]; copied into the outcome.
        turned_ns: host monotonic time at which the retraction was commanded [ns].
    """
    length, mass = config.arm_length_m, config.effective_mass_kg
    if impact is None:
        return StrikeOutcome(None, 0.0, 0.0, 0.0, None, 0.0, 0, released_ns)
    impulse, impulse_sd = None, 0.0
    if impact.drop is not None:
        impulse = mass * impact.drop * length
        impulse_sd = math.hypot(config.effective_mass_sd_kg * impact.drop, mass * impact.drop_sd) * length
    return StrikeOutcome(
        contact_time_ns=impact.time_ns,
        contact_time_sd_ns=impact.time_sd_ns,
        tip_speed_m_s=impact.velocity * length,
        tip_speed_sd_m_s=impact.velocity_sd * length,
        impulse_n_s=impulse,
        impulse_sd_n_s=impulse_sd,
        contacts=count_contacts(samples, impact.time_ns, turned_ns, length),
        released_ns=released_ns,
    )
