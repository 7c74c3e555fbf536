"""Errors of the balance angle phi and of k caused by a contact that is not a perfect hinge.

The fit follows the tipping angle theta(t) to a ten-thousandth of a degree even where the edge creeps, so its
residuals do not reveal these errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analyze.types import Array, MotionFit


@dataclass(frozen=True)
class ContactErrors:
    """Standard deviations of phi and k caused by the contact, in addition to the fit's own.

    phi is the balance angle, at which the centre of mass stands above the contact of edge and table, and k
    the rate of the tip in theta'' = -k sin(phi - theta), with theta the tipping angle.

    The error of phi was measured on 107 simulated strikes (dry friction of 0.6 to 0.8, up to twice the energy
    needed to reach balance), fitted to the true theta(t). On 35 strikes with other seeds the 95 % intervals
    contained phi in 83 %; that was before the sd of theta's zero was given a lower limit (tip_angle.py). The
    error of k was measured on 360 strikes of four objects through images, on roundings of 1 mm: k was off by
    1.0 to 1.3 of the fit's own sd (0.06 to 0.07 %).
    """

    edge_phi_sd: float = 7e-5
    """sd of phi [rad] on a straight edge, which creeps by 10 to 25 um; phi is off by 0.0007 deg (bottles) to
    0.004 deg (carton, 1 mm rounding), rms"""
    rim_phi_sd: float = 3.2e-4
    """sd of phi [rad] on a round rim: the contact wanders along it and the body turns with it; 0.02 deg
    rms"""
    k_relative_sd: float = 7e-4
    """relative sd of k, caused by a stated rounding that is 0.3 mm off, as is usual: 0.03 to 0.1 %"""


def with_contact_errors(
    fit: MotionFit, rolls: bool, errors: ContactErrors, creep: Array | None = None
) -> MotionFit:
    """Copy of a strike's fitted motion whose covariance includes the errors that the contact causes.

    Args:
        fit: balance angle phi [rad] and rate constant k [rad/s^2] of theta'' = -k sin(phi - theta), theta the
            tipping angle; k may be None.
        rolls: True if the edge is a round rim.
        errors: standard deviations of phi [rad] and k (relative) that a usual contact causes.
        creep: (2, 2) covariance of (phi, k) by the edge's measured creep (small displacements; see
            `creep_error`); for phi the greater of this and the usual error counts. None if the fit follows
            the edge's motion.

    Returns:
        The fit with the (2, 2) covariance of (phi, k) increased; the variance of k stays as it is if k is
        None.
    """
    phi_sd = errors.rim_phi_sd if rolls else errors.edge_phi_sd
    added = np.diag([phi_sd**2, (errors.k_relative_sd * (fit.k or 0.0)) ** 2])
    if creep is not None:
        added = added + creep
        added[0, 0] = max(phi_sd**2, float(creep[0, 0]))
    return replace(fit, covariance=fit.covariance + added)
